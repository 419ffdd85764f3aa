"""`diagnosis.json` and `model.yaml` of a selection by the balance of momentum."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from massprops.core.robust import rms
from massprops.diagnosis import criteria
from massprops.diagnosis.candidate import Candidate, Selection
from massprops.diagnosis.held_out import fitted_rms, held_out_rms
from massprops.diagnosis.hypothesis_fit import PASSES, HypothesisFit, torque_sd
from massprops.diagnosis.verdict import significance

INTERVALS = 12
CLEAR = 2
"""Points of the path beside an event: over one of them it is spread."""
LONG_GAP = 3.0
"""Gap between measurements, over the usual one, from which on an event that lies in it is warned of."""
SHAPES = 9
"""Corners by which `model.yaml` holds a wheel's history (`internal_rotor.SHAPES`)."""
AXES = {True: "body axes are the gyroscope's", False: "body axes are those of attitude0"}


def document_of_selection(s: Selection, warnings: list[str]) -> dict[str, Any]:
    """The content of `diagnosis.json`."""
    after = s.named[0] if s.named else None
    return {
        "format": "massprops-diagnosis/1",
        "verdict": s.verdict,
        "reason": reason(s),
        "effects": [_effect(c, name, s) for c in s.named for name in c.alone.names],
        "candidates": [_candidate(c, s) for c in s.tried],
        "skipped": s.skipped,
        "where": where(s),
        "gap": gap(s),
        "latent": latent(s),
        "corrected": _corrected(s.base, after.best if after else s.base),
        "axes": AXES[s.base.record.rows.rates],
        "model": "model.yaml",
        "warnings": [*warnings, *(w for c in s.named for w in [*_unsettled(c), *_in_a_gap(c), *_laws(c)])],
    }


def _unsettled(c: Candidate) -> list[str]:
    """What is to be said where the fit of what is named did not come to rest."""
    if c.best.settled:
        return []
    return [f"the fit of {c.name} did not settle in {PASSES} passes: its sigmas hold the step that was left to it"]


def _laws(c: Candidate) -> list[str]:
    """What is to be said where another law of the same cause fits as well."""
    return [f"{other} is as likely as {c.name}: this record does not tell by which law it acts" for other in c.alike]


def _in_a_gap(c: Candidate) -> list[str]:
    """What is to be said where an event lies in a gap of the record."""
    times, out = c.best.record.times, []
    for term in c.best.hypothesis.terms:
        held = dict(term.held)
        if "time" not in held:
            continue
        ends = np.searchsorted(times, [held["time"], held["time"] + held.get("duration", 0.0)]) + np.array([-1, 1])
        widest = float(np.diff(times[max(int(ends[0]), 0) : int(ends[1])]).max(initial=0.0))
        if widest > LONG_GAP * np.median(np.diff(times)):
            out.append(
                f"{term.name} lies in a gap of {widest:.3g} s between measurements: times that jump there look the same"
            )
    return out


def gap(s: Selection) -> dict[str, Any]:
    """What is left, over the noise, without the effect named, with it, and with it beside an unknown torque."""
    named = s.named[0] if s.named else None
    unknown = s.likeliest_unknown if s.verdict == "unexplained" else None
    fits = {
        "before": s.base,
        "after": named.alone if named else s.base,
        "beside_unknown": named.with_latent if named else unknown,
    }
    return {
        "fitted": {k: None if f is None else fitted_rms(f, s.noise) for k, f in fits.items()},
        "held_out": {k: None if f is None else _number(held_out_rms(f, s.noise)) for k, f in fits.items()},
        "noise_floor": 1.0,
    }


BLIND = "not observable"
"""How the reason begins of a record that turns too little."""


def blind_reason(turn: float) -> str:
    """The reason where the body turns by no more than this [rad]."""
    return (
        f"{BLIND}: the body turns by {np.degrees(turn):.0f} deg only, too little to show whether an effect is "
        "missing: give a longer record"
    )


def is_blind(document: dict[str, Any]) -> bool:
    """Whether a record turns too little to show whether an effect is missing, so that its verdict means nothing; of several
    records whether all do."""
    records = document.get("records", {}).values()
    return all(map(is_blind, records)) if records else str(document["reason"]).startswith(BLIND)


def reason(s: Selection) -> str:
    """The verdict in a sentence."""
    if s.verdict == "none":
        memory = s.base.hypothesis.memory
        alike = f", with errors that are alike over {memory:.3g} s" if memory else ""
        return f"a free rigid body explains the measurements{alike}: the residuals are {fitted_rms(s.base, s.noise):.2f} times the noise"
    if s.verdict == "named":
        return _sentence(s.named[0])
    if s.verdict == "ambiguous":
        others = [_unknown(s)] if len(s.named) == 1 or not _ahead(s) > criteria.ALIKE else []
        names = ", ".join([c.name for c in s.named] + others)
        return f"this record cannot tell apart: {names}; a longer record, or one with another start, may"
    best = s.tried[0]
    return (
        f"a free rigid body leaves residuals of {fitted_rms(s.base, s.noise):.1f} times the noise, and no effect of the "
        f"catalogue accounts for them. {best.name} comes nearest: by itself it leaves "
        f"{fitted_rms(best.alone, s.noise):.1f}, and its log evidence is {_ahead(s):+.0f} against {_unknown(s)}"
    )


def _ahead(s: Selection) -> float:
    """By how much the likeliest effect is ahead of the likeliest unknown torque in log evidence."""
    return s.tried[0].evidence - s.likeliest_unknown.evidence


def _unknown(s: Selection) -> str:
    """The likeliest torque that names nothing."""
    null = s.likeliest_unknown.hypothesis
    if null.by_sun:
        return "a torque that depends on the Sun's direction in the body, not as pressure does"
    return "a torque that is smooth in inertial axes" if null.inertial else "a torque that nothing is known of"


def _sentence(c: Candidate) -> str:
    from massprops.effects import effects

    return "; ".join(effects()[n].SENTENCE for n in c.alone.names)


def _candidate(c: Candidate, s: Selection) -> dict[str, Any]:
    """The scores of an effect that was tried."""
    return {
        "name": c.name,
        "form": "any history" if c.alone.hypothesis.wheel else "simple",
        "evidence": c.evidence - s.base.evidence,
        "evidence_against_unknown": c.evidence - s.unknown.evidence,
        "significance": significance(c.best),
        # twice the log evidence is what BIC stands for
        "delta_bic": 2.0 * (c.evidence - s.base.evidence),
        "fitted": fitted_rms(c.alone, s.noise),
        "held_out": _number(held_out_rms(c.alone, s.noise)),
        "held_out_gain": _number(held_out_rms(s.base, s.noise) - held_out_rms(c.alone, s.noise)),
        "whiteness": None,
        "implausible": None,
    }


def _effect(c: Candidate, name: str, s: Selection) -> dict[str, Any]:
    from massprops.effects import effects

    module = effects()[name]
    value, sigma = parameters(c.best, name)
    shown = _shown(value, sigma, _told(c.best, name))
    out = _candidate(c, s)
    out |= {
        "name": name,
        "sentence": module.SENTENCE,
        "parameters": shown,
        "sigma": {k: None if v is None else sigma[k] for k, v in shown.items()},
        "units": {q.name: q.unit for q in module.PARAMETERS},
    }
    fit = c.best
    out |= _mean_moment(module, shown, out["sigma"])
    if hasattr(module, "jump"):
        out["rate_change_rad_s"] = rate_change(fit, name).tolist()
    if name == "internal-rotor" and fit.axis is not None and fit.history is not None and fit.history_sd is not None:
        at = fit.record.rows.at
        out["axis"] = fit.axis.tolist()
        out["history"] = {
            "times_s": fit.record.times.tolist(),
            "momentum_rad_s": fit.history[at].tolist(),
            "sigma": fit.history_sd[at].tolist(),
            "lag_s": fit.hypothesis.lag,
        }
    return out


def _mean_moment(
    module: ModuleType, shown: dict[str, float | None], sigma: dict[str, float | None]
) -> dict[str, dict[str, float]]:
    """The body's mean moment of inertia in SI units, where a wheel's rate and moment are known."""
    given = getattr(module, "GIVEN", {})
    values_and_sigmas = [(v, sigma[k]) for k, v in shown.items() if v is not None]
    if "inertia_kg_m2" not in given:
        return {}
    return mean_moment(given["inertia_kg_m2"] * max(map(abs, given["rate_rad_s"])), values_and_sigmas)


def mean_moment(carried: float, found: list[tuple[float, float | None]]) -> dict[str, dict[str, float]]:
    """A body's mean moment of inertia in SI units by what a wheel carries, in SI units and in those of the mean moment: values and
    1-sigma by axis; nothing where none is shown."""
    if not found:
        return {}
    size = np.sqrt(sum(v**2 for v, _ in found))
    mean = carried / size
    spread = np.sqrt(sum((v * (s or 0.0)) ** 2 for v, s in found)) / size
    return {"mean_moment_kg_m2": {"value": float(mean), "sigma": float(mean * spread / size)}}


def rate_change(fit: HypothesisFit, name: str = "impulse") -> np.ndarray:
    """(3,) rate after an event less the rate before it, body axes [rad/s]: it does not lean on the inertia."""
    held, t = dict(fit.hypothesis.term(name).held), fit.record.path.t
    ends = np.searchsorted(t, [held["time"], held["time"] + held.get("duration", 0.0)])
    before, after = max(int(ends[0]) - CLEAR, 0), min(int(ends[1]) + CLEAR, len(t) - 1)
    return np.asarray(fit.rate[after] - fit.rate[before])


def _told(fit: HypothesisFit, name: str) -> set[str]:
    """Parameters of an effect that turn the body: a knock's push is not among them, of which rates and attitudes tell nothing."""
    if fit.hypothesis.wheel and name == "internal-rotor":
        return set(_wheel_parameters(fit)[0])
    term = fit.hypothesis.term(name)
    return {*dict(term.held), *term.unknowns, "span"}


def _shown(value: dict[str, float], sigma: dict[str, float], told: set[str]) -> dict[str, float | None]:
    """Parameters, None for those that the data do not show."""
    clear = {k for k, v in value.items() if sigma[k] == 0.0 or abs(v) > criteria.SHOWN * sigma[k]}
    return {k: v if k in clear & told else None for k, v in value.items()}


def parameters(fit: HypothesisFit, name: str) -> tuple[dict[str, float], dict[str, float]]:
    """Parameters of one of a fit's effects as `model.yaml` names them, and their 1-sigma; those held by a scan have none."""
    from massprops.effects import effects

    if fit.hypothesis.wheel and name == "internal-rotor":
        return _wheel_parameters(fit)
    term = fit.hypothesis.term(name)
    value = {q.name: 0.0 for q in effects()[term.name].PARAMETERS}
    value |= {k: v for k, v in term.held if k in value}
    sigma = dict.fromkeys(value, 0.0) | fit.held_sd.get(name, {})
    spread = np.sqrt(np.maximum(np.diag(fit.covariance[term.name]), 0.0))
    for unknown, v, sd in zip(term.unknowns, fit.values[term.name], spread, strict=True):
        value[unknown], sigma[unknown] = float(v), float(sd)
    if "span" in value:
        value["span"] = float(fit.record.path.t[-1])
    return value, sigma


def _wheel_parameters(fit: HypothesisFit) -> tuple[dict[str, float], dict[str, float]]:
    """Mean momentum, and the history at even corners, from the time from which times count, over it less one: constants are the
    mean's, so shapes have none."""
    assert fit.axis is not None and fit.history is not None and fit.history_sd is not None
    t = fit.record.path.t
    corners = np.linspace(0.0, t[-1], SHAPES)
    h, sd = np.interp(corners, t, fit.history), np.interp(corners, t, fit.history_sd)
    weight = np.full(SHAPES, 1.0 / (SHAPES - 1))
    weight[[0, -1]] /= 2
    mean = float(weight @ h)
    value = {f"momentum_{a}": mean * float(x) for a, x in zip("xyz", fit.axis, strict=True)}
    sigma = {f"momentum_{a}": float(np.mean(sd)) for a in "xyz"}
    size = mean if abs(mean) > 1e-9 else 1e-9
    for k in range(SHAPES):
        value[f"shape_{k + 1}"] = float(h[k] / size - 1.0)
        sigma[f"shape_{k + 1}"] = float(sd[k] / abs(size))
    return value | {"span": float(t[-1])}, sigma | {"span": 0.0}


def where(s: Selection) -> list[dict[str, Any]]:
    """The parts of the record that a free rigid body explains worst."""
    times, residual = s.base.record.row_times, s.base.residual / s.noise
    edges = np.linspace(times[0], times[-1], INTERVALS + 1)
    out = []
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        values = residual[(times >= a) & (times <= b)]
        if not values.size:
            continue
        out.append(
            {
                "channel": "rate" if s.base.record.rows.rates else "attitude",
                "interval_s": [float(a), float(b)],
                "features": [],
                "z": float((np.sum(values**2) - values.size) / np.sqrt(2.0 * values.size)),
                "size": rms(values),
                "bias": float(values.mean()),
            }
        )
    return sorted(out, key=lambda e: -e["z"])


def latent(s: Selection) -> dict[str, Any]:
    """What a torque that nothing is known of would have to be: alone, and what is left of it beside the effect named."""
    fit = s.with_torque
    beside = bool(s.named) and s.named[0].with_latent is not None
    return {
        "evidence": s.unknown.evidence - s.base.evidence,
        "torque_rms": rms(s.unknown.torque) * np.sqrt(3.0),
        "torque_rms_beside_effect": rms(fit.torque) * np.sqrt(3.0) if beside else None,
        "shown_rms": rms(fit.torque) * np.sqrt(3.0),
        "shown_sigma": rms(torque_sd(fit)) * np.sqrt(3.0),
        "correlates": _goes_with(fit)[:3],
    }


def _goes_with(fit: HypothesisFit) -> list[dict[str, Any]]:
    """What the components of a fit's torque go with, the closest first: rates, and directions in the body that are known."""
    path, outside = fit.record.path, fit.record.environment
    known = {"rate": fit.rate} | ({} if outside is None else outside.known_in_body(path.t, path.R))
    out: list[dict[str, Any]] = []
    for axis, letter in enumerate("xyz"):
        tau = fit.torque[:, axis]
        for name, vector in known.items():
            for other, component in zip(vector.T, "xyz", strict=True):
                if tau.std() > 0 and other.std() > 0:
                    r = float(np.corrcoef(tau, other)[0, 1])
                    label = "Sun" if name == "sun" else name
                    out.append({"with": f"torque {letter} by {label} {component}", "r": r, "p": None})
    return sorted(out, key=lambda e: -abs(e["r"]))


def _corrected(base: HypothesisFit, after: HypothesisFit) -> dict[str, Any]:
    return corrected((base.inertia, base.rate[0]), (after.inertia, after.rate[0]))


def corrected(base: tuple[np.ndarray, np.ndarray], after: tuple[np.ndarray, np.ndarray]) -> dict[str, Any]:
    """Ratios, rate and axes without the effects and with them, of the inertia (3, 3) and the rate (3,) [rad/s] of each."""
    from massprops.dynamics.inertia import ratios

    (k_base, axes_base), (k_after, axes_after) = ratios(base[0]), ratios(after[0])
    cosine = np.clip(np.abs(np.sum(axes_base * axes_after, axis=0)), 0, 1)
    return {
        "k1": {"before": float(k_base[0]), "after": float(k_after[0])},
        "k2": {"before": float(k_base[1]), "after": float(k_after[1])},
        "rate_rad_s": {"before": base[1].tolist(), "after": after[1].tolist()},
        "axes_moved_deg": np.degrees(np.arccos(cosine)).tolist(),
    }


def model_of_selection(s: Selection) -> dict[str, Any]:
    """The content of `model.yaml`: the plain rigid body, or with what is named first."""
    from massprops.effects import effects

    fit = s.named[0].best if s.named else s.base
    listed = []
    for name in fit.names:
        value, sigma = parameters(fit, name)
        units = {q.name: q.unit for q in effects()[name].PARAMETERS}
        entry = {"name": name, "parameters": value, "units": units, "sigma": sigma}
        given = getattr(effects()[name], "GIVEN", None)
        listed.append(entry if given is None else {**entry, "given": given})
    return {
        "format": "massprops-model/1",
        "effects": listed,
        "inertia": fit.inertia.tolist(),
        "inertia_note": "body axes, mean moment 1, with the effects at the start of the record",
        "angular_velocity_rad_s": fit.rate[0].tolist(),
        "attitude": fit.record.path.q[0].tolist(),
        "corrected": _corrected(s.base, fit),
    }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
