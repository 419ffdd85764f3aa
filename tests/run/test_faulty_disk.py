"""Whole commands, each process and library of them, on a disk that fails or struck by signals: the same command
afterwards gives the same bytes.

The changes of the disk are counted by a library that is loaded before all others (`tests/core/shim.c`), in every
process of the command. A power cut takes, besides, the data of every file that was not brought to the disk.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from massprops.run.stages import ORDER

sys.path.insert(0, str(Path(__file__).parents[1] / "core"))
from faults import quick_disk, tree
from shim import COMMAND, Faulty
from warm import Warm

KINDS = ("ENOSPC", "EIO", "kill", "power")
SAMPLES = int(os.environ.get("SAMPLES", "1"))
"""Changes of a reconstruction from the beginning that fail, in each of the ways: most of some 3400 are those of a database."""
EVERY = int(os.environ.get("EVERY", "1"))
"""Of a campaign and a diagnosis every so many changes fail: 1 in every way, more in one way after the other."""
STAGES = tuple(os.environ.get("STAGES", " ".join(ORDER)).split())
"""Of a reconstruction, those that are struck."""
TIMES = re.compile(r"\d[\d.]*(?: ?µs| ?us| ?ms| ?s| ?MB)\b")
SHOWN_TIMES = re.compile(rf"<td class=n>[\d.]+</td>|width:[\d.]+%|{TIMES.pattern}")
"""As a report shows them: its table of stages, and bars beside."""
UNREAD = re.compile(r"work/[^/]*\.tmp-[^/]*(/.*)?|work/\.[^/]*\.(old|tmp)(/.*)?|.*\.log|.*\.request\.json")
"""In a run folder: what the next run removes before anything else, and what no run reads."""

Results = Callable[[Path], dict[str, Any]]


def of_campaign(out: Path) -> dict[str, Any]:
    """What a campaign came to, with its rows but for the time they took."""
    base = sqlite3.connect(out / "runs.sqlite")
    rows = base.execute("SELECT point, seed, data, error FROM runs ORDER BY point, seed").fetchall()
    base.close()
    return {"rows": rows, **{n: (out / n).read_bytes() for n in ("table.json", "runs.csv", "campaign.yaml")}}


def of_diagnosis(out: Path) -> dict[str, Any]:
    return {n: TIMES.sub("", b.decode()) for n, b in tree(out).items() if not n.startswith(".massprops")}


def of_files(out: Path) -> dict[str, Any]:
    """Everything that a short command wrote, but its record, in which the order of entries may differ."""
    return {n: b for n, b in tree(out).items() if not n.startswith(".massprops")}


def of_run(out: Path) -> dict[str, Any]:
    """Everything in a run folder but logs, requests, times, and the hashes of the two files that tell times."""
    found: dict[str, Any] = {
        n: b for n, b in tree(out).items() if not n.endswith((".log", ".request.json", "outputs.json"))
    }
    manifest = yaml.load(found.pop("run.yaml"), Loader=yaml.CSafeLoader)
    for entry in manifest["stages"].values():
        for key in ("seconds", "cpu_seconds", "peak_memory_mb"):
            entry.pop(key)
        if "facts" in entry:
            entry["facts"] = re.sub(r"cpu_us\w*': [\d.]+|'bytes': \d+", "", str(entry["facts"]))
    found["run.yaml"] = manifest
    crosscheck = json.loads(found.pop("crosscheck.json", b"{}"))
    for entry in crosscheck.get("estimators", []):
        entry.pop("cpu_us_per_step", None)
    found["crosscheck.json"] = crosscheck
    found["report.html"] = SHOWN_TIMES.sub("", found.get("report.html", b"").decode())
    return found


def left_behind(out: Path) -> str:
    """sha256 of all in a run folder that a further run can read.

    What it removes before it reads anything (the runner's `_claim`), logs and requests are left out, and times are taken
    out of what tells them, as their hashes are: of these it matters whether they agree with the file.
    """
    total = hashlib.sha256()
    for name, content in tree(out).items():
        if UNREAD.fullmatch(name):
            continue
        if name == ".massprops/outputs.json":
            content = _with_agreement(out, content)
        elif name.endswith((".html", ".json", ".yaml")):
            content = SHOWN_TIMES.sub(
                "", re.sub(r"(seconds|peak_memory_mb|cpu_us\w*)\W+[\d.e-]+", "", content.decode())
            ).encode()
        total.update(f"{name} {len(content)} ".encode() + content)
    return total.hexdigest()


def _with_agreement(out: Path, content: bytes) -> bytes:
    """The list of outputs with, in place of each hash, whether it is that of the file."""
    try:
        told = json.loads(content)
    except ValueError:
        return content
    for name, entry in told["files"].items():
        path = out / name
        entry["sha256"] = path.is_file() and entry["sha256"] in (None, hashlib.sha256(path.read_bytes()).hexdigest())
    return json.dumps(told).encode()


def one_fault(
    faulty: Faulty,
    out: Path,
    command: list[str],
    n: int,
    kind: str,
    whole: dict[str, Any],
    results: Results,
    code: int = 0,
    earlier: Sequence[str] = (),
    known: set[str] | None = None,
) -> bool:
    """The command with its n-th change failing, then as it is; a power cut takes the files named besides.

    Args:
        known: folders, as `left_behind` tells them, from which the same command came to the whole results. The second
            command is left out where the first one left such a folder.

    Returns:
        whether the second command ran.
    """
    done = faulty(out, command, n, "kill" if kind == "power" else kind)
    where = f"change {n}, {kind}"
    if kind == "power":
        faulty.cut_power(out, earlier)
    if done.returncode >= 0:  # a failure is told in one line after the warnings, or was made good
        assert done.returncode in (0, 2, 3), (where, done.stderr)
        assert "Traceback" not in done.stderr and "unexpected" not in done.stderr, (where, done.stderr)
        told = [line for line in done.stderr.splitlines() if line.startswith("massprops: ")]
        assert len(told) == (done.returncode != 0), (where, done.stderr)
    left = "" if known is None else left_behind(out)
    if known is not None and left in known:
        return False
    again = faulty(out, command)
    assert again.returncode == code, (where, done.stderr, again.stderr)
    found = results(out)
    assert sorted(found) == sorted(whole), where
    for name in whole:
        assert found[name] == whole[name], (where, name, done.stderr, again.stderr)
    if known is not None:
        known.add(left)
    return True


@pytest.fixture
def faulty(tmp_path: Path) -> Faulty:
    return Faulty(tmp_path / "shim")


def sweep(
    place: Path, faulty: Faulty, command: list[str], results: Results, chosen: list[tuple[int, str]] | None
) -> int:
    """A command that begins in an empty folder, with each chosen change failing; None: every one in every way."""
    whole_out, out = place / "whole" / "out", place / "out"  # a page tells the name of its folder
    done = faulty(whole_out, [*command, "-o", str(whole_out)])
    assert done.returncode == 0, done.stderr
    count, whole = faulty.count, results(whole_out)
    if chosen is None:
        ways = [[kind] for kind in KINDS] if EVERY > 1 else [KINDS]
        chosen = [(n, kind) for k, n in enumerate(range(1, count + 1, EVERY)) for kind in ways[k % len(ways)]]
    for n, kind in chosen:
        one_fault(faulty, out, [*command, "-o", str(out)], n, kind, whole, results)
        shutil.rmtree(out)
        print(f"{command[0]}: change {n} of {count}, {kind}", flush=True)
    return count


def study(folder: Path) -> list[str]:
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump({"kind": "drill", "runs": 4, "chunk": 2, "fails": 0.3}))
    return ["campaign", str(path), "-q", "--workers", "1"]


def test_a_campaign(tmp_path: Path, faulty: Faulty) -> None:
    """Four of some hundred changes; `make bench` takes every one."""
    with quick_disk(tmp_path) as place:
        chosen = [(12, "power"), (34, "ENOSPC"), (55, "kill"), (80, "EIO")]
        assert sweep(place, faulty, study(tmp_path), of_campaign, chosen) > 80


@pytest.mark.bench
def test_a_campaign_at_every_change(tmp_path: Path) -> None:
    command = study(tmp_path)
    with quick_disk(tmp_path) as place, Warm(tmp_path / "shim", [*command, "-o", str(tmp_path / "first")]) as warm:
        print(f"campaign: {sweep(place, warm, command, of_campaign, None)} changes, {len(KINDS)} ways each")


@pytest.mark.bench
def test_a_diagnosis_at_every_change(tmp_path: Path) -> None:
    """The search is done once: it changes nothing on the disk."""
    from massprops.sequence import write_sequence
    from massprops.simulation.track_scenario import TrackScenario
    from massprops.simulation.tracks import simulate_tracks

    write_sequence(tmp_path / "seq", simulate_tracks(TrackScenario(frames=40, features=6, seed=3)).sequence)
    command = ["diagnose", str(tmp_path / "seq"), "-q"]
    first, search = [*command, "-o", str(tmp_path / "first")], "massprops.diagnosis.search.diagnose:diagnose_problem"
    with quick_disk(tmp_path) as place, Warm(tmp_path / "shim", first, (search,)) as warm:
        print(f"diagnose: {sweep(place, warm, command, of_diagnosis, None)} changes, {len(KINDS)} ways each")


@pytest.mark.bench
@pytest.mark.parametrize("verb", ["mass", "simulate", "compare"])
def test_a_short_command_at_every_change(tmp_path: Path, verb: str) -> None:
    import trimesh

    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / "box.stl")
    box = str(tmp_path / "box.stl")
    command = {"mass": [box], "simulate": ["tracks", "--frames", "12", "-q"], "compare": [box, box]}[verb]
    first = [verb, *command, "-o", str(tmp_path / "first")]
    with quick_disk(tmp_path) as place, Warm(tmp_path / "shim", first) as warm:
        print(f"{verb}: {sweep(place, warm, [verb, *command], of_files, None)} changes, {len(KINDS)} ways each")


@pytest.fixture(scope="module")
def footage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every stage runs on it, in some ten seconds in all."""
    from massprops.simulation import simulate

    out = tmp_path_factory.mktemp("footage") / "seq"
    return simulate("asteroid", out, frames=10, size=(200, 150), rate_deg=8.0, seed=1) / "cam0" / "data"


def reconstruct(footage: Path, out: Path) -> list[str]:
    return ["reconstruct", str(footage), "-o", str(out), "-q", "--scale", "1", "--threads", "1"]


@pytest.mark.bench
def test_a_reconstruction_from_the_beginning(tmp_path: Path, faulty: Faulty, footage: Path) -> None:
    """`SEED` chooses other changes."""
    rng = np.random.default_rng(int(os.environ.get("SEED", "17")))
    with quick_disk(tmp_path) as place:
        out = place / "out"
        code = faulty(out, reconstruct(footage, out)).returncode
        count, whole = faulty.count, of_run(out)
        assert set(whole["run.yaml"]["stages"]) == set(ORDER)
        shutil.rmtree(out)
        print(f"reconstruct: {count} changes, {SAMPLES} of them in {len(KINDS)} ways", flush=True)
        for n in rng.integers(1, count + 1, SAMPLES * len(KINDS)).reshape(SAMPLES, -1).tolist():
            for at, kind in zip(n, KINDS, strict=True):
                one_fault(faulty, out, reconstruct(footage, out), at, kind, whole, of_run, code)
                shutil.rmtree(out)
                print(f"reconstruct: change {at}, {kind}", flush=True)


def strike(process: subprocess.Popen[str], how: str) -> None:
    """A signal to a command: to all of its processes, to itself, or to its stage alone."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    if how == "kill all":
        os.killpg(process.pid, signal.SIGKILL)
    elif how == "terminate":
        process.terminate()
    elif how == "kill the stage":
        for pid in children.read_text().split():
            os.kill(int(pid), signal.SIGKILL)
    else:
        os.killpg(process.pid, signal.SIGSTOP)
        time.sleep(0.2)
        os.killpg(process.pid, signal.SIGCONT)


@pytest.mark.bench
def test_signals_at_random_moments_of_every_stage(tmp_path: Path, footage: Path) -> None:
    """Two commands at once on the folder besides: the second is refused, and told who the first one is."""
    rng = np.random.default_rng(int(os.environ.get("SEED", "18")))
    refused = 0
    with quick_disk(tmp_path) as place:
        base, out = place / "whole" / "out", place / "out"  # a page tells the name of its folder
        command = [*COMMAND, *reconstruct(footage, out)]
        begun = time.monotonic()
        code = subprocess.run([*COMMAND, *reconstruct(footage, base)], capture_output=True, check=False).returncode
        assert code in (0, 3)
        whole = of_run(base)
        entries = yaml.load((base / "run.yaml").read_text(), Loader=yaml.CSafeLoader)["stages"]
        spent = sum(entry["seconds"] for entry in entries.values())
        start = time.monotonic() - begun - spent  # of the command itself
        for stage in STAGES:
            for how in ("kill all", "terminate", "kill the stage", "stop and go on"):
                shutil.copytree(base, out)
                shutil.rmtree(out / "work" / stage)
                process = subprocess.Popen(
                    command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
                )
                time.sleep(rng.uniform(0.2, 1.0) * (start + entries[stage]["seconds"]))
                if rng.random() < 0.3:
                    second = subprocess.run(command, capture_output=True, text=True, check=False)
                    if f"(process {process.pid})" in second.stderr:
                        assert second.returncode == 2
                        refused += 1
                if process.poll() is None:
                    strike(process, how)
                said = process.communicate()[1]
                where = f"{stage}, {how}: {said}"
                assert process.returncode in (0, 2, 3, -signal.SIGKILL, -signal.SIGTERM) and "Traceback" not in said, (
                    where
                )
                again = subprocess.run(command, capture_output=True, text=True, check=False)
                assert again.returncode == code, (where, again.stderr)
                assert of_run(out) == whole, where
                shutil.rmtree(out)
            print(f"{stage}: struck in four ways", flush=True)
    print(f"{refused} second commands refused")
