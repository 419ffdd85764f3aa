"""Drag by the rate or by its square: told apart where the record is long enough, said where it is not."""

from __future__ import annotations

import numpy as np
import pytest
from diagnosis.test_momentum_balance import tumble

from massprops.diagnosis.candidate import Candidate
from massprops.diagnosis.effect_search import admissible, again, best_fit
from massprops.diagnosis.record import record_of_rates
from massprops.diagnosis.selection import _with_other_laws, usable_effects
from massprops.diagnosis.unnamed import without_effects
from massprops.effects import effects

DRAG = np.array([0.02, 0.05, 0.03])


def tried(square: bool, seconds: float) -> list[Candidate]:
    """Drag by the rate with what its other laws add, on a record of drag by its square, or of as much by the rate."""

    def torque(t: float, w: np.ndarray) -> np.ndarray:
        return -DRAG * (w * np.abs(w) if square else 8.0 * w)

    record = record_of_rates(tumble(torque=torque, seconds=seconds))
    base, _ = without_effects(record)
    alone = best_fit(record, effects()["drag-by-axis"], base)
    assert alone is not None
    beside = admissible(record, alone.hypothesis, again(alone), latent=True)
    return _with_other_laws(record, base, [Candidate(alone=alone, with_latent=beside)])


def test_the_square_of_the_rate_takes_part_where_it_is_likelier() -> None:
    linear, square = tried(True, 2.0)
    assert square.name == "drag-by-rate-squared" and square.evidence > linear.evidence + 5.0
    np.testing.assert_allclose(square.alone.values[square.name], DRAG, rtol=0.15)


@pytest.mark.parametrize(("square", "seconds", "said"), [(False, 2.0, ()), (True, 0.15, ("drag-by-rate-squared",))])
def test_else_the_rate_stands_for_both(square: bool, seconds: float, said: tuple[str, ...]) -> None:
    (linear,) = tried(square, seconds)
    assert linear.name == "drag-by-axis" and linear.alike == said


def test_other_laws_take_no_part_by_themselves() -> None:
    record = record_of_rates(tumble(seconds=0.4))
    assert "drag-by-rate-squared" not in {m.NAME for m in usable_effects(record)[0]}
