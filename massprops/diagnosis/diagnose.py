"""A diagnosis by the balance of momentum: sequence in, document and model out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from massprops.diagnosis import criteria
from massprops.diagnosis.document import document_of_selection, model_of_selection
from massprops.diagnosis.free_flight import check_free_flight
from massprops.diagnosis.record import Record, record_of_rates
from massprops.diagnosis.selection import Selection, rigid_body_alone, select
from massprops.sequence.data import Sequence


@dataclass(frozen=True, kw_only=True)
class BalanceDiagnosis:
    """What was found.

    Attributes:
        document: the content of `diagnosis.json`; model: of `model.yaml`; record, selection: the work behind them.
    """

    document: dict[str, Any]
    model: dict[str, Any]
    record: Record
    selection: Selection


def decides(sequence: Sequence) -> bool:
    """Whether the balance of momentum decides by itself: body rates of a short record, and nothing else measured."""
    others = (sequence.tracks, sequence.attitude, sequence.range)
    if sequence.rates is None or not len(sequence.rates.w) or any(x is not None for x in others):
        return False
    return _turn(sequence.rates.timestamp_ns * 1e-9, sequence.rates.w) < criteria.MOST_TURN


def _turn(times: np.ndarray, w: np.ndarray) -> float:
    """Turn of a record over all [rad]."""
    speed = np.linalg.norm(w, axis=1)
    return float(np.sum(np.diff(times) * 0.5 * (speed[1:] + speed[:-1])))


def diagnose_rates(
    sequence: Sequence, progress: Callable[[str, int, int], None] = lambda what, done, total: None
) -> BalanceDiagnosis:
    """What a record of body rates lacks beside a free rigid body.

    `body.yaml` has no say: an inertia that is wrong would be paid for by an effect.

    Raises:
        NotPossible: too few rates, or too far apart, or the accelerometer says that this is no free flight.
    """
    assert sequence.rates is not None
    warnings = list(sequence.warnings)
    record = record_of_rates(sequence.rates)
    lever = check_free_flight(sequence, record)
    turn = _turn(record.times, record.rows.measured)
    blind = turn < criteria.LEAST_TURN
    found = rigid_body_alone(record) if blind else select(record, progress)
    if sequence.rates.sigma is None:
        warnings.append(f"imu0 states no noise: {_noise(found):.3g} rad/s estimated, which no smooth torque can follow")
    document = document_of_selection(found, warnings)
    if blind:
        document["reason"] = _blind(turn)
    if lever is not None:
        document["lever"] = {"sensor_from_centre_of_mass_m": lever.r, "sigma": lever.sigma, "left_m_s2": lever.left}
    return BalanceDiagnosis(document=document, model=model_of_selection(found), record=record, selection=found)


def _blind(turn: float) -> str:
    return (
        f"not observable: the body turns by {np.degrees(turn):.0f} deg only, too little to tell free rotation, or what is "
        "missing from it, from anything else"
    )


def _noise(s: Selection) -> float:
    fit = s.named[0].best if s.named else s.unknown
    return float(np.sqrt(np.mean(fit.noise**2)) * fit.record.rows.sigma[0])


def contents_of(d: BalanceDiagnosis) -> dict[str, str | bytes]:
    """What a diagnosis leaves on disk, by name: `diagnosis.json`, `model.yaml`, `residual.csv`, `report.html`."""
    import yaml

    from massprops.core.files import json_text, plain
    from massprops.diagnosis.page import page

    return {
        "residual.csv": residual_table(d),
        "model.yaml": yaml.safe_dump(plain(d.model), sort_keys=False, allow_unicode=True),
        "diagnosis.json": json_text(d.document),
        "report.html": page(d),
    }


def residual_table(d: BalanceDiagnosis) -> str:
    """Residuals before and after by measurement, and the latent torque of the rigid body alone."""
    lines = ["#timestamp [ns],channel,camera,feature,component,before [sigma],after [sigma]"]
    s = d.selection
    before = s.base.residual
    after = (s.named[0].alone if s.named else s.base).residual
    for t, b, a in zip(d.record.stamp, before, after, strict=True):
        lines += [f"{t},rate,,,{name},{b[k]:.4f},{a[k]:.4f}" for k, name in enumerate("xyz")]
    if s.verdict == "unexplained":
        for t, v in zip(d.record.stamp, s.unknown.torque[d.record.rows.at], strict=True):
            lines += [f"{t},torque [rad s^-2],,,{name},{v[k]:.6g}," for k, name in enumerate("xyz")]
    return "\n".join(lines) + "\n"
