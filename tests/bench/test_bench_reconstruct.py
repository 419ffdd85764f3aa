"""The main job against truth. Prints truth, ours and the error; `make bench`. `MASSPROPS_BENCH_OUT` keeps the runs."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bench_footage import MOST, body, chosen, place, run_on, simulated

from massprops.exchange.compare import compare
from massprops.run.reconstruct import Run, reconstruct
from massprops.simulation import simulate

pytestmark = pytest.mark.bench

QUANTITIES = ("volume", "I1", "I2", "I3", "k1", "k2")


def one(folder: Path, scenario: str, **options: Any) -> tuple[Run, dict[str, dict], dict[str, Any], float]:
    """Simulates, reconstructs from the bare images with only the greatest length given, and compares."""
    images, truth = simulated(folder / "sequence", scenario, **options)
    run = reconstruct(images, folder / "run", scale=truth.facts["greatest_length_m"])
    if run.exit_code:
        return run, {}, {}, truth.facts["seen_lit_share"]
    found = compare(run.folder, folder / "sequence" / "truth" / "mesh.ply", free_scale=False)
    return run, {r["quantity"]: r for r in found.rows}, found.distances, truth.facts["seen_lit_share"]


def cpu(run: Run) -> float:
    stages = yaml.safe_load((run.folder / "run.yaml").read_text())["stages"]
    return sum(entry["cpu_seconds"] for entry in stages.values())


TUMBLING = ("scenario", "seed", "rate"), [("asteroid", 0, 5.0), ("spacecraft", 2, 4.5)]


@pytest.mark.parametrize(*TUMBLING)
def test_accuracy(tmp_path: Path, scenario: str, seed: int, rate: float) -> None:
    run, rows, distances, seen = one(
        place(tmp_path, f"{scenario}-{seed}"), scenario, seed=seed, frames=110, rate_deg=rate
    )
    assert run.exit_code == 0, run.reason
    observed = run.properties["surface"]["observed_fraction"]
    print(
        f"\n{scenario}, 110 frames 960x720, unknown focal length: {100 * observed:.1f} % measured ({100 * seen:.0f} % was seen lit)"
    )
    for q in QUANTITIES:
        r = rows[q]
        print(
            f"  {q:<8} truth {r['cad']:12.6g}  ours {r['ours']:12.6g}  error {r['error_text']:>10}  90 % holds: {r['holds']}"
        )
    median = distances["ours"]["median"] / distances["length"]
    print(f"  median surface distance {100 * median:.3f} % of the length; {cpu(run):.0f} s of CPU")
    well = observed >= 0.9
    assert abs(rows["volume"]["relative_error"]) < (0.01 if well else 0.02)
    assert max(abs(rows[f"I{i}"]["relative_error"]) for i in (1, 2, 3)) < (0.025 if well else 0.04)
    assert max(abs(rows[k]["error"]) for k in ("k1", "k2")) < 0.01
    assert median < 0.0015


@pytest.mark.parametrize(*TUMBLING)
def test_scatter_over_seeds(tmp_path: Path, scenario: str, seed: int, rate: float) -> None:
    """The same images with five seeds of the program: by how much its answers differ for their draws alone."""
    folder = place(tmp_path, f"{scenario}-{seed}-seeds")
    images, truth = simulated(folder / "sequence", scenario, seed=seed, frames=110, rate_deg=rate)
    length = truth.facts["greatest_length_m"]
    errors, holds = [], []
    for draw in range(5):
        run = reconstruct(images, folder / f"run-{draw}", scale=length, seed=draw)
        assert run.exit_code == 0, run.reason
        found = compare(run.folder, folder / "sequence" / "truth" / "mesh.ply", free_scale=False)
        rows = {r["quantity"]: r for r in found.rows}
        errors.append([rows[q]["error"] if q.startswith("k") else 100 * rows[q]["relative_error"] for q in QUANTITIES])
        holds.append([rows[q]["holds"] for q in QUANTITIES])
    print(f"\n{scenario}, 110 frames 960x720, five seeds: errors in per cent, of k1 and k2 as they are")
    for name, values, held in zip(QUANTITIES, np.transpose(errors), np.transpose(holds), strict=True):
        each = " ".join(f"{v:+8.3f}" for v in values)
        print(
            f"  {name:<8} {each}   mean {values.mean():+.3f}  1 sigma {values.std(ddof=1):.3f}  holds {held.sum()} of 5"
        )
    assert np.all(holds)


def test_intervals_hold_the_truth(tmp_path: Path) -> None:
    """Half of the bodies well shown, half partly, under different light."""
    held, lines, wide = [], [], []
    for name, seed, options in chosen("uniform", MOST // 2) + chosen("partly", MOST // 2):
        run, truth = run_on(place(tmp_path, name), seed, options)
        if run.exit_code and not run.properties:
            lines.append(f"  {name:<14} no result: {run.reason}")
            held.append([False] * len(QUANTITIES))
            continue
        found = compare(run.folder, place(tmp_path, name) / "sequence" / "truth" / "mesh.ply", free_scale=False)
        rows = {r["quantity"]: r for r in found.rows}
        width = np.ptp(run.properties["interval_90"]["volume"]) / run.properties["volume"] / 2
        seen = run.properties["surface"]["observed_fraction"]
        wide += [width] if seen >= 0.9 else []
        held.append([bool(rows[q]["holds"]) for q in QUANTITIES])
        lines.append(
            f"  {name:<14} {body(seed):<11}measured {100 * seen:5.1f} %  volume {rows['volume']['error_text']:>9}"
            f"  interval +-{100 * width:.1f} %  misses: {' '.join(q for q in QUANTITIES if not rows[q]['holds']) or '-'}"
        )
        print(lines[-1], flush=True)
    share = dict(zip(QUANTITIES, np.sum(held, axis=0).tolist(), strict=True))
    print("\n".join(["", *lines, f"  of {len(held)} held: {share} (wanted 16 of 20 of the volume)"]))
    print(f"  widest volume interval where 90 % was measured: +-{100 * max(wide, default=0):.1f} % (wanted 8)")
    assert share["volume"] >= 0.8 * len(held)


@pytest.mark.parametrize("masks", [True, False])
def test_axe(tmp_path: Path, real_data: Path, masks: bool) -> None:
    run = reconstruct(
        real_data / "axe" / "images",
        place(tmp_path, f"axe-{masks}"),
        max_size=1200,
        masks=str(real_data / "axe" / "masks") if masks else None,
    )
    print(f"\naxe, masks {masks}: exit {run.exit_code} {run.reason}")
    if run.exit_code == 0:
        p = run.properties
        print(
            f"  registered {p['images']['registered']} of {p['images']['given']}, volume {p['volume']:.6g} length^3, k1 {p['inertia_ratios']['k1']:.4f}, k2 {p['inertia_ratios']['k2']:.4f}, {cpu(run):.0f} s of CPU"
        )
    assert run.exit_code == 0


def test_time_against_colmap(tmp_path: Path) -> None:
    """150 frames against the Debian colmap's sparse reconstruction of the same frames."""
    sequence = simulate("asteroid", tmp_path / "seq", frames=150, rate_deg=4.0, seed=0)
    begun, used = time.monotonic(), _children()
    reconstruct(sequence / "cam0" / "data", tmp_path / "run", frames=150)
    ours, ours_cpu = time.monotonic() - begun, _children() - used
    database, images = tmp_path / "db.db", sequence / "cam0" / "data"
    (tmp_path / "sparse").mkdir()
    gpu = ["--SiftExtraction.use_gpu", "0"], ["--SiftMatching.use_gpu", "0"]
    steps = [
        [
            "feature_extractor",
            "--database_path",
            str(database),
            "--image_path",
            str(images),
            "--ImageReader.single_camera",
            "1",
            *gpu[0],
        ],
        ["sequential_matcher", "--database_path", str(database), *gpu[1]],
        [
            "mapper",
            "--database_path",
            str(database),
            "--image_path",
            str(images),
            "--output_path",
            str(tmp_path / "sparse"),
        ],
    ]
    begun, used = time.monotonic(), _children()
    for step in steps:
        try:
            subprocess.run(
                ["colmap", *step], check=True, capture_output=True, env={**os.environ, "QT_QPA_PLATFORM": "offscreen"}
            )
        except FileNotFoundError:
            pytest.skip("colmap is not installed here; Debian's package gives it")
    theirs, theirs_cpu = time.monotonic() - begun, _children() - used
    print(
        f"\n150 frames 960x720: the whole job {ours:.0f} s ({ours_cpu:.0f} s of CPU), colmap sparse only {theirs:.0f} s "
        f"({theirs_cpu:.0f} s of CPU), ratio {ours / theirs:.2f} in time, {ours_cpu / theirs_cpu:.2f} in CPU (wanted at most 2)"
    )


def _children() -> float:
    """CPU seconds of finished child processes."""
    t = os.times()
    return t.children_user + t.children_system


def test_growth_with_frames(tmp_path: Path) -> None:
    """CPU of the whole job at 60, 120 and 240 frames of the same motion."""
    rows = []
    for frames in (60, 120, 240):
        sequence = simulate("asteroid", tmp_path / f"seq{frames}", frames=frames, rate_deg=4.0, size=(640, 480), seed=0)
        used = _children()
        reconstruct(sequence / "cam0" / "data", tmp_path / f"run{frames}", frames=frames)
        rows.append((frames, _children() - used))
        print(f"\n{frames} frames 640x480: {rows[-1][1]:.0f} s of CPU", flush=True)
    power = float(np.polyfit(np.log([r[0] for r in rows]), np.log([r[1] for r in rows]), 1)[0])
    print(f"growth N^{power:.2f} (wanted at most N^1.3)")
