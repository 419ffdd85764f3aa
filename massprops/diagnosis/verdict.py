"""What a record says of the effects that were tried: none is needed, one may be named, or several, or none explains it."""

from __future__ import annotations

import numpy as np

from massprops.core.robust import rms
from massprops.diagnosis import criteria
from massprops.diagnosis.candidate import Candidate, paid, within_noise
from massprops.diagnosis.held_out import held_out_rms
from massprops.diagnosis.hypothesis_fit import HypothesisFit


def verdict_of(
    base: HypothesisFit, unknowns: tuple[HypothesisFit, ...], tried: list[Candidate]
) -> tuple[str, list[Candidate]]:
    """What the evidence says, and the candidates that it leaves, the one named first.

    Args:
        base: without another effect; unknowns: with a torque of no named form; tried: with one effect each.
    """
    something = max([*(u.evidence for u in unknowns), *(c.evidence for c in tried)])
    enough = criteria.BEATS_NOTHING + np.log(1 + len(tried))
    if something < base.evidence + enough:
        return "none", []
    good = _predicting([c for c in tried if _may_be_listed(c, base, unknowns)], base)
    if not good:
        return "unexplained", []
    near = [c for c in good if c.evidence > good[0].evidence - criteria.ALIKE]
    # what an unknown torque beside them hides: how much each explains by itself
    alone = max(near, key=lambda c: c.own)
    near = [alone, *(c for c in near if c is not alone and c.own > alone.own - criteria.ALIKE)]
    # of several effects one is a little likelier than a torque of any smooth form by chance
    smooth = max(u.evidence for u in unknowns if not u.hypothesis.by_sun)
    sure = good[0].evidence > smooth + enough and may_be_named(good[0], base, *unknowns)
    return ("named" if sure and len(near) == 1 else "ambiguous"), near


def _may_be_listed(c: Candidate, base: HypothesisFit, unknowns: tuple[HypothesisFit, ...]) -> bool:
    """Whether an effect may be named, or one by itself leaves no more than the stated noise and is not told from an unknown torque,
    which then is its rival."""
    single = len(c.alone.names) == 1 and base.record.stated and within_noise(c.alone)
    return may_be_named(c, base, *unknowns, lead=-criteria.ALIKE if single else criteria.BEATS_UNKNOWN)


def _predicting(candidates: list[Candidate], base: HypothesisFit) -> list[Candidate]:
    """The effects that predict what was held out better than the rigid body alone does; none where nothing was held out."""
    noise = np.ones(3)
    most = held_out_rms(base, noise) if candidates else np.nan
    return [c for c in candidates if held_out_rms(c.alone, noise) < most]


def may_be_named(
    c: Candidate, base: HypothesisFit, *unknowns: HypothesisFit, lead: float = criteria.BEATS_UNKNOWN
) -> bool:
    """Whether an effect beats the unknown torques by so much in log evidence, explains most by itself, and is away from nothing."""
    likeliest = max(u.evidence for u in unknowns)
    if c.evidence < likeliest + lead or c.evidence < base.evidence + criteria.BEATS_NOTHING:
        return False
    small = base.record.stated and within_noise(c.alone)
    if not small and misfit(c.alone) > criteria.PART_LEFT * misfit(base):
        return False
    if base.record.stated and rms(c.alone.residual) > criteria.LEFT_OF_STATED:
        return False
    return significance(c.best) < criteria.SIGNIFICANT


def is_enough(fit: HypothesisFit, unknowns: tuple[HypothesisFit, ...]) -> bool:
    """Whether effects leave no more than a stated noise and are likelier than what names nothing."""
    likeliest = max(u.evidence for u in unknowns) + criteria.BEATS_UNKNOWN
    return bool(fit.record.stated and within_noise(fit) and paid(fit) > likeliest)


def asks_for_two(tried: list[Candidate], base: HypothesisFit, *unknowns: HypothesisFit) -> bool:
    """Whether no single effect is enough: none may be named, or each that may leaves more than the noise that is stated, or
    an effect beside an unknown torque is likelier."""
    good = [c for c in tried if may_be_named(c, base, *unknowns)]
    if not base.record.stated:
        return not good
    likeliest = max(
        [
            *(u.evidence for u in unknowns),
            *(paid(f) for c in tried for f in (c.alone, c.with_latent) if f is not None),
        ]
    )
    enough = [c for c in good if within_noise(c.alone) and c.own > likeliest - criteria.BEATS_UNKNOWN]
    return bool(tried) and not enough


def significance(fit: HypothesisFit) -> float:
    """Chance of unknowns as far from nothing, all of an effect's together (Wald's test)."""
    from scipy.special import chdtrc  # scipy.stats takes a second to load

    names = (["wheel"] if fit.hypothesis.wheel else []) + [t.name for t in fit.hypothesis.terms]
    worst = 0.0
    for name in names:
        mean, covariance = fit.posterior.mean[name], fit.posterior.covariance[name]
        square = float(mean @ np.linalg.pinv(covariance, hermitian=True) @ mean)
        worst = max(worst, float(chdtrc(len(mean), square)))
    return worst


def misfit(fit: HypothesisFit) -> float:
    """What a fit leaves, root mean square over the noise given: beyond that noise where it is stated, as no effect can take the
    noise itself."""
    square = float(np.mean(fit.residual**2))
    return float(np.sqrt(max(square - 1.0, 0.0) if fit.record.stated else square))
