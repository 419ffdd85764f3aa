"""Stage `shape`: which placements are one, as the object did not move between them."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from massprops.capture.placements import Placements
from massprops.run.stages import shape

LABEL = np.repeat([0, 1], 6)


@pytest.mark.parametrize(("handled", "one"), [(LABEL, False), (np.zeros(12, int), True)])
def test_what_hands_turned_in_a_pause_did_not_stand_though_its_paint_lies_where_it_lay(
    monkeypatch: pytest.MonkeyPatch, handled: np.ndarray, one: bool
) -> None:
    monkeypatch.setattr(shape, "pixel_size", lambda *_: 1.0)
    monkeypatch.setattr(shape, "placement_points", lambda *_: (None, None))
    monkeypatch.setattr("massprops.surface.same_place.colour_correlation", lambda *_: 0.56)
    placements = [{"label": k, "method": "measured"} for k in (0, 1)]
    divided = Placements(LABEL, handled)
    job: Any = SimpleNamespace(out=None)
    unused: Any = None
    found = shape._where_it_stood(job, unused, unused, LABEL, placements, divided)
    assert found.tolist() == ([0] * 12 if one else LABEL.tolist())


def test_what_stood_before_and_after_stood_between(monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a plain figure filmed once about (Blender): by what it hides three placements, of which two lay on each other."""
    label, times = np.repeat([0, 1, 2], [8, 6, 6]), np.arange(1, 21) * 10**9
    solved: list[list[int]] = []

    def solve(job: Any, views: Any, sparse: Any, label: np.ndarray, pointed: Any) -> Any:
        solved.append(np.bincount(label).tolist())
        return [{"label": k, "method": "measured"} for k in range(int(label.max()) + 1)], []

    monkeypatch.setattr(shape, "_solved", solve)
    monkeypatch.setattr("massprops.dense.region.region_of", lambda _: None)
    monkeypatch.setattr(shape, "_relabelled", lambda job, views, region, label, placements: label)
    monkeypatch.setattr(shape, "_where_it_stood", lambda *_: np.where(label == 2, 0, label))
    job: Any = None
    unsure = np.full(20, -1)
    found, placements, _ = shape._settled(
        job, None, None, (label, unsure), Placements(label, np.zeros(20, int)), times, []
    )  # type: ignore[arg-type]
    assert not found.any() and len(placements) == 1 and solved == [[8, 6, 6], [20]]
