"""A user's own simulator: its parameters found, and one line for each way in which it can fail."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from massprops.diagnosis.black_box.fit import document_of_black_box, fit_black_box
from massprops.diagnosis.black_box.worker import Simulator
from massprops.errors import InputError, NotPossible
from massprops.model.problem import Problem, problem_of
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks

TOP = '''
import numpy as np
PARAMETERS = {"rate": (0.2, 0.1, "rad/s"), "brake": (0.0, 0.01, "1/s"), "idle": (1.0, 1.0, "")}


def spin(times, p):
    """A body that turns about z and is braked."""
    print("to nobody")
    rate = p["rate"] * np.exp(-p["brake"] * times)
    return {"rates": np.stack([0 * times, 0 * times, rate], axis=1)}
'''


@pytest.fixture(scope="module")
def problem() -> Problem:
    """Rates of a body that turns about z at 0.3 rad/s, braked by 0.02 /s."""
    made = problem_of(
        simulate_tracks(TrackScenario(features=0, rate_sigma=1e-3, range_sigma_m=0.0, frames=60)).sequence
    )
    t = made.times
    w = np.stack([0 * t, 0 * t, 0.3 * np.exp(-0.02 * t)], axis=1)
    return replace(made, rates=w + 1e-3 * np.random.default_rng(0).normal(size=w.shape), sigma_rate=1e-3)


def simulator(folder: Path, text: str = TOP, name: str = "spin") -> Simulator:
    path = folder / "mine.py"
    path.write_text(text)
    return Simulator(f"{path}:{name}")


def test_its_parameters_are_found(problem: Problem, tmp_path: Path) -> None:
    box = simulator(tmp_path)
    found = fit_black_box(box, problem)
    box.close()
    off = (found.values - [0.3, 0.02, 1.0]) / found.sigma
    assert np.abs(off[:2]).max() < 4 and found.sigma[0] < 1e-3 and np.isinf(found.sigma[2])
    assert 0.85 < np.sqrt(np.mean(found.residual**2)) < 1.15 and 0.85 < found.held_out < 1.2


def test_it_may_fail_for_some_parameters(problem: Problem, tmp_path: Path) -> None:
    picky = TOP.replace(
        "    rate = ", "    if p['rate'] > 0.35 or p['brake'] < 0:\n        raise ValueError('no')\n    rate = "
    )
    box = simulator(tmp_path, picky)
    found = fit_black_box(box, problem)
    box.close()
    assert found.failed > 0 and abs(found.values[0] - 0.3) < 4 * found.sigma[0]


FAILS = {
    "raises": ("    return", "    raise OSError('gone')\n    return", NotPossible, "fails with its own start values: OSError: gone"),
    "gives another shape": ("axis=1)}", "axis=1)[:3]}", NotPossible, "rates must be"),
    "gives what was not measured": (
        "    return", '    return {"attitude": np.ones((len(times), 4))}\n    return', InputError, "nothing that this sequence",
    ),
    "gives nothing that is known": ('{"rates"', '{"wishes"', NotPossible, "attitude, rates or tracks"),
    "never ends": ("    rate =", "    while True:\n        pass\n    rate =", NotPossible, "does not answer within 1 s"),
    "ends its process": ("    rate =", "    import os; os._exit(0)\n    rate =", NotPossible, "its process ended"),
}  # fmt: skip


@pytest.mark.parametrize("kind", FAILS)
def test_what_fails_in_use_is_one_clear_line(problem: Problem, tmp_path: Path, kind: str) -> None:
    old, new, error, said = FAILS[kind]
    box = simulator(tmp_path, TOP.replace(old, new))
    box.seconds = 1.0 if kind == "never ends" else 5.0
    with pytest.raises(error) as caught:
        fit_black_box(box, problem)
    box.close()
    assert said in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "name", "said"),
    [
        ("1 / 0", "spin", "cannot be loaded: ZeroDivisionError"),
        (TOP, "absent", "cannot be loaded: AttributeError"),
        (TOP.replace("(0.2, 0.1,", "(0.2, 0.0,"), "spin", "start must be finite"),
        ("import os; os._exit(1)", "spin", "its process ended"),
    ],
)
def test_what_cannot_be_loaded_is_one_clear_line(tmp_path: Path, text: str, name: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        simulator(tmp_path, text, name)
    assert said in str(caught.value) and "\n" not in str(caught.value)
    with pytest.raises(InputError, match="module:function"):
        Simulator("nothing")
    with pytest.raises(InputError, match=r"no such module; a file is FILE.py:function"):
        Simulator("mine_own:spin")


def test_parameters_that_the_record_does_not_show_have_no_number(problem: Problem, tmp_path: Path) -> None:
    """Two of which only the sum acts, and one that moves nothing but the last bits."""
    text = TOP.replace('"idle": (1.0, 1.0, "")', '"more": (0.0, 0.1, ""), "idle": (1.0, 1.0, "")')
    text = text.replace('p["rate"] *', '(p["rate"] + p["more"] + 1e-9 * np.sin(1e6 * p["idle"] * times)) *')
    box = simulator(tmp_path, text)
    found = fit_black_box(box, problem)
    document = document_of_black_box(box, found)
    box.close()
    assert abs(found.values[3] - 1.0) < 1e-6, "rounding leads nowhere"
    assert [k for k, v in document["parameters"].items() if v is None] == ["rate", "more", "idle"]
    assert np.isfinite(found.sigma[1]) and found.values[0] + found.values[2] == pytest.approx(0.3, abs=0.002)
