"""Effect files of a user's own: what one may be, and the one line that each kind of bad one gets."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from massprops.effect_contract import faults, superposes
from massprops.effect_file import read_effect, with_effects
from massprops.effects import catalogue, effects
from massprops.errors import InputError, NotPossible

HEAD = """
from massprops.effects import Parameter
NAME = "my-torque"
SENTENCE = "Something pushes."
PARAMETERS = (Parameter("size", "rad s^-2", 1e-4),)
NEEDS = ()
"""
GOOD = HEAD + "def torque(t, q, w, p, inertia, environment):\n    return p[0] * w[0], 0.0 * p[0], p[0]\n"


def written(folder: Path, text: str, name: str = "mine.py") -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", catalogue())
def test_every_effect_of_the_catalogue_keeps_the_contract(name: str) -> None:
    effect = catalogue()[name]
    assert faults(effect) == "" and effect.FORMULA


def test_linearity_is_found_by_trying() -> None:
    assert superposes(catalogue()["drag-by-axis"]) and superposes(catalogue()["eddy-current-torque"])


def test_a_good_file_acts_and_is_forgotten_afterwards(tmp_path: Path) -> None:
    from massprops.simulation.track_scenario import TrackScenario
    from massprops.simulation.tracks import simulate_tracks

    with with_effects([written(tmp_path, GOOD)]):
        assert "my-torque" in effects()
        sensor = {"features": 0, "rate_sigma": 1e-5, "range_sigma_m": 0.0, "frames": 40}
        pushed = simulate_tracks(TrackScenario(**sensor, effects=("my-torque:size=1e-3",)))
        free = simulate_tracks(TrackScenario(**sensor))
        assert np.abs(pushed.truth["w"] - free.truth["w"])[-1].max() > 1e-3
    assert "my-torque" not in effects()


BAD = {
    "raises when loaded": ("1 / 0", "cannot be loaded: ZeroDivisionError"),
    "is no Python": ("def (", "cannot be loaded: SyntaxError"),
    "leaves by itself": ("raise SystemExit(0)", "cannot be loaded"),
    "ends the process": ("import os; os._exit(0)", "gave no result when tried"),
    "has no name": (GOOD.replace('"my-torque"', "7"), "NAME must be small letters"),
    "has no parameters": (GOOD.replace('(Parameter("size", "rad s^-2", 1e-4),)', "()"), "PARAMETERS must be"),
    "needs what nobody has": (GOOD.replace("NEEDS = ()", 'NEEDS = ("moon",)'), "NEEDS must be"),
    "does nothing": (HEAD, "none of the functions"),
    "raises": (HEAD + "def torque(t, q, w, p, inertia, environment):\n    raise OSError('no\\ngood')\n", "OSError: no"),
    "gives two numbers": (HEAD + "def torque(t, q, w, p, inertia, environment):\n    return p[0], p[0]\n", "3 components"),
    "gives another shape": (
        HEAD + "def torque(t, q, w, p, inertia, environment):\n    return [p[0], p[0], [[1.0, 2.0]]]\n", "finite numbers",
    ),
    "gives no number": (
        HEAD + "def torque(t, q, w, p, inertia, environment):\n    return p[0], p[0], float('nan')\n", "finite numbers",
    ),
    "has a prior of other parameters": (GOOD + "def momentum_prior():\n    return [[1.0], [2.0]]\n", "with 1 rows"),
    "has a prior that raises": (GOOD + "def momentum_prior():\n    return 1 / 0\n", "momentum_prior() fails: ZeroDiv"),
    "takes all memory": (HEAD + "x = bytearray(10**12)\n", "MemoryError"),
}  # fmt: skip


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_file_is_one_clear_line(tmp_path: Path, kind: str) -> None:
    text, said = BAD[kind]
    with pytest.raises(InputError) as caught:
        read_effect(written(tmp_path, text))
    line = str(caught.value)
    assert said in line and "mine.py" in line and "\n" not in line and len(line) < 500


def test_a_file_that_never_ends_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    endless = written(tmp_path, GOOD + "while True:\n    pass\n")
    with pytest.raises(InputError, match="it took more than 2 s when tried"):
        read_effect(endless, seconds=2.0)


def test_names_that_are_taken_and_files_that_are_none(tmp_path: Path) -> None:
    taken = written(tmp_path, GOOD.replace("my-torque", "impulse"))
    with pytest.raises(InputError, match="is an effect of the catalogue"), with_effects([taken]):
        pass
    twice = [written(tmp_path, GOOD), written(tmp_path, GOOD, "again.py")]
    with pytest.raises(InputError, match="another file has the NAME"), with_effects(twice):
        pass
    with pytest.raises(InputError, match="no such Python file"):
        read_effect(tmp_path / "absent.py")
    assert not [name for name in effects() if name not in catalogue()]


def test_a_file_that_fails_in_use_is_named(tmp_path: Path) -> None:
    text = (
        HEAD
        + "def torque(t, q, w, p, inertia, environment):\n    if t.real.max() > 1e3:\n        raise ValueError('late')\n"
    )
    text += "    return p[0], p[0], p[0]\n"
    late = written(tmp_path, text.replace("t.real.max()", "(t.max() if hasattr(t, 'max') else t.real)"))
    with (
        pytest.raises(NotPossible, match=r"my-torque failed: ValueError: late.*correct .*mine.py"),
        with_effects([late]) as found,
    ):
        found[0].torque(2e3, None, None, [0.0], None, None)


def test_a_file_that_never_ends_in_use_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (
        HEAD
        + "def torque(t, q, w, p, inertia, environment):\n    while p[0] == 7.0:\n        pass\n    return p[0], p[0], p[0]\n"
    )
    monkeypatch.setattr("massprops.effect_file.USE_SECONDS", 0.5)
    with (
        pytest.raises(
            NotPossible, match=r"my-torque failed: RuntimeError: a call of it takes more than 0.5 s.*mine.py"
        ),
        with_effects([written(tmp_path, text)]) as found,
    ):
        for _ in range(10**6):  # many short calls are no long one
            found[0].torque(0.0, None, None, [0.0], None, None)
        found[0].torque(0.0, None, None, [7.0], None, None)


def test_the_command_lists_and_refuses(tmp_path: Path) -> None:
    def run(*arguments: str) -> subprocess.CompletedProcess:
        command = [sys.executable, "-m", "massprops_cli.main", "effects", *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    done = run("--json", "--effect", str(written(tmp_path, GOOD)))
    listed = {e["name"]: e for e in json.loads(done.stdout)}
    assert set(catalogue()) < set(listed) and listed["my-torque"]["parameters"][0]["unit"] == "rad s^-2"
    bad = run("--effect", str(written(tmp_path, "1 / 0")))
    assert bad.returncode == 2 and len(bad.stderr.strip().splitlines()) == 1 and not bad.stdout


def test_effects_of_installed_packages(with_package: Callable[..., str]) -> None:
    """An entry point is known like a file of the catalogue; a bad one is left out and listed as such."""
    code = "from massprops.effects import effects, refused; print('my-torque' in effects(), list(refused().values()))"
    said = with_package("massprops.effects", code, good=GOOD, bad=GOOD.replace("return", "raise ValueError; return"))
    assert said.startswith("True") and "torque() fails on numbers: ValueError" in said
