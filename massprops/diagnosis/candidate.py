"""An effect that was tried, and what was found of all."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from types import ModuleType

import numpy as np

from massprops.core.robust import rms
from massprops.diagnosis import criteria
from massprops.diagnosis.effect_columns import looked_at
from massprops.diagnosis.held_out import noise_floor
from massprops.diagnosis.hypothesis_fit import HypothesisFit


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """An effect that was tried.

    Attributes:
        alone: fitted by itself; with_latent: together with a latent torque, or None where it was not worth it. told: the fit
            whose parameters are told, where it is another than the one that counts. alike: other laws of the same cause (`LAW_OF`)
            that the record does not tell from it.
    """

    alone: HypothesisFit
    with_latent: HypothesisFit | None = None
    told: HypothesisFit | None = None
    alike: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        return " + ".join(self.alone.names)

    @cached_property
    def evidence(self) -> float:
        """Log evidence of what counts, paid for (`paid`)."""
        return paid(self.likeliest)

    @cached_property
    def own(self) -> float:
        """Log evidence of the effect by itself, paid for."""
        return paid(self.alone)

    @property
    def best(self) -> HypothesisFit:
        """What is told."""
        return self.likeliest if self.told is None else self.told

    @property
    def likeliest(self) -> HypothesisFit:
        """By itself where it leaves no more than the stated noise: nothing else is then needed, and an unknown torque beside it
        only takes a part of it. Else the more likely of the two."""
        if self.alone.record.stated and within_noise(self.alone):
            return self.alone
        if self.with_latent is not None and self.with_latent.verified > self.alone.verified:
            return self.with_latent
        return self.alone


@dataclass(frozen=True, kw_only=True)
class Selection:
    """What was found.

    Attributes:
        base: the plain rigid body; unknown: with a latent torque; others: with one in inertial axes, and with one that depends on
            the Sun's direction in the body in any way where that is known; tried: effects, the most likely first.
        verdict: `none`, `named`, `ambiguous` or `unexplained`; named: the effects of the verdict; skipped: why others
            were not tried, by name. measured: effects that follow what was measured beside the motion.
    """

    base: HypothesisFit
    unknown: HypothesisFit
    tried: tuple[Candidate, ...]
    verdict: str
    named: tuple[Candidate, ...]
    skipped: dict[str, str] = field(default_factory=dict)
    others: tuple[HypothesisFit, ...] = ()
    measured: tuple[ModuleType, ...] = ()

    @property
    def unknowns(self) -> tuple[HypothesisFit, ...]:
        """The hypotheses that name nothing, which every effect must beat."""
        return (self.unknown, *self.others)

    @property
    def likeliest_unknown(self) -> HypothesisFit:
        """Of these the likeliest."""
        return max(self.unknowns, key=lambda f: f.evidence)

    @property
    def with_torque(self) -> HypothesisFit:
        """The unknown torque that is shown: what acts beside the effect that is named, or in place of any."""
        beside = self.named[0].with_latent if self.named else None
        return self.likeliest_unknown if beside is None else beside

    @property
    def noise(self) -> np.ndarray:
        """(3,) the noise that residuals are told in, over that of the rows."""
        with_latent = self.named[0].with_latent if self.named else None
        return noise_floor(self.unknown if with_latent is None else with_latent)


def paid(fit: HypothesisFit) -> float:
    """Log evidence, less the logarithm of the values at which an effect's time and the like were looked for: it is the best of so many,
    while an effect whose values are unknowns, as a spring's frequency, pays for them by their prior."""
    record = fit.record
    looked = [looked_at(t, record.times, record.path.w[record.rows.at]) for t in fit.hypothesis.terms]
    return float(fit.verified - np.sum(np.log(np.maximum(looked, 1))))


def within_noise(base: HypothesisFit) -> bool:
    """Whether a free rigid body leaves no more than the stated noise."""
    return bool(rms(base.residual) < 1.0 + criteria.SHOWN / np.sqrt(2.0 * base.residual.size))
