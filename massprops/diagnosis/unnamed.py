"""What names no effect: the plain rigid body, torques of no known cause, and errors that are alike in time."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from massprops.diagnosis import criteria
from massprops.diagnosis.candidate import Selection, within_noise
from massprops.diagnosis.conserved_start import Start, conserved
from massprops.diagnosis.effect_search import again
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import HypothesisFit, fit_hypothesis
from massprops.diagnosis.record import Record
from massprops.errors import NotPossible

MEMORIES = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Time constants of attitudes' errors that are tried, over the gap between two of them: from nearly none to what a short
record can show."""
SUN = "sun direction"
"""What effects need that follow the Sun."""


def without_effects(record: Record) -> tuple[HypothesisFit, HypothesisFit]:
    """The plain rigid body, and with a latent torque; the same twice where nothing is left that the stated noise does not
    explain."""
    plain = conserved(record.path, record.rows.at)
    base = from_starts(record, Hypothesis(latent=False), [plain, Start(inertia=np.eye(3), left=1.0)])
    if record.stated and within_noise(base):
        return base, base
    return base, from_starts(record, Hypothesis(), [plain, Start(inertia=base.inertia, left=1.0)])


def rigid_body_alone(record: Record) -> Selection:
    """Nothing but the plain rigid body, where no effect could be told."""
    base = fit_hypothesis(record, Hypothesis(latent=False), Start(inertia=np.eye(3), left=1.0))
    return Selection(base=base, unknown=base, tried=(), verdict="none", named=())


def inertial_torque(record: Record, unknown: HypothesisFit) -> HypothesisFit | None:
    """With a torque that is smooth in inertial axes, such as that of a force from outside on a point near the axis; None where it
    leads astray."""
    along = record if record.rows.rates else unknown.record
    try:
        return fit_hypothesis(along, Hypothesis(latent=False, inertial=True), again(unknown))
    except NotPossible:
        return None


def torque_by_sun(record: Record, unknown: HypothesisFit) -> HypothesisFit | None:
    """With a torque that depends on the Sun's direction in the body in any way; beside a latent one where that leaves more
    than the noise and is likelier. None where nothing is known of the Sun, or where such torques lead astray, as a knock makes them.

    What acts may follow the Sun and be no pressure of its light: a jet of what it warms, a panel that bends.
    """
    if record.environment is None or SUN not in record.environment.known:
        return None
    along, fits = record if record.rows.rates else unknown.record, []
    for latent in (False, True):
        with suppress(NotPossible):
            fits.append(fit_hypothesis(along, Hypothesis(latent=latent, by_sun=True), again(unknown)))
        if fits and record.stated and within_noise(fits[0]):
            break
    return max(fits, key=lambda f: f.evidence, default=None)


def has_likelier_sun_torque(fit: HypothesisFit, tried: int) -> bool:
    """Whether effects have a rival that names nothing of the Sun: a torque that depends on its direction in any way, in place of
    those that follow it and beside the others. A second effect may take what the first one cannot be.

    In place of one it must be less likely by as much as the best of so many is by chance; beside all it may be a little likelier, and
    is not asked where they leave no more than the stated noise, as of an unknown torque (`Candidate.best`). Of an effect alone
    that follows the Sun the verdict has asked.

    Args:
        tried: how many hypotheses the effects are the likeliest of.
    """
    hypothesis = fit.hypothesis
    others = tuple(t for t in hypothesis.terms if SUN not in t.effect.NEEDS)
    replaced = len(others) < len(hypothesis.terms)
    alone = replaced and not (others or hypothesis.wheel)
    if alone or (not replaced and fit.record.stated and within_noise(fit)):
        return False
    try:
        rival = fit_hypothesis(fit.record, replace(hypothesis, terms=others, by_sun=True), again(fit))
    except NotPossible:
        return False
    lead = criteria.BEATS_UNKNOWN + np.log(1 + tried) if replaced else -criteria.BEATS_UNKNOWN
    return bool(rival.verified > fit.evidence - lead)


def with_memory(fit: HypothesisFit) -> HypothesisFit:
    """The fit with the likeliest time constant of the attitudes' errors; the fit itself where none is likelier."""
    if not fit.record.stated or fit.record.rows.rates:
        return fit
    best = fit
    for gaps in MEMORIES:
        with suppress(NotPossible):
            memory = gaps * float(np.median(np.diff(fit.record.times)))
            other = fit_hypothesis(fit.record, replace(fit.hypothesis, memory=memory), again(best))
            best = other if other.evidence > best.evidence else best
    return best


def from_starts(record: Record, hypothesis: Hypothesis, starts: list[Start]) -> HypothesisFit:
    """The likeliest fit of one hypothesis from several starts, by what is verified: a fit that runs away to a needle claims more.

    Raises:
        NotPossible: none leads anywhere, nor does a ball.
    """
    fits = []
    for start in starts:
        with suppress(NotPossible):
            fits.append(fit_hypothesis(record, hypothesis, start))
    ball = replace(starts[0], inertia=np.eye(3))
    return max(fits, key=lambda f: f.verified) if fits else fit_hypothesis(record, hypothesis, ball)
