"""Stage `shape`: which placements are one, as the object did not move between them."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from massprops.capture.placements import Placements
from massprops.run.stages import shape

LABEL = np.repeat([0, 1], 6)
NOTHING = np.zeros((12, 12))


@pytest.mark.parametrize(("handled", "one"), [(LABEL, False), (np.zeros(12, int), True), (np.zeros(0, int), True)])
def test_what_hands_turned_in_a_pause_did_not_stand_though_its_paint_lies_where_it_lay(
    monkeypatch: pytest.MonkeyPatch, handled: np.ndarray, one: bool
) -> None:
    monkeypatch.setattr(shape, "pixel_size", lambda *_: 1.0)
    monkeypatch.setattr(shape, "placement_points", lambda *_: (None, None))
    monkeypatch.setattr("massprops.surface.same_place.colour_correlation", lambda *_: 0.56)
    placements = [{"label": k, "method": "measured"} for k in (0, 1)]
    divided = Placements(LABEL, NOTHING, True, handled)
    job: Any = SimpleNamespace(out=None)
    unused: Any = None
    found = shape._where_it_stood(job, unused, unused, LABEL, placements, divided)
    assert found.tolist() == ([0] * 12 if one else LABEL.tolist())
