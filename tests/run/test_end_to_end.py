"""The whole job on a small rendered asteroid, undisturbed and killed in the middle."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from massprops.run.reconstruct import Run, reconstruct
from massprops.sequence.truth import read_truth
from massprops.simulation import simulate


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulate("asteroid", tmp_path_factory.mktemp("s") / "seq", frames=32, size=(320, 240), rate_deg=7.5, seed=1)


@pytest.fixture(scope="module")
def whole(sequence: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    truth = read_truth(sequence)
    assert truth is not None
    out = tmp_path_factory.mktemp("r") / "run"
    return reconstruct(sequence / "cam0" / "data", out, scale=truth.facts["greatest_length_m"], threads=2)


def test_the_answer_is_near_the_truth(whole: Run, sequence: Path) -> None:
    truth = read_truth(sequence)
    assert truth is not None and whole.exit_code == 0, whole.reason
    p = whole.properties
    # 40 images of 400x300 in seeds 1, 2 and 3 (23 to 38 % filled so that it balances): +0.6, -1.1, +0.8 % (moments -4.0 to +0.3 %), and
    # 0.5 % (1 sigma) between processors; three to four standard deviations of such a fill
    assert p["volume"] == pytest.approx(truth.facts["volume"], rel=0.04)
    assert np.allclose(p["principal_moments"], truth.facts["principal_moments"], rtol=0.08)
    # so few and small images leave a third of the surface to be filled in
    assert p["inertia_ratios"]["k1"] == pytest.approx(truth.facts["k1"], abs=0.05)
    low, high = p["interval_90"]["volume"]
    assert low < truth.facts["volume"] < high and low < p["volume"] < high and (high - low) / p["volume"] < 0.3
    assert p["units"] == {"length": "m", "mass": "kg"} and p["scale"]["source"] == "given"
    assert p["surface"]["watertight"] and p["surface"]["observed_fraction"] > 0.6


def test_the_run_folder_is_complete(whole: Run) -> None:
    for name in ("run.yaml", "mesh.ply", "mesh.glb", "cloud.ply", "massprops.json", "crosscheck.json", "report.html"):
        assert (whole.folder / name).stat().st_size > 20, name
    for name in ("sparse", "masks", "sequence/attitude0/data.csv", "sequence/tracks0/data.csv", "sequence/body.yaml"):
        assert (whole.folder / name).exists(), name
    mesh = trimesh.load(whole.folder / "mesh.ply")
    assert mesh.is_volume and mesh.body_count == 1
    assert mesh.volume == pytest.approx(whole.properties["volume"], rel=1e-9)
    moved = mesh.copy()
    moved.apply_translation([10, -7, 3])
    assert moved.volume == pytest.approx(mesh.volume, rel=1e-9)
    manifest = yaml.safe_load((whole.folder / "run.yaml").read_text())
    assert all(entry["cpu_seconds"] > 0 and entry["peak_memory_mb"] < 2000 for entry in manifest["stages"].values())


def test_attitude_history_is_the_true_one(whole: Run, sequence: Path) -> None:
    """The run's attitudes and the truth differ by one fixed rotation of the body frame."""
    from massprops.dynamics.quaternion import angle_between, conjugate, multiply, normalise
    from massprops.sequence import read_sequence

    read, truth = read_sequence(whole.folder), read_truth(sequence)
    assert read.attitude is not None and truth is not None
    index = np.round(read.attitude.timestamp_ns / np.median(np.diff(read.attitude.timestamp_ns))).astype(int)
    q = truth.q[index - index[0]]
    offset = multiply(conjugate(read.attitude.q), q)
    offset *= np.sign(offset @ offset[0])[:, None]
    mean = normalise(offset.mean(axis=0))
    assert np.degrees(np.median(angle_between(offset, np.broadcast_to(mean, offset.shape)))) < 0.5


def test_killed_in_the_middle_and_continued_gives_the_same(whole: Run, sequence: Path, tmp_path: Path) -> None:
    scale = repr(whole.properties["scale"]["metres_per_unit"])
    command = [sys.executable, "-c", "from massprops_cli.main import main; main()", "reconstruct"]
    command += [str(sequence / "cam0" / "data"), "-o", str(tmp_path / "run"), "--scale", scale, "--threads", "2", "-q"]
    # without what the dense stage made; what is made of it is the same where its points are, and is kept
    shutil.copytree(whole.folder, tmp_path / "run")
    work = tmp_path / "run" / "work"
    shutil.rmtree(work / "dense")
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not (maps := [p for p in work.glob("dense.parts/*/*") if p.suffix != ".tmp"]):
        assert process.poll() is None
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    maps[0].write_bytes(maps[0].read_bytes()[:-1])
    assert (work / "sfm").is_dir() and not (work / "dense").is_dir()
    done = subprocess.run([*command, "--json"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "1 finished parts of dense were damaged, and were made again" in done.stderr
    assert not list(work.glob("*.parts"))
    for made in (whole.folder / "work" / "dense").iterdir():
        assert (work / "dense" / made.name).read_bytes() == made.read_bytes(), made.name
    again = json.loads(done.stdout)
    for key in ("volume", "center_of_mass", "inertia", "principal_moments"):
        assert np.allclose(again[key], whole.properties[key], rtol=1e-6, atol=1e-9), key


def test_other_scale_needs_no_new_reconstruction(whole: Run, sequence: Path) -> None:
    before = yaml.safe_load((whole.folder / "run.yaml").read_text())["stages"]
    scale = whole.properties["scale"]["metres_per_unit"]
    twice = reconstruct(sequence / "cam0" / "data", whole.folder, scale=2 * scale, threads=2)
    assert twice.properties["volume"] == pytest.approx(8 * whole.properties["volume"], rel=1e-9)
    assert np.allclose(twice.properties["inertia"], 32 * np.array(whole.properties["inertia"]), rtol=1e-9)
    after = yaml.safe_load((whole.folder / "run.yaml").read_text())["stages"]
    assert before["dense"] == after["dense"] and before["surface"] == after["surface"]
