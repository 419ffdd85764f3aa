"""What several records of one body share: the inertia, and the parameters that an effect says are the body's (`BODY`).

Everything else (attitudes, momenta at the start, events, states, a wheel's history, noise) is each record's own and already
marginalised in that record's fit. A record says of what is common, c, a normal posterior N(m_r, C_r) from a prior N(0, P_r),
linearised about one common point (`hypothesis_fit.linearised`). With n records and the prior P of all,

    evidence = sum of the records' own + log of the integral of product_r [N(c; m_r, C_r) / N(c; 0, P_r)] N(c; 0, P) dc,

and the joint posterior has the precision sum (C_r^-1 - P_r^-1) + P^-1. Sizes that P holds are found by this evidence, as a record's
own are. The point moves to the joint solution until it rests (Gauss and Newton's method). An effect that needs another body in
every record pays for it by the integral. A parameter of the body that a record's fit scans, not solves for, is moved to its best
for all records, with its 1-sigma by the evidence's curvature.

A wheel whose rate was measured has one moment of inertia: its momentum at a record's largest rate is that moment times that rate
(`BODY_NUMBERS`), so c holds the moment. Of a fit whose sigmas allow for residuals that are alike in neighbours (`widened`) the rows
count by as much less here as well.

The axes of the sensors may turn in those of the body from record to record, as a sensor slips or is mounted anew (`axes`). Each record
but the first then has one more unknown, its small turn from the first one's. Its prior is normal with zero mean; its size is found by
the same evidence.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from massprops.diagnosis.criteria import AXIS_SD
from massprops.diagnosis.effect_columns import Term, term_of
from massprops.diagnosis.hypothesis import AXES, AxesTurn, Hypothesis, across
from massprops.diagnosis.hypothesis_fit import SMALL_STEP, HypothesisFit, linearised
from massprops.diagnosis.momentum_balance import INERTIA, inertia_of
from massprops.errors import NotPossible

LEAST_SD = 1e-4
"""Of a shape's posterior: no record shows a second moment of mass better than a part in ten thousand."""
PASSES = 8
RESTS = 1.0
"""Change of the log evidence in the last pass up to which it decides (`criteria.BEATS_UNKNOWN`)."""
AXIS = 2
"""Unknowns of a wheel's axis."""
LARGEST_STEP = 1.0
"""Of the inertia's shape in a pass: a factor of e in a second moment of mass."""
SIZES = 100
"""Steps of the search for the sizes of priors."""
FIRST_STEP, STEP_SIGMAS, ROUNDS = 0.1, 2.0, 3
"""Of the logarithm of a scanned parameter, by which its evidence's slope and curvature are measured: at first, then over its sigma."""
TURN_SD, LEAST_TURN_SD, MOST_TURN_SD = 0.03, 1e-4, 0.1
"""1-sigma of the turn of a sensor's axes [rad]: at first, and its ends. The turn is linearised, and a larger one is another mounting of
which it should be known."""
WIDEST = np.log(3.0)
"""How far beyond the records' own values of a scanned parameter, in its logarithm, the common one is looked for."""


@dataclass(frozen=True, kw_only=True)
class Law:
    """A normal law of common unknowns: mean (k,), covariance (k, k), and prior standard deviations sd (k,)."""

    mean: np.ndarray
    covariance: np.ndarray
    sd: np.ndarray


@dataclass(frozen=True, kw_only=True)
class AxesTurns:
    """Turns of the sensors' axes of n records from those of the first [rad]: at (n, 3), their 1-sigma (n, 3), and that of their law."""

    at: np.ndarray
    sigma: np.ndarray
    sd: float

    def of(self, k: int) -> AxesTurn | None:
        """As the unknown of a record; the first has none."""
        return AxesTurn(at=self.at[k], sd=self.sd) if k else None


@dataclass(frozen=True, kw_only=True)
class Common:
    """What several records say together.

    Attributes:
        shape: (5,) of the inertia, covariance: (5, 5), inertia: (3, 3) of trace 3; evidence: log marginal likelihood of all records.
        parameters, sigma: by effect and name, of the body's own. law: of all common unknowns; records: what each record says of them,
            about the common point; names: (k,) effect and name of each unknown, ("", "") of what is no parameter. turns: of the
            sensors' axes, or None where these are the same in all records.
    """

    shape: np.ndarray
    covariance: np.ndarray
    inertia: np.ndarray
    evidence: float
    parameters: dict[str, dict[str, float]] = field(default_factory=dict)
    sigma: dict[str, dict[str, float]] = field(default_factory=dict)
    law: Law | None = None
    records: tuple[Law, ...] = ()
    names: tuple[tuple[str, str], ...] = ()
    turns: AxesTurns | None = None


def joined(laws: list[Law], alike: list[np.ndarray]) -> tuple[Law, float]:
    """The law that several laws of the same unknowns make, and the log of the integral above.

    Args:
        alike: indices (j,) of unknowns whose prior has one size, which is found.
    """
    precisions = [np.linalg.inv(law.covariance) for law in laws]
    rest = np.sum([of_rows(L, law.sd) for L, law in zip(precisions, laws, strict=True)], axis=0)
    by = np.sum([L @ law.mean for L, law in zip(precisions, laws, strict=True)], axis=0)
    sd = laws[0].sd.copy()
    for one_size in alike:
        sd[one_size] = np.mean([law.sd[one_size] for law in laws])
    for _ in range(SIZES if alike else 1):
        covariance = np.linalg.inv(rest + np.diag(sd**-2))
        mean = covariance @ by
        before = sd.copy()
        for one_size in alike:
            sd[one_size] = np.sqrt(np.mean(mean[one_size] ** 2 + np.diag(covariance)[one_size]))
        if np.allclose(sd, before, rtol=1e-3):
            break
    sd = before
    determinants = sum(
        np.linalg.slogdet(L)[1] + 2.0 * np.sum(np.log(o.sd)) for L, o in zip(precisions, laws, strict=True)
    )
    determinants -= 2.0 * np.sum(np.log(sd)) - np.linalg.slogdet(covariance)[1]
    squares = sum(float(o.mean @ L @ o.mean) for L, o in zip(precisions, laws, strict=True))
    gained = 0.5 * (determinants + float(by @ mean) - squares)
    return Law(mean=mean, covariance=covariance, sd=sd), float(gained)


def of_rows(precision: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """(k, k) what a record's rows know of unknowns: the precision less that of their prior, not below nothing by rounding."""
    value, vector = np.linalg.eigh(precision * sd * sd[:, None])
    return np.asarray((vector * np.maximum(value - 1.0, 0.0)) @ vector.T / sd / sd[:, None])


def common_of(fits: list[HypothesisFit], axes: bool = False) -> Common:
    """What fits of one hypothesis, each in a record of its own, say together; axes: whether those of the sensors turn in the body
    from record to record.

    Raises:
        NotPossible: no common body comes near the records.
    """
    scanned = _scanned(next((f for f in fits if of_body(f)), fits[0]))
    try:
        return _at_best(fits, *scanned[0], axes) if len(scanned) == 1 else _at_rest(fits, {}, axes)
    except NotPossible:
        if axes or any(f.names for f in fits):
            raise
    # a body without effects may be another one in each record: what each says about its own best
    laws = [_law(f, fits[0]) for f in fits]
    law, gained = joined(laws, [])
    return _common(fits[0], law, laws, gained + sum(f.evidence for f in fits))


def of_body(fit: HypothesisFit) -> bool:
    """Whether an effect of a fit has parameters that belong to the body."""
    return any(t.of_body for t in fit.hypothesis.terms)


def _scanned(fit: HypothesisFit) -> list[tuple[str, str]]:
    """Effect and name of each of the body's parameters that the fit does not solve for."""
    return [(t.name, n) for t in fit.hypothesis.terms for n in t.of_body if n not in t.unknowns and n in dict(t.held)]


def _at_best(fits: list[HypothesisFit], name: str, parameter: str, axes: bool) -> Common:
    """At the best of a scanned parameter for all records, with what it leaves open."""
    from scipy.optimize import minimize_scalar

    held = np.log([dict(t.held)[parameter] for f in fits for t in f.hypothesis.terms if t.name == name])

    def at(x: float) -> Common:
        return _at_rest(fits, {(name, parameter): float(np.exp(x))}, axes)

    ends = (float(held.min() - WIDEST), float(held.max() + WIDEST))
    best = float(minimize_scalar(lambda x: -at(x).evidence, bounds=ends, method="bounded", options={"xatol": 0.01}).x)
    step = FIRST_STEP
    for _ in range(ROUNDS):
        common, up, down = at(best), at(best + step), at(best - step)
        sd = max((2.0 * common.evidence - up.evidence - down.evidence) / step**2, WIDEST**-2) ** -0.5
        slopes = {k: (v - down.parameters[name][k]) / (2.0 * step) for k, v in up.parameters[name].items()}
        best += float(np.clip(0.5 * (up.evidence - down.evidence) / step * sd**2, -step, step))
        step = STEP_SIGMAS * sd
    effect_sigma = {k: float(np.hypot(s, sd * slopes[k])) for k, s in common.sigma[name].items()}
    value, sigma = {parameter: float(np.exp(best))}, {parameter: float(sd * np.exp(best))}
    return replace(
        common,
        parameters=common.parameters | {name: common.parameters[name] | value},
        sigma=common.sigma | {name: effect_sigma | sigma},
    )


def _at_rest(fits: list[HypothesisFit], given: dict[tuple[str, str], float], axes: bool) -> Common:
    """The common values about which the linearised records agree; given: values of scanned parameters."""
    candidates = [f for f in fits if f.axis is not None] or [f for f in fits if of_body(f)] or fits
    reference = min(candidates, key=lambda f: float(np.trace(f.posterior.covariance["base"][:INERTIA, :INERTIA])))
    at = next(k for k, f in enumerate(fits) if f is reference)
    shape, axis, body = reference.shape, reference.axis, reference.hypothesis.terms
    hypotheses = [_with(f.hypothesis, body, given) for f in fits]
    common, previous, before = None, -np.inf, -np.inf
    none = np.zeros((len(fits), 3))
    turns = AxesTurns(at=none, sigma=none, sd=TURN_SD) if axes else None
    for _ in range(2 * PASSES if axes else PASSES):
        linear_fits = [
            linearised(f, h, shape, None if f.axis is None else axis, None if turns is None else turns.of(k))
            for k, (f, h) in enumerate(zip(fits, hypotheses, strict=True))
        ]
        first = linear_fits[at]
        try:
            laws = [_law(s, first) for s in linear_fits]
            law, gained = joined(laws, _alike(first))
            moved = [_moved(s, law, first) for s in linear_fits]
            evidence = gained + sum(s.evidence for s in linear_fits)
            turns = None if turns is None else _turned(linear_fits, law, first, turns)
            common = replace(_common(first, law, laws, evidence), turns=turns)
        except np.linalg.LinAlgError:
            raise NotPossible("what the records say of one body does not go together") from None
        before, previous = previous, evidence
        step = np.clip(law.mean[:INERTIA] - shape, -LARGEST_STEP, LARGEST_STEP)
        if np.abs(step).max() < SMALL_STEP and abs(evidence - before) < SMALL_STEP:
            break
        shape = shape + step
        body = moved[at].terms
        hypotheses = [_with(h, body, given) for h in moved]
        if axis is not None:
            axis = axis + across(axis) @ law.mean[INERTIA : INERTIA + AXIS]
            axis /= np.linalg.norm(axis)
    assert common is not None
    if not abs(common.evidence - before) < RESTS:
        raise NotPossible("what the records say of one body does not come to rest")
    return common


def _with(hypothesis: Hypothesis, body: tuple[Term, ...], given: dict[tuple[str, str], float]) -> Hypothesis:
    """A record's hypothesis with the body's parameters as effects in `body` and `given` hold them."""
    terms = []
    for term in hypothesis.terms:
        held = {n: v for other in body if other.name == term.name for n, v in other.held if n in term.of_body}
        held |= {n: v for (name, n), v in given.items() if name == term.name}
        terms.append(replace(term, held=term_of(term.effect, dict(term.held) | held).held) if held else term)
    return replace(hypothesis, terms=tuple(terms))


def _places(fit: HypothesisFit) -> np.ndarray:
    """Which of a fit's unknowns are common."""
    places = fit.posterior.places
    of_terms = [places[t.name].start + _solved_for(t) for t in fit.hypothesis.terms]
    wheel = [places["wheel axis"].start + np.arange(AXIS)] if fit.axis is not None else []
    return np.concatenate([np.arange(INERTIA), *wheel, *of_terms]).astype(int)


def _keys(fit: HypothesisFit) -> list[tuple[str, int]]:
    """What each of a fit's common unknowns is: of what, and its number there."""
    wheel = [("wheel axis", k) for k in range(AXIS if fit.axis is not None else 0)]
    of_terms = [(t.name, int(k)) for t in fit.hypothesis.terms for k in _solved_for(t)]
    return [*(("inertia", k) for k in range(INERTIA)), *wheel, *of_terms]


def _factors(fit: HypothesisFit) -> np.ndarray:
    """What the common unknowns are multiplied by in a record."""
    terms = {t.name: t for t in fit.hypothesis.terms if t.prior is None}
    return np.array([terms[of].of_body_as(terms[of].unknowns[k])[1] if of in terms else 1.0 for of, k in _keys(fit)])


def _alike(fit: HypothesisFit) -> list[np.ndarray]:
    """Which of the common unknowns have a prior of one size that is found, by effect."""
    kinds, out = {b.name: b.kind for b in fit.blocks}, []
    at = INERTIA + (0 if fit.axis is None else AXIS)
    for term in fit.hypothesis.terms:
        count = len(_solved_for(term))
        if kinds[term.name] == "common" and count:
            out.append(at + np.arange(count))
        at += count
    return out


def _solved_for(term: Term) -> np.ndarray:
    """Which of an effect's unknowns are the body's; with a prior of its own, all or none."""
    mine = [k for k, name in enumerate(term.unknowns) if name in term.of_body]
    if term.prior is not None:
        return np.arange(term.prior.shape[1]) if len(mine) == len(term.unknowns) else np.arange(0)
    return np.array(mine, int)


def _law(fit: HypothesisFit, first: HypothesisFit) -> Law:
    """What a record says of the common unknowns of the first; of what it does not have, such as a wheel, no more than the prior."""
    places, factors = _places(fit), _factors(fit)
    mean = fit.posterior.whole[places] / factors
    sd = np.concatenate(list(fit.posterior.sd.values()))[places] / factors
    covariance = fit.posterior.joint[np.ix_(places, places)] / np.outer(factors, factors)
    if fit.widened > 1.0:
        by_rows = of_rows(np.linalg.inv(covariance), sd) / fit.widened**2
        covariance = np.linalg.inv(by_rows + np.diag(sd**-2))
    covariance[range(INERTIA), range(INERTIA)] += LEAST_SD**2
    keys, record_keys = _keys(first), _keys(fit)
    if keys == record_keys:
        return Law(mean=mean, covariance=covariance, sd=sd)
    whole_sd = np.concatenate(list(first.posterior.sd.values()))[_places(first)] / _factors(first)
    whole_sd[[k for k, (of, _) in enumerate(keys) if of == "wheel axis"]] = AXIS_SD
    at = [keys.index(k) for k in record_keys]
    whole_mean = np.zeros(len(keys))
    whole_mean[at], whole_sd[at] = mean, sd
    whole = np.diag(whole_sd**2)
    whole[np.ix_(at, at)] = covariance
    return Law(mean=whole_mean, covariance=whole, sd=whole_sd)


def _by_common(fit: HypothesisFit, law: Law, first: HypothesisFit) -> np.ndarray:
    """All of a record's unknowns as what is common has them."""
    post, places, at = fit.posterior, _places(fit), _places_in_first(fit, first)
    mean = post.whole
    away = law.mean[at] * _factors(fit) - mean[places]
    return np.asarray(mean + post.joint[:, places] @ np.linalg.solve(post.joint[np.ix_(places, places)], away))


def _places_in_first(fit: HypothesisFit, first: HypothesisFit) -> list[int]:
    """Which of the common unknowns a record has."""
    keys = _keys(first)
    return [keys.index(k) for k in _keys(fit)]


def _turned(fits: list[HypothesisFit], law: Law, first: HypothesisFit, before: AxesTurns) -> AxesTurns:
    """The turns of the sensors' axes as what is common has them, and the size of their law."""
    at, sigma = before.at.copy(), before.sigma.copy()
    for k, s in enumerate(fits[1:], 1):
        post, places = s.posterior, _places(s)
        axes = post.places[AXES]
        at[k] = _by_common(s, law, first)[axes]
        answer = np.linalg.solve(post.joint[np.ix_(places, places)], post.joint[places, axes]).T
        common = _places_in_first(s, first)
        shown = answer * _factors(s)
        by_record = post.joint[axes, axes] - answer @ post.joint[places, axes]
        covariance = s.widened**2 * by_record + shown @ law.covariance[np.ix_(common, common)] @ shown.T
        sigma[k] = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sd = float(np.sqrt(np.mean(at[1:] ** 2 + sigma[1:] ** 2)))
    return AxesTurns(at=at, sigma=sigma, sd=float(np.clip(sd, LEAST_TURN_SD, MOST_TURN_SD)))


def _moved(fit: HypothesisFit, law: Law, first: HypothesisFit) -> Hypothesis:
    """A record's hypothesis about values that what is common leads to, for effects that are not linear in theirs."""
    if fit.hypothesis.linear:
        return fit.hypothesis
    changes = fit.posterior.by_block(_by_common(fit, law, first))
    return replace(
        fit.hypothesis, terms=tuple(t.moved(changes[t.name]) if t.moves else t for t in fit.hypothesis.terms)
    )


def _common(fit: HypothesisFit, law: Law, laws: list[Law], evidence: float) -> Common:
    """The law in parameters, those of effects by one record's columns."""
    shape, factors = law.mean[:INERTIA], _factors(fit)
    parameters: dict[str, dict[str, float]] = {}
    sigma: dict[str, dict[str, float]] = {}
    at = INERTIA + (0 if fit.axis is None else AXIS)
    names = [("", "")] * at
    for term in fit.hypothesis.terms:
        solved = _solved_for(term)
        mean = fit.posterior.mean[term.name].copy()
        covariance = np.zeros((len(mean), len(mean)))
        here, scale = slice(at, at + len(solved)), factors[at : at + len(solved)]
        mean[solved] = law.mean[here] * scale
        covariance[np.ix_(solved, solved)] = law.covariance[here, here] * np.outer(scale, scale)
        at += len(solved)
        values, spread = term.values(mean, covariance)
        sd = np.sqrt(np.maximum(np.diag(spread), 0.0))
        of = {k: term.of_body_as(n) for k, n in enumerate(term.unknowns) if n in term.of_body}
        parameters[term.name] = {n: float(values[k] / f) for k, (n, f) in of.items()}
        sigma[term.name] = {n: float(sd[k] / f) for k, (n, f) in of.items()}
        linear = term.prior is None and not term.moves
        names += [(term.name, of[k][0]) if linear else ("", "") for k in solved]
    return Common(
        shape=shape, covariance=law.covariance[:INERTIA, :INERTIA], inertia=inertia_of(shape), evidence=evidence,
        parameters=parameters, sigma=sigma, law=law, records=tuple(laws), names=tuple(names),
    )  # fmt: skip
