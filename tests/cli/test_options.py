"""The command line and the functions of the package have the same options; help, completion, log and progress."""

from __future__ import annotations

import inspect
import subprocess
import sys
from pathlib import Path

import pytest
from whole import massprops as command_line

import massprops
from massprops.run.duration import earlier_times, left_s
from massprops_cli.main import COMMANDS, load, run
from massprops_cli.progress import BEAT_S, StageProgress

VERBS = {
    **{name: name for name in ("reconstruct", "estimate", "crosscheck", "diagnose", "compare", "export", "simulate")},
    **{"mass": "mass_properties", "masks": "masks", "campaign": "campaign", "reproduce": "reproduce"},
}
OF_TERMINAL = {"json", "quiet", "help", "only", "open", "design"}
"""`--design` asks another question: in Python that is a function of its own."""
OF_PYTHON = {"progress", "rate_hz"}


@pytest.mark.parametrize("name", VERBS)
def test_options_have_the_same_names_and_defaults_as_in_python(name: str) -> None:
    verb = inspect.signature(getattr(massprops, VERBS[name])).parameters
    there = {}
    for parameter in load(name).params:
        long = [o for o in parameter.opts if o.startswith("--")]
        there[long[0][2:].replace("-", "_") if long else parameter.name] = parameter.default
    assert set(there) - OF_TERMINAL == set(verb) - OF_PYTHON
    for option in set(there) - OF_TERMINAL:
        ours = verb[option].default
        if ours is not inspect.Parameter.empty:
            assert there[option] == (None if ours == () else ours), option


def test_bare_massprops_shows_its_help_and_so_does_h(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([]) == 0
    said = capsys.readouterr()
    assert said.err == "" and all(f"\n  {name} " in said.out for name in COMMANDS)
    assert run(["-h"]) == 0 and capsys.readouterr().out == said.out
    assert run(["export", "-h"]) == 0 and "--to" in capsys.readouterr().out


@pytest.mark.parametrize("name", COMMANDS)
def test_usage_and_arguments_are_shown_plainly(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([name, "-h"]) == 0
    said = capsys.readouterr().out
    usage = said.splitlines()[0]
    assert usage.startswith(f"Usage: massprops {name} [OPTIONS]") and "[[" not in usage and "{" not in usage
    assert "list[" not in said, "a word of Python"


@pytest.mark.parametrize(("typed", "meant"), [("reconstrct", "reconstruct"), ("diagnos", "diagnose"), ("xyzzy", "")])
def test_a_mistyped_command_gets_the_nearest(capfd: pytest.CaptureFixture[str], typed: str, meant: str) -> None:
    said = command_line(capfd, typed, "-o", "x")
    assert said.code == 2 and len(said.lines) == 1 and "no such command" in said.err
    assert (f"did you mean {meant}?" in said.err) == bool(meant)


def complete(*words: str) -> list[str]:
    code = "from massprops_cli.main import main; main()"
    environment = {"COMP_WORDS": " ".join(["massprops", *words]), "COMP_CWORD": str(len(words))}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False,
        env={**environment, "_MASSPROPS_COMPLETE": "complete_bash", "PATH": ""},
    )  # fmt: skip
    return done.stdout.split()


def test_commands_and_options_are_completed(capsys: pytest.CaptureFixture[str]) -> None:
    assert complete("recon") == ["reconstruct"]
    assert set(complete("reconstruct", "--dens")) == {"--dense-views", "--density"}
    for shell in ("bash", "zsh", "fish"):
        assert run(["completion", shell]) == 0
        assert "_MASSPROPS_COMPLETE" in capsys.readouterr().out
    assert run(["completion", "tcsh"]) == 2


def test_v_says_what_is_done_wherever_it_stands(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    code = "import sys; from massprops_cli.main import run; sys.exit(run(sys.argv[1:]))"
    said = {}
    for flags in ((), ("-v",), ("-vv",)):
        done = subprocess.run(
            [sys.executable, "-c", code, "simulate", "tracks", "-o", f"seq{len(said)}", "--frames", "20", "-q", *flags],
            cwd=tmp_path, capture_output=True, text=True, check=True,
        )  # fmt: skip
        said[flags] = done.stderr
    assert said[()] == "" and "wrote" in said[("-vv",)]


def test_off_a_terminal_a_long_stage_says_that_it_lives(capsys: pytest.CaptureFixture[str]) -> None:
    clock = [0.0]
    watch = StageProgress(quiet=False, now=lambda: clock[0])
    watch("surface", 4, 9, 0, 0, "")
    for _ in range(2 * int(BEAT_S) + 1):
        clock[0] += 1.0
        watch.beat()
    lines = capsys.readouterr().err.splitlines()
    assert [line.split()[0] for line in lines] == ["0.0", "10.0", "20.0"]
    assert all("[5/9] surface" in line for line in lines)


def test_a_finished_part_of_a_stage_is_said_to_be_finished(capsys: pytest.CaptureFixture[str]) -> None:
    clock = [0.0]
    watch = StageProgress(quiet=False, now=lambda: clock[0])
    for done in (1, 40):
        watch("sfm", 1, 14, done, 40, "depth maps")
        clock[0] += BEAT_S
        watch.beat()
    lines = capsys.readouterr().err.splitlines()
    assert "depth maps 1/40" in lines[1] and lines[2].endswith("[2/14] sfm depth maps done")


def test_the_time_left_comes_from_earlier_runs_at_this_runs_speed() -> None:
    earlier = [{"capture": 10.0, "sfm": 20.0, "dense": 30.0}]
    assert left_s(earlier, {}, "capture", 4.0) == pytest.approx(56.0)
    assert left_s(earlier, {"capture": 20.0}, "sfm", 10.0) == pytest.approx(30.0 + 60.0), "this run is twice as slow"
    assert left_s(earlier, {"capture": 0.0, "sfm": 20.0}, "dense", 50.0) == 0.0, "a stage kept tells no speed"
    assert left_s([], {}, "capture", 0.0) is None and left_s(earlier, {}, "other", 0.0) is None
    assert left_s([*earlier, {"sfm": 2.0}, {"sfm": 4.0}], {}, "sfm", 0.0) == 4.0


def test_earlier_runs_are_those_beside(tmp_path: Path) -> None:
    for name, text in {
        "a": "stages: {capture: {seconds: 3.5, status: done}, sfm: {seconds: 1, status: failed}}",
        "b": "stages: [",
        "c": "stages: {}",
    }.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.yaml").write_text(text)
    assert earlier_times(tmp_path / "new") == [{"capture": 3.5}]


def test_estimate_and_diagnose_print_without_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    massprops.simulate("tracks", tmp_path / "seq", frames=120, seed=3)
    before = sorted(tmp_path.rglob("*"))
    assert run(["estimate", str(tmp_path / "seq"), "--method", "momentum-ls", "-q"]) == 0
    said = capsys.readouterr()
    assert "momentum-ls" in said.out and "report:" not in said.out
    assert sorted(tmp_path.rglob("*")) == before


def test_effects_are_listed_with_what_their_parameters_mean(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["effects"]) == 0
    said = capsys.readouterr().out
    assert "A mass rests at `arm`" in said, "a note"
    assert "(100 in all)" in said and "push_12_y" not in said, "of a hundred parameters the first"
