"""What each mistake in filming costs: one asteroid, filmed well and then with one thing wrong at a time.

Prints the table of `docs/filming.md`. The footage is small (400x300), so that all of it takes some ten minutes; errors
are against the truth in per cent. `python -m pytest -s -m bench tests/bench/test_bench_filming.py` makes it again.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import massprops

pytestmark = pytest.mark.bench

WELL: dict[str, Any] = {"frames": 60, "size": (400, 300), "rate": 6.0, "seed": 11}
MISTAKES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "filmed well: 60 frames, 6 degrees apart": ({}, {}),
    "a third of the frames: 20, 18 degrees apart": ({"frames": 20, "rate": 18.0}, {}),
    "half a turn only: 30 frames, 6 degrees apart": ({"frames": 30}, {}),
    "the object fills a third of the image's height": ({"fill": 0.33}, {}),
    "the Sun far to the side: 90 degrees": ({"phase": 90.0}, {}),
    "dark and noisy: noise of 15 grey levels": ({"noise": 15.0}, {}),
    "the lens bends: k1 = -0.15": ({"distortion": (-0.15, 0.0)}, {}),
    "the length is given 2 % too large": ({}, {"scale": 1.02}),
}


def measured(folder: Path, name: str) -> str:
    """One row of the table."""
    filmed, given = MISTAKES[name]
    seen = massprops.simulate("asteroid", folder / "seq", **{**WELL, **filmed})
    facts = seen.truth.facts
    length = facts["greatest_length_m"] * given.get("scale", 1.0)
    run = massprops.reconstruct(seen.folder / "cam0" / "data", folder / "run", scale=length, motion="tumbling")
    if not (run.folder / "massprops.json").is_file():
        return f"| {name} | no answer: {run.reason} | | | |"
    error = 100 * (run.volume / facts["volume"] - 1)
    moments = 100 * (run.principal_moments / np.array(facts["principal_moments"]) - 1)
    low, high = run.interval["volume"]
    holds = "yes" if low <= facts["volume"] <= high else "no"
    wide = 50 * (high - low) / run.volume
    surface = 100 * run.properties["surface"]["observed_fraction"]
    worst = moments[np.argmax(np.abs(moments))]
    return f"| {name} | {surface:.0f} % | {error:+.1f} % | {worst:+.1f} % | ±{wide:.0f} %, {holds} | {run.confidence} |"


@pytest.mark.parametrize("name", MISTAKES)
def test_cost_of_a_mistake(name: str, tmp_path: Path) -> None:
    row = measured(tmp_path, name)
    print("\n" + row)
    if name == next(iter(MISTAKES)):
        assert "no answer" not in row and ", yes |" in row, "filmed well, the interval holds the truth"
