"""The runner on small stages of its own: order, resume, kill -9, crashes, full disks, locks."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import pytest
import yaml

from massprops.core import outputs
from massprops.core.files import write_whole
from massprops.core.inputs import hash_input
from massprops.core.outputs import locked
from massprops.errors import InputError
from massprops.run.job import ReconstructOptions
from massprops.run.runner import Outcome, run_stages

STAGES = {
    "first": """
        READS, OPTIONS = (), ("frames",)
        def run(job):
            job.progress(1, 2, "half")
            (job.out / "n").write_text(str(job.options.frames))
            count(job, "first")
            return {"n": job.options.frames, "seed": job.seed}
    """,
    "second": """
        READS, OPTIONS = ("first",), ("density",)
        def run(job):
            count(job, "second")
            if (job.run / "die").exists():
                os.kill(os.getpid(), signal.SIGSEGV)
            if (job.run / "wait").exists():
                (job.out / "partial").write_text("x")
                (job.run / "waiting").write_text("x")
                time.sleep(600)
            if (job.run / "refuse").exists():
                raise NotPossible("nothing to be seen")
            if (job.run / "wrong").exists():
                raise InputError("the input is wrong")
            if (job.run / "full").exists():
                raise OSError(28, "No space left on device", str(job.out))
            if (job.run / "hungry").exists():
                bytearray(10**15)
            if (job.run / "bug").exists():
                raise KeyError("oops")
            job.warn("careful")
            value = float((job.work("first") / "n").read_text()) * (job.options.density or 1000.0)
            (job.out / "value").write_text(repr(value))
            return {"value": value, "partial": "half of it" if (job.run / "half").exists() else None}
    """,
    "crosscheck": """
        READS, OPTIONS = ("second",), ()
        def run(job):
            count(job, "crosscheck")
            if (job.run / "die").exists():
                os.kill(os.getpid(), signal.SIGKILL)
            if (job.run / "wrong").exists():
                raise InputError("no such thing")
            return {}
    """,
    "report": """
        READS, OPTIONS = ("second",), ()
        def run(job):
            (job.run / "page").write_text(str((job.run / "work" / "stopped.json").exists()))
            return {}
    """,
}
HEAD = """
import os, signal, time
from massprops.errors import InputError, NotPossible
def count(job, name):
    with (job.run / "calls").open("a") as f:
        f.write(name + " ")
"""
ORDER = ("first", "second", "report")


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    name = f"stages_{abs(hash(str(tmp_path))) % 10**8}"
    folder = tmp_path / name
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    for stage, body in STAGES.items():
        (folder / f"{stage}.py").write_text(HEAD + textwrap.dedent(body))
    monkeypatch.syspath_prepend(str(tmp_path))
    return name


@pytest.fixture
def run(tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    folder.mkdir()
    return folder


def go(run: Path, package: str, **options):  # type: ignore[no-untyped-def]
    return run_stages(run, ReconstructOptions(**options), {"a": "1"}, order=ORDER, package=package)


def calls(run: Path) -> list[str]:
    return (run / "calls").read_text().split()


def test_why_a_run_is_partial_is_written_by_the_next_command_where_it_is_missing(run: Path, package: str) -> None:
    """A disk that was full at that moment leaves everything but this file."""
    (run / "half").write_text("")
    stopped = run / "work" / "stopped.json"
    assert go(run, package).exit_code == 3
    before = json.loads(stopped.read_text())
    assert before == {"exit_code": 3, "reason": "half of it", "stage": "second"}
    stopped.unlink()
    assert go(run, package).exit_code == 3
    assert json.loads(stopped.read_text()) == before and calls(run) == ["first", "second"]
    stopped.write_text('{"exit_code": 2, "reason": "Input/output error", "stage": "second"}')
    assert go(run, package).exit_code == 3
    assert json.loads(stopped.read_text()) == before, "an error of the disk is over"


def test_finished_stages_are_not_run_again_and_options_reach_their_dependents_only(run: Path, package: str) -> None:
    first = go(run, package)
    assert first.exit_code == 0 and first.warnings == ["careful"]
    manifest = yaml.safe_load((run / "run.yaml").read_text())
    assert manifest["stages"]["second"]["facts"]["value"] == 120 * 1000.0
    assert manifest["stages"]["first"]["peak_memory_mb"] > 1 and manifest["versions"]["numpy"]
    go(run, package)
    assert calls(run) == ["first", "second"]
    go(run, package, density=2.0)
    assert calls(run) == ["first", "second", "second"]
    go(run, package, density=2.0, frames=10)
    assert calls(run) == ["first", "second", "second", "first", "second"]
    assert (run / "work/second/value").read_text() == "20.0"


def test_the_memory_of_a_stage_is_its_own(run: Path, package: str) -> None:
    """The system tells a child's peak from what its parent held at its start."""
    held = b"x" * 600_000_000
    found = go(run, package)
    assert 1 < found.stages["first"]["peak_memory_mb"] < 300 < len(held) / 1e6


@pytest.mark.parametrize("how", ["die", "wrong"])
def test_a_run_stands_without_an_extra_stage_which_is_tried_again(run: Path, package: str, how: str) -> None:
    order = ("first", "crosscheck", "report")

    def again() -> Outcome:
        return run_stages(run, ReconstructOptions(), {"a": "1"}, order=order, package=package)

    (run / how).touch()
    found = again()
    assert found.exit_code == 0 and found.stages["report"]["status"] == "done"
    assert found.warnings[-1].startswith("no crosscheck: ")
    (run / how).unlink()
    assert again().warnings == [] and again().exit_code == 0
    assert calls(run) == ["first", "crosscheck", "crosscheck"]


def test_what_had_to_do_without_an_extra_stage_is_made_again_with_it(run: Path, tmp_path: Path, package: str) -> None:
    """Three stages in a row: the page shows what the crosscheck left, and was kept without it."""
    (tmp_path / package / "middle.py").write_text(
        'READS, OPTIONS = ("crosscheck",), ()\ndef run(job):\n    return {}\n'
    )
    (tmp_path / package / "report.py").write_text(
        'READS, OPTIONS = ("middle",), ()\ndef run(job):\n'
        '    (job.run / "page").write_text(str((job.run / "work/crosscheck").exists()))\n    return {}\n'
    )

    def again() -> str:
        order = ("first", "crosscheck", "middle", "report")
        assert run_stages(run, ReconstructOptions(), {"a": "1"}, order=order, package=package).exit_code == 0
        return (run / "page").read_text()

    (run / "wrong").touch()
    assert again() == "False"
    (run / "wrong").unlink()
    assert again() == "True"
    (run / "page").write_text("kept")
    assert again() == "kept"


def test_a_changed_input_runs_everything_again(run: Path, package: str) -> None:
    go(run, package)
    run_stages(run, ReconstructOptions(), {"a": "2"}, order=ORDER, package=package)
    assert calls(run) == ["first", "second"] * 2


@pytest.mark.parametrize(
    ("flag", "code", "says"),
    [
        ("die", 3, "second died with SIGSEGV"),
        ("refuse", 3, "nothing to be seen"),
        ("wrong", 2, "the input is wrong"),
        ("full", 2, "No space left"),
        ("bug", 3, "KeyError"),
        ("hungry", 3, "not enough memory: fewer --frames"),
    ],
)
def test_failures_are_one_line_and_keep_what_was_done(run: Path, package: str, flag: str, code: int, says: str) -> None:
    (run / flag).touch()
    outcome = go(run, package)
    assert outcome.exit_code == code and says in outcome.reason and "\n" not in outcome.reason
    assert (run / "work/first/n").is_file() and not (run / "work/second").exists()
    if code == 3:
        assert (run / "page").read_text() == "True", "the report is still written"
    (run / flag).unlink()
    assert go(run, package).exit_code == 0
    assert calls(run).count("first") == 1
    assert (run / "page").read_text() == "False"


def command(run: Path, package: str, tmp_path: Path) -> str:
    """A program that runs the chain, for a process of its own."""
    return (
        # as from a terminal: what a shell starts in the background ignores SIGINT
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n"
        "from pathlib import Path\n"
        "from massprops.core.outputs import locked\n"
        "from massprops.run.runner import run_stages\n"
        "from massprops.run.job import ReconstructOptions\n"
        f"r = Path({str(run)!r})\n"
        "with locked(r):\n"
        f"    run_stages(r, ReconstructOptions(), {{'a': '1'}}, order={ORDER!r}, package={package!r})\n"
    )


@pytest.mark.parametrize("how", ["SIGKILL", "SIGTERM", "SIGINT", "SIGSTOP"])
def test_a_signal_and_the_same_command_again(run: Path, package: str, tmp_path: Path, how: str) -> None:
    """A stopped one is at work yet, and dies stopped."""
    (run / "wait").touch()
    process = subprocess.Popen([sys.executable, "-c", command(run, package, tmp_path)])
    while not (run / "waiting").exists():
        assert process.poll() is None
        time.sleep(0.02)
    with pytest.raises(InputError, match=rf"another massprops .*process {process.pid}\)"), locked(run):
        pass
    os.kill(process.pid, getattr(signal, how))
    if how == "SIGSTOP":
        with pytest.raises(InputError, match=rf"process {process.pid}\)"), locked(run):
            pass
        os.kill(process.pid, signal.SIGKILL)
    process.wait()
    (run / "wait").unlink()
    with locked(run):
        assert go(run, package).exit_code == 0
    assert not list((run / "work").glob("*.tmp-*")), "what the killed stage left is gone"
    assert (run / "work/second/value").read_text() == repr(120 * 1000.0)
    assert not (run / "work/second/partial").exists()
    assert calls(run) == ["first", "second", "second"]


@pytest.mark.skipif(sys.platform != "linux", reason="sees processes by /proc")
def test_a_stage_does_not_outlive_a_command_that_ends_as_it_starts(run: Path, package: str, tmp_path: Path) -> None:
    """The kernel ends a stage with its command only from the moment at which the stage asks for it.

    The stage is kept at its imports until the command has ended.
    """
    go_on, started = tmp_path / "go_on", tmp_path / "started"
    os.mkfifo(go_on)
    (tmp_path / "sitecustomize.py").write_text(
        "import os, sys\n"
        "if sys.orig_argv[-1].endswith('second.request.json'):\n"
        f"    open({str(started)!r}, 'w').write(str(os.getpid()))\n"
        f"    open({str(go_on)!r}).read()\n"
    )
    process = subprocess.Popen([sys.executable, "-c", command(run, package, tmp_path)])
    while not (started.exists() and started.read_text()):
        assert process.poll() is None
        time.sleep(0.01)
    process.terminate()
    process.wait()
    (tmp_path / "sitecustomize.py").unlink()
    orphan = Path(f"/proc/{started.read_text()}")
    assert orphan.exists(), "it is still importing"
    go_on.write_text("")
    with locked(run):  # waits for it: it might write until it ends
        assert calls(run) == ["first"], "it did nothing"
        assert not orphan.exists() or "Z" in (orphan / "stat").read_text().split()
        assert go(run, package).exit_code == 0
    assert calls(run) == ["first", "second"] and not list((run / "work").glob("*.tmp-*"))


def test_a_folder_stays_locked_as_long_as_a_child_of_a_dead_command_writes_into_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = (
        "import os, subprocess, sys\n"
        "from pathlib import Path\n"
        "from massprops.core.outputs import lock_to_pass, locked\n"
        "run = Path(sys.argv[1])\n"
        "with locked(run):\n"
        "    subprocess.Popen(['cat'], pass_fds=lock_to_pass(run), stdout=subprocess.DEVNULL)\n"
        "    os._exit(0)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdin=subprocess.PIPE)
    process.wait()
    assert process.stdin is not None
    monkeypatch.setattr(outputs, "ENDING_S", 0.1)
    with pytest.raises(InputError, match=rf"another massprops .*process {process.pid}\)"), locked(tmp_path):
        pass
    monkeypatch.setattr(outputs, "ENDING_S", 600.0)
    threading.Timer(0.1, process.stdin.close).start()  # its child ends
    with locked(tmp_path):
        assert process.stdin.closed


def test_a_lock_that_is_no_file_is_not_waited_for(tmp_path: Path) -> None:
    (tmp_path / ".massprops").mkdir()
    os.mkfifo(tmp_path / ".massprops" / "lock")
    with pytest.raises(InputError, match="lock: is a device or pipe"), locked(tmp_path):
        pass


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="choose another"), locked(tmp_path / "file"):
        pass
    if os.getuid() != 0:
        closed = tmp_path / "closed"
        closed.mkdir(mode=0o500)
        with pytest.raises(InputError, match="cannot be written"), locked(closed / "run"):
            pass


def test_truth_is_not_an_input(tmp_path: Path) -> None:
    (tmp_path / "truth").mkdir()
    (tmp_path / "truth" / "truth.yaml").write_text("secret")
    (tmp_path / "a.png").write_text("x")
    assert list(hash_input(tmp_path)) == ["a.png"]


def test_writing_is_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "x.json"
    write_whole(path, json.dumps({"a": 1}))

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_whole(path, "half")
    assert json.loads(path.read_text()) == {"a": 1}
    assert [p.name for p in tmp_path.iterdir()] == ["x.json"]


def test_stages_are_read_without_what_they_compute_with() -> None:
    """The runner asks every stage what it reads and takes before the first one runs."""
    code = (
        "import importlib, pkgutil, sys\nimport massprops.run.stages as stages\n"
        "for m in pkgutil.iter_modules(stages.__path__): importlib.import_module(f'massprops.run.stages.{m.name}')\n"
        "print([m for m in ('cv2', 'pycolmap', 'open3d', 'numba', 'scipy', 'trimesh', 'pymeshlab') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "[]"
