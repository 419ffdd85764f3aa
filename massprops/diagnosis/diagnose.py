"""A diagnosis by the balance of momentum: sequence in, document and model out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from massprops.diagnosis import criteria
from massprops.diagnosis.document import document_of_selection, model_of_selection
from massprops.diagnosis.record import Record, record_of_rates
from massprops.diagnosis.selection import Selection, select
from massprops.errors import InputError
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
    """Whether the balance of momentum decides by itself: body rates, and nothing else that was measured."""
    others = (sequence.tracks, sequence.attitude, sequence.range)
    return sequence.rates is not None and len(sequence.rates.w) > 0 and all(x is None for x in others)


def diagnose_rates(
    sequence: Sequence, progress: Callable[[str, int, int], None] = lambda what, done, total: None
) -> BalanceDiagnosis:
    """What a record of body rates lacks beside a free rigid body.

    `body.yaml` has no say: an inertia that is wrong would be paid for by an effect.

    Raises:
        NotPossible: too few rates, or too far apart.
    """
    from massprops.diagnosis.free_flight import held_warning

    assert sequence.rates is not None
    warnings = list(sequence.warnings)
    record = record_of_rates(sequence.rates)
    found = select(record, progress)
    step = np.diff(record.times, append=2 * record.times[-1] - record.times[-2])
    turn = float(np.sum(np.linalg.norm(record.rows.measured, axis=1) * step))
    if sequence.rates.sigma is None:
        warnings.append(f"imu0 states no noise: {_noise(found):.3g} rad/s estimated, which no smooth torque can follow")
    held = held_warning(sequence, record)
    if held:
        warnings.append(held)
    document = document_of_selection(found, warnings)
    if turn < criteria.LEAST_TURN:
        document |= {"verdict": "none", "effects": [], "reason": _blind(turn)}
    return BalanceDiagnosis(document=document, model=model_of_selection(found), record=record, selection=found)


def _blind(turn: float) -> str:
    return (
        f"not observable: the body turns by {np.degrees(turn):.0f} deg only, too little to tell free rotation, or what is "
        "missing from it, from anything else"
    )


def _noise(s: Selection) -> float:
    fit = s.named[0].best if s.named else s.unknown
    return float(np.sqrt(np.mean(fit.noise**2)) * fit.record.rows.sigma[0])


def write_balance_diagnosis(out: Path, d: BalanceDiagnosis) -> Path:
    """Writes `diagnosis.json`, `model.yaml`, `residual.csv` and `report.html`, each whole or not at all.

    Raises:
        InputError: the folder cannot be written.
    """
    import yaml

    from massprops.diagnosis.page import page
    from massprops.run.files import plain, write_json, write_whole

    try:
        out.mkdir(parents=True, exist_ok=True)
        write_whole(out / "residual.csv", residual_table(d))
        write_whole(out / "model.yaml", yaml.safe_dump(plain(d.model), sort_keys=False, allow_unicode=True))
        write_json(out / "diagnosis.json", d.document)
        write_whole(out / "report.html", page(d))
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror}): choose another place with -o") from None
    return out


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
