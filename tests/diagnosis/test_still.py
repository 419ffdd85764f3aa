"""A body that stands still: nothing to search in, and that is what is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprops.diagnosis.diagnose import diagnose_by_balance
from massprops.errors import NotPossible
from massprops.estimators.estimate import estimate_all
from massprops.sequence.data import AttitudeSeries, Sequence


def test_a_body_that_does_not_turn_is_named() -> None:
    t = np.arange(60, dtype=np.int64) * 10**8
    still = AttitudeSeries(t, np.tile([1.0, 0, 0, 0], (60, 1)), np.full(60, 1e-3))
    with pytest.raises(NotPossible, match="turns by 0 deg only"):
        diagnose_by_balance(Sequence(attitude=still))
    tilted = np.array([0.3, 0.5, -0.2, 0.79])
    found = estimate_all(Sequence(attitude=replace(still, q=np.tile(tilted / np.linalg.norm(tilted), (60, 1)))))
    assert not found.sound
    assert not found.estimates and "the body does not turn" in found.skipped["smoother"]
