"""A wheel of any history along one axis."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from massprops.diagnosis import criteria
from massprops.diagnosis.candidate import Candidate
from massprops.diagnosis.conserved_start import conserved_across, with_mean_moment_about_axis, with_more_about_axis
from massprops.diagnosis.effect_search import again
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import SETTLED, HypothesisFit, fit_hypothesis
from massprops.diagnosis.record import Record
from massprops.diagnosis.unnamed import from_starts
from massprops.errors import NotPossible

LAGS = (0.02, 0.03, 0.045, 0.065, 0.1)
"""Time constants of a wheel tried, over the record's length: from what the knots of its drive can draw. On the odd flights,
whose wheel has one of about .07, evidence chose .03 to .045 and its size came within 7 % in 7 of 7; without a lag within
10 % in 5."""
VALLEY = (-0.3, -0.1, 0.1, 0.3, 0.6)
"""Moments about a wheel's axis, over the mean one, that are tried beside the one that a fit came to."""


def wheel_of_any_history(record: Record) -> Candidate:
    """A wheel of any history along one axis.

    Raises:
        NotPossible: no axis leads anywhere.
    """
    return wheel_followed(record, first_look_at_wheel(record))


def first_look_at_wheel(record: Record) -> Candidate:
    """A wheel that follows its drive at once beside a latent torque, which keeps it from answering for all, and one of a middle lag by
    itself, begun there.

    Raises:
        NotPossible: no axis leads anywhere.
    """
    start = conserved_across(record.path, record.rows.at)
    # the wheel answers for the moment about its axis: where its momentum changes least a ball may begin as a needle
    starts = [start, with_mean_moment_about_axis(start, record.path)]
    first = from_starts(record, Hypothesis(wheel=True), starts)
    alone = Hypothesis(wheel=True, latent=False, lag=float(np.median(LAGS)) * record.path.span)
    return Candidate(alone=fit_hypothesis(record, alone, again(first)), with_latent=first)


def wheel_followed(record: Record, look: Candidate) -> Candidate:
    """The wheel with the likeliest time constant of its drive, beside a latent torque first.

    Raises:
        NotPossible: the wheel by itself leads nowhere.
    """
    first = look.with_latent
    assert first is not None
    fits = []
    for lag in record.path.span * np.array(LAGS):
        with suppress(NotPossible):
            fits.append(fit_hypothesis(record, Hypothesis(wheel=True, lag=float(lag)), again(first)))
    # how the wheel follows its drive has no say in its axis: a fit that left it went astray
    fits = [f for f in fits if _apart(f, first) < criteria.AXIS_SD]
    with_latent = max(fits, key=lambda f: f.verified, default=first)
    alone = fit_hypothesis(record, replace(with_latent.hypothesis, latent=False), again(with_latent))
    alone = _along_valley(alone)
    if alone.verified > with_latent.verified:  # more freedom cannot be less likely: it went astray
        with_latent = fit_hypothesis(record, with_latent.hypothesis, again(alone))
    return Candidate(alone=alone, with_latent=with_latent)


def _along_valley(fit: HypothesisFit) -> HypothesisFit:
    """The likeliest of a fit of a wheel and of fits begun at other moments about its axis, along which the likelihood hardly changes:
    the wheel answers for that moment."""
    best = fit
    for more in VALLEY:
        with suppress(NotPossible):
            start = with_more_about_axis(again(fit), fit.rate, more)
            other = fit_hypothesis(fit.record, fit.hypothesis, start)
            best = other if other.verified > best.verified + SETTLED else best
    return best


def _apart(a: HypothesisFit, b: HypothesisFit) -> float:
    """Angle between the axes of two wheels [rad]."""
    assert a.axis is not None and b.axis is not None
    return float(np.arccos(min(1.0, abs(float(a.axis @ b.axis)))))
