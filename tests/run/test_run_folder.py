"""A run folder holds one run's results or none: refused inputs, failures, damage, faults at every write, strange folders."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from small_chain import FLAGS, converse, go, make_package

from massprops.core.outputs import verify
from massprops.errors import InputError
from massprops.run import runner
from massprops.run.reconstruct import Run

sys.path.insert(0, str(Path(__file__).parents[1] / "core"))
from faults import KINDS, failing, quick_disk, tree  # noqa: E402


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(runner._Chain, "_run_child", converse)
    FLAGS.clear()
    return make_package(tmp_path)


def results(run: Path) -> dict[str, object]:
    """Everything that a run leaves but times, logs and requests."""
    found: dict[str, object] = {n: b for n, b in tree(run).items() if not n.endswith((".log", ".request.json"))}
    manifest = yaml.load(found.pop("run.yaml"), Loader=yaml.CSafeLoader)  # type: ignore[arg-type]
    for entry in manifest["stages"].values():
        entry.pop("seconds")
        entry.pop("warnings")
    return {**found, "run.yaml": manifest}


def test_the_same_command_again_touches_nothing(tmp_path: Path, package: str) -> None:
    run = tmp_path / "run"
    assert go(run, package).exit_code == 0
    before = tree(run)
    again = go(run, package)
    assert again.exit_code == 0 and again.warnings == []
    assert tree(run) == before
    assert Run(run).properties == {"volume": 120000.0}


def test_an_input_that_is_refused_leaves_a_good_run_as_it_was(tmp_path: Path, package: str) -> None:
    run = tmp_path / "run"
    go(run, package)
    before = {n: b for n, b in tree(run).items() if not n.startswith("work/first.")}
    FLAGS.add("refuse")
    outcome = go(run, package, frames=10)
    assert (outcome.exit_code, outcome.reason) == (2, "the input is wrong")
    assert {n: b for n, b in tree(run).items() if not n.startswith("work/first.")} == before
    assert go(tmp_path / "fresh" / "run", package).exit_code == 2
    assert not (tmp_path / "fresh").exists(), "and nothing where nothing was"


def test_results_of_before_go_out_of_sight_when_the_new_run_fails(tmp_path: Path, package: str) -> None:
    run = tmp_path / "run"
    go(run, package)
    FLAGS.add("fail")
    outcome = go(run, package, frames=10)
    assert outcome.exit_code == 3 and "previous" in outcome.warnings[0]
    assert not (run / "mesh.ply").exists() and not (run / "massprops.json").exists()
    assert (run / "masks" / "a.png").read_text() == "10" and (run / "report.html").read_text() == "stopped: True"
    assert not (run / "work" / "second").exists(), "what later commands read of work/ is of this run"
    assert (run / ".massprops/previous/reconstruct/mesh.ply").read_text() == "120000.0"
    with pytest.raises(InputError, match="no massprops.json"):
        _ = Run(run).properties
    FLAGS.clear()
    assert go(run, package, frames=10).exit_code == 0
    assert Run(run).properties == {"volume": 10000.0}


@pytest.mark.parametrize("how", ["cut", "edited", "removed"])
@pytest.mark.parametrize("name", ["work/first/n", "work/second/value", "massprops.json", "masks/a.png", "report.html"])
def test_what_is_damaged_is_made_again_and_said(tmp_path: Path, package: str, name: str, how: str) -> None:
    run = tmp_path / "run"
    go(run, package)
    whole = results(run)
    content = (run / name).read_bytes()
    (run / name).unlink()
    if how != "removed":
        (run / name).write_bytes(content[:-1] if how == "cut" else content + b"1")
    if not name.startswith("work"):
        with pytest.raises(InputError, match="give that command again"):
            verify(run, name)
    outcome = go(run, package)
    assert outcome.exit_code == 0 and len(outcome.warnings) == 1 and "computed again" in outcome.warnings[0]
    assert results(run) == whole


@pytest.mark.parametrize("content", ["", "stages: [", "stages: {first: 3}", "[1, 2]", "stages: {first: {key: [1]}}"])
def test_a_damaged_run_yaml_costs_time_and_no_more(tmp_path: Path, package: str, content: str) -> None:
    run = tmp_path / "run"
    go(run, package)
    whole = results(run)
    (run / "run.yaml").write_text(content)
    assert go(run, package).exit_code == 0
    assert results(run) == whole


EVERY = [pytest.param((kind,), 1, marks=pytest.mark.bench) for kind in KINDS]


@pytest.mark.parametrize(("kinds", "step"), [(KINDS, 2), *EVERY])
def test_a_fault_at_any_write_costs_nothing_but_the_command(
    tmp_path: Path, package: str, kinds: tuple[str, ...], step: int
) -> None:
    """Of a first run, and of one with other options over it: the same command afterwards gives the same bytes.

    Every other write fails once, in one of the ways in turn; `make bench` lets every write fail in each.
    """
    with quick_disk(tmp_path) as place:
        go(place / "once", package)
        with failing() as disk:
            go(place / "whole", package)
            first = disk.count
            go(place / "whole", package, frames=10)
        assert 40 < first < disk.count < 250
        whole = results(place / "once")
        for n in range(1, first + 1, step):
            one_fault(place / "run", package, 120, n, kinds[n % len(kinds)], whole)
        whole = results(place / "whole")
        for n in range(1, disk.count - first + 1, step):
            shutil.copytree(place / "once", place / "run")
            one_fault(place / "run", package, 10, n, kinds[n % len(kinds)], whole)


def one_fault(run: Path, package: str, frames: int, n: int, kind: str, whole: dict[str, object]) -> None:
    with failing(n, kind):
        try:
            outcome = go(run, package, frames=frames)
            assert outcome.exit_code in (0, 2, 3) and "\n" not in outcome.reason
        except InputError:
            pass
    if (run / "massprops.json").exists() and (run / "mesh.ply").exists():
        try:
            verify(run, "massprops.json", "mesh.ply")
        except InputError as error:
            assert "give it again" in str(error)
        else:
            values = [json.loads((run / "massprops.json").read_text())["volume"], (run / "mesh.ply").read_text()]
            assert float(values[0]) == float(values[1]), "never the numbers of one beside the mesh of another"
    assert go(run, package, frames=frames).exit_code == 0, (n, kind)
    assert results(run) == whole, (frames, n, kind)
    shutil.rmtree(run)


def test_modules_of_the_current_folder_are_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not those of whoever recorded the footage, nor an innocent `random.py`, whatever PYTHONPATH says."""
    here = tmp_path / "here"
    here.mkdir()
    for name in ("av", "random", "cv2", "numpy", "json"):
        (here / f"{name}.py").write_text(
            f"open({str(tmp_path / 'run_by_mistake')!r}, 'w').write(__name__)\nraise SystemExit(7)\n"
        )
    code = (
        "import os, sys\n"
        f"os.chdir({str(here)!r})\n"
        "sys.path[:0] = ['', os.getcwd()]\n"
        "import subprocess\n"
        "from massprops.core.processes import child_environment, python_module\n"
        "done = subprocess.run(python_module('massprops.run.child', 'nothing.json'), env=child_environment(), "
        "capture_output=True, text=True)\n"
        "print(done.returncode, done.stderr[-60:])\n"
    )
    loads = "import json, random, subprocess, tempfile\n"  # of the standard library, before the folder leads
    done = subprocess.run(
        [sys.executable, "-P", "-c", loads + code], capture_output=True, text=True, check=True, env=dict(os.environ)
    )
    assert "No such file" in done.stdout and "nothing.json" in done.stdout, "it came as far as its own work"
    assert not (tmp_path / "run_by_mistake").exists()


def test_a_manifest_that_a_full_disk_kept_back_is_written_by_the_next_command(tmp_path: Path, package: str) -> None:
    """Every stage is done, and only what became of the run is not told yet."""
    run = tmp_path / "run"
    go(run, package)
    text = (run / "run.yaml").read_text()
    (run / "run.yaml").write_text(text.replace("exit_code: 0", "exit_code: 3"))
    assert go(run, package).exit_code == 0
    assert (run / "run.yaml").read_text() == text


def test_what_a_killed_command_was_writing_is_cleared_away(tmp_path: Path, package: str) -> None:
    run = tmp_path / "run"
    go(run, package)
    before = tree(run)
    (run / ".massprops" / ".outputs.json.123.tmp").write_text("half")
    assert go(run, package).exit_code == 0
    assert tree(run) == before


def test_an_error_of_the_disk_that_is_over_is_not_told_on_the_page(tmp_path: Path, package: str) -> None:
    """It came after the last stage but the page was done, so that this alone is left to make."""
    run = tmp_path / "run"
    go(run, package)
    (run / "work" / "stopped.json").write_text('{"exit_code": 2, "reason": "Input/output error", "stage": "second"}')
    shutil.rmtree(run / "work" / "report")
    assert go(run, package).exit_code == 0
    assert (run / "report.html").read_text() == "stopped: False" and not (run / "work" / "stopped.json").exists()


def test_results_of_a_stopped_run_are_not_called_of_other_inputs(tmp_path: Path, package: str) -> None:
    run = tmp_path / "run"
    FLAGS.add("fail")
    assert go(run, package).exit_code == 3
    FLAGS.clear()
    outcome = go(run, package)
    assert outcome.exit_code == 0 and outcome.warnings == []


@pytest.mark.parametrize("name", ["first.log", "first.parts", "first.parts/key", "second", "first.request.json"])
def test_links_in_work_lead_nowhere(tmp_path: Path, package: str, name: str) -> None:
    run, outside = tmp_path / "run", tmp_path / "outside"
    go(run, package)
    (outside / "kept").mkdir(parents=True)
    (outside / "kept" / "x").write_text("mine")
    link = run / "work" / name
    if link.is_dir():
        shutil.rmtree(link)
    link.unlink(missing_ok=True)
    link.parent.mkdir(exist_ok=True)
    link.symlink_to(outside / "kept" / "x" if name.endswith(("log", "json")) else outside)
    with pytest.raises(InputError, match="is a link, and no link is followed"):
        go(run, package, frames=10)
    assert [p.name for p in outside.rglob("*")] == ["kept", "x"] and (outside / "kept" / "x").read_text() == "mine"
