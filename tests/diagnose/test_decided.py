"""Which explanation is taken, and which others are said to be as good."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from massprops.diagnose.refit import Added, Scored
from massprops.diagnose.select import _decided
from massprops.effects import effects

NO_CASE: Any = None
NO_FIT: Any = None


def fitted(name: str, deviance: float, bic: float) -> Scored:
    return Scored((Added(effects()[name]),), NO_FIT, 1.0, 1.0, 0.0, deviance, bic, {name: np.zeros(0)})


def test_what_fits_no_worse_with_more_parameters_is_a_rival() -> None:
    damped, pushed = fitted("viscous-damping", 0.0, 9.0), fitted("constant-body-torque", -2.0, 25.0)
    assert _decided(NO_CASE, [pushed, damped]) == (damped, [pushed])
    worse = replace(pushed, deviance=1.0, bic=28.0)
    assert _decided(NO_CASE, [worse, damped]) == (damped, [])


def test_two_effects_are_no_rival_of_one() -> None:
    damped, pushed = fitted("viscous-damping", 0.0, 9.0), fitted("constant-body-torque", -2.0, 25.0)
    both = replace(damped, added=damped.added + pushed.added, deviance=-5.0, bic=31.0)
    assert _decided(NO_CASE, [both, damped]) == (damped, [])
