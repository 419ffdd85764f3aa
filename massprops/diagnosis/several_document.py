"""What several records of one body say together as a document: verdict, what is common, and in what the records differ."""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.core.text import with_sigma
from massprops.diagnosis import criteria
from massprops.diagnosis.common_parameters import Common
from massprops.diagnosis.document import mean_moment
from massprops.diagnosis.effect_columns import has_known_rate
from massprops.diagnosis.momentum_balance import inertia_of
from massprops.diagnosis.record_agreement import Shared
from massprops.diagnosis.several import CommonEffect, Together
from massprops.errors import NotPossible


def document_of_together(found: Together, names: list[str], documents: list[dict[str, Any]]) -> dict[str, Any]:
    """The content of `diagnosis.json` of several records.

    Args:
        names: of the records; documents: of each by itself.

    Raises:
        NotPossible: the records are not of one body.
    """
    warnings = [f"{n}: {w}" for n, d in zip(names, documents, strict=True) for w in d["warnings"]]
    warnings += [_differs(n) for n in found.shared if n.differs]
    if found.stretch > 1.0:
        warnings.append(
            f"the records scatter more than chance has it: what is common has sigmas {found.stretch:.1f} times as large"
        )
    warnings += [_not_one(e.apart, e.name) for e in found.named if e.apart]
    turned = _turned(found, names)
    if turned:
        warnings.append(_slipped(turned, names[0]))
    if found.agreement < criteria.DISAGREE:
        what = " and ".join(["one inertia", *sorted({f"one {n}" for e in found.named for n in e.common.parameters})])
        differ = ", ".join(n.words for n in found.shared if n.differs)
        raise NotPossible(
            f"the records do not agree on {what} (log evidence {found.agreement:.0f}{f'; apart in {differ}' if differ else ''}): they "
            "are of different bodies or in different body axes. Diagnose each by itself"
        )
    value, sigma = common_ratios(found.common)
    sigma = [_spread(found, "", k, s) for k, s in zip(("k1", "k2"), sigma, strict=True)]
    return {
        "format": "massprops-diagnoses/1",
        "verdict": found.verdict,
        "reason": _reason(found, len(names)),
        "effects": [_entry(e) for e in found.named],
        "candidates": [_entry(e) for e in found.tried],
        "inertia": found.common.inertia.tolist(),
        "k1": {"value": value[0], "sigma": sigma[0]},
        "k2": {"value": value[1], "sigma": sigma[1]},
        "agreement": found.agreement,
        "turned": turned,
        "shared": [_shared(n) for n in (*found.shared, *(n for e in found.named for n in e.apart))],
        "records": {n: d for n, d in zip(names, documents, strict=True)},
        "warnings": warnings,
    }


def _turned(found: Together, names: list[str]) -> list[dict[str, Any]]:
    """By how much the sensors' axes of each record are turned in the body from those of the first, where that was asked for."""
    turns = found.common.turns
    if turns is None:
        return []
    both = list(zip(names, turns.at, found.stretch * turns.sigma, strict=True))
    return [{"record": n, "turn_rad": at.tolist(), "sigma": sd.tolist()} for n, at, sd in both[1:]]


def turn_words(t: dict[str, Any]) -> str:
    """An entry of `turned` in words."""
    both = zip(np.degrees(t["turn_rad"]), np.degrees(t["sigma"]), strict=True)
    return f"{', '.join(with_sigma(v, s, '.2f') for v, s in both)} deg about x, y, z"


def _slipped(turned: list[dict[str, Any]], first: str) -> str:
    """What is to be said of sensors' axes that are turned."""
    most = max(float(np.linalg.norm(t["turn_rad"])) for t in turned)
    return (
        f"the sensor's axes turn in the body from record to record, by up to {np.degrees(most):.1f} deg from those in {first}, as of a "
        f"sensor that slipped or was mounted anew: what is common is told in the axes of {first}"
    )


def _differs(n: Shared) -> str:
    """What is to be said of a number that the records do not tell alike."""
    return f"the records differ in {n.words} ({_told(n)}; p = {n.p_value:.1g})"


def _told(n: Shared) -> str:
    """A number as each record tells it."""
    both = zip(n.values, n.sigma, strict=True)
    return ", ".join(with_sigma(v, s, ".4g") if np.isfinite(v) else "-" for v, s in both)


def _not_one(apart: tuple[Shared, ...], name: str) -> str:
    """What is to be said of numbers of which each record has its own."""
    told = "; ".join(f"{n.name} {_told(n)}" for n in apart)
    return f"the records do not show one {name} ({told}): each has its own, and the inertia alone is common"


def _spread(found: CommonEffect | Together, effect: str, name: str, sigma: float) -> float:
    """A common number's 1-sigma, as large as the records' scatter has it."""
    scatter = [n.scatter for n in found.shared if (n.effect, n.name) == (effect, name) and n.differs]
    return max([sigma * found.stretch, *scatter])


def _shared(n: Shared) -> dict[str, Any]:
    return {
        "effect": n.effect or None,
        "name": n.name,
        "values": [float(v) if np.isfinite(v) else None for v in n.values],
        "sigma": [float(v) if np.isfinite(v) else None for v in n.sigma],
        "p_value": n.p_value,
    }


def common_ratios(common: Common) -> tuple[list[float], list[float]]:
    """(k1, k2) of a common inertia and their 1-sigma, by 400 draws from its posterior with a fixed seed."""
    from massprops.dynamics.inertia import ratios

    rng = np.random.default_rng(0)
    shapes = rng.multivariate_normal(common.shape, common.covariance, 400)
    k = np.array([ratios(inertia_of(s))[0] for s in shapes])
    return [float(v) for v in ratios(common.inertia)[0]], [float(v) for v in k.std(axis=0)]


def _entry(e: CommonEffect) -> dict[str, Any]:
    """What an effect scores, and the parameters of it that are the body's, None for those that the records do not show."""
    sigmas = {of: {n: _spread(e, of, n, sd) for n, sd in by_name.items()} for of, by_name in e.common.sigma.items()}
    shown = {
        effect: {n: v if abs(v) > criteria.SHOWN * sigmas[effect][n] else None for n, v in by_name.items()}
        for effect, by_name in e.common.parameters.items()
    }
    sigma = {
        effect: {n: None if v is None else sigmas[effect][n] for n, v in by_name.items()}
        for effect, by_name in shown.items()
    }
    return {
        "name": e.name,
        "evidence": e.evidence,
        "agreement": e.agreement,
        "parameters": shown,
        "sigma": sigma,
        **_mean_moment(e, shown, sigma),
    }


def _mean_moment(e: CommonEffect, shown: dict[str, Any], sigma: dict[str, Any]) -> dict[str, Any]:
    """The body's mean moment of inertia in SI units, where a wheel's rate and moment are known."""
    terms = [t for c in e.candidates for t in c.best.hypothesis.terms if has_known_rate(t.effect)]
    moment = next((t.effect.GIVEN.get("inertia_kg_m2") for t in terms), None)
    if moment is None:
        return {}
    name = terms[0].name
    return mean_moment(moment, [(v, sigma[name][k]) for k, v in shown[name].items() if v is not None])


def _laws_told(e: CommonEffect, found: Together) -> list[str]:
    """Other laws of an effect's cause that not each record tells from it, and all together do."""
    laws = dict.fromkeys(name for c in e.candidates for name in c.alike)
    return [o.name for o in found.tried if o.name in laws and o.evidence < e.evidence - criteria.ALIKE]


def _reason(found: Together, count: int) -> str:
    names = ", ".join(dict.fromkeys(e.name for e in found.named))
    shared = any(parameters for e in found.named for parameters in e.common.parameters.values())
    split = ""
    if found.split is not None:
        differ = ", ".join(n.words for n in found.split.shared if n.differs) or "the inertia"
        split = f"; {found.split.name} explains each by itself, but they differ in {differ}"
    told = [law for e in found.named[:1] for law in _laws_told(e, found)] if found.verdict == "named" else []
    law = f"; together they tell it from {' and '.join(told)}, which not each does" if told else ""
    return {
        "none": f"a free rigid body of one inertia explains the {count} records",
        "named": f"{names}, with one inertia{' and its parameters the same' if shared else ''} in all {count} records{law}",
        "ambiguous": f"these {count} records cannot tell apart: {names}",
        "unexplained": f"no effect of the catalogue explains the {count} records with one inertia{split}",
    }[found.verdict]
