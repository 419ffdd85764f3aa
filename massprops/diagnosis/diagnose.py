"""A diagnosis by the balance of momentum: sequence in, document and model out."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from massprops.core.robust import rms
from massprops.diagnosis import criteria
from massprops.diagnosis.candidate import Selection
from massprops.diagnosis.document import blind_reason, document_of_selection, model_of_selection
from massprops.diagnosis.hypothesis_fit import torque_sd
from massprops.diagnosis.measured_beside import effects_beside, of_one_wheel
from massprops.diagnosis.motion_path import LARGEST_STEP, MOST_POINTS
from massprops.diagnosis.record import FEWEST_ROWS, Record, record_of_attitudes, record_of_rates
from massprops.diagnosis.residual_rows import HEAD, torque_rows
from massprops.diagnosis.selection import select
from massprops.diagnosis.set_clock import refuse_set_clock
from massprops.diagnosis.unnamed import rigid_body_alone
from massprops.effects import in_place
from massprops.errors import InputError, NotPossible
from massprops.sensing.check import check_sensors
from massprops.sequence.data import Sequence


@dataclass(frozen=True, kw_only=True)
class BalanceDiagnosis:
    """What was found.

    Attributes:
        document: the content of `diagnosis.json`; model: of `model.yaml`; record, selection: the work behind them.
        law: files of a law that was discovered, by name.
    """

    document: dict[str, Any]
    model: dict[str, Any]
    record: Record
    selection: Selection
    law: dict[str, str | bytes] = field(default_factory=dict)


def decides(sequence: Sequence) -> bool:
    """Whether the balance of momentum decides by itself: body rates of a short record, or attitudes with or without body
    rates beside them, and nothing else measured."""
    if sequence.tracks is not None or sequence.range is not None:
        return False
    if sequence.attitude is None and sequence.rates is not None and len(sequence.rates.w):
        return _turn(sequence.rates.timestamp_ns * 1e-9, sequence.rates.w) < criteria.MOST_TURN
    if sequence.attitude is not None and len(sequence.attitude.q) >= FEWEST_ROWS:
        try:
            record = record_of_attitudes(sequence.attitude, sequence.environment)
        except NotPossible:  # too thin for polynomials
            return False
        return bool(_turn(record.path.t, record.path.w) < LARGEST_STEP * MOST_POINTS)
    return False


def _turn(times: np.ndarray, w: np.ndarray) -> float:
    """Turn of a record over all [rad]."""
    speed = np.linalg.norm(w, axis=1)
    return float(np.sum(np.diff(times) * 0.5 * (speed[1:] + speed[:-1])))


def diagnose_by_balance(
    sequence: Sequence, progress: Callable[[str, int, int], None] = lambda what, done, total: None
) -> BalanceDiagnosis:
    """What a record of body rates, of attitudes or of both lacks beside a free rigid body.

    `body.yaml` has no say: an inertia that is wrong would be paid for by an effect.

    Raises:
        NotPossible: too few measurements, or too far apart, or such as `check_sensors` refuses.
    """
    with in_place(effects_beside(sequence)):
        return _diagnosed(sequence, progress)


def _diagnosed(sequence: Sequence, progress: Callable[[str, int, int], None]) -> BalanceDiagnosis:
    warnings = list(sequence.warnings)
    lever = check_sensors(sequence)
    record = _record(sequence)
    turn = _turn(record.path.t, record.path.w)
    blind = turn < criteria.LEAST_TURN
    selection = _without_effects(record, turn) if blind else select(record, progress)
    if record.rows.rates and sequence.rates is not None and sequence.rates.sigma is None:
        warnings.append(
            f"imu0 states no noise: {_noise(selection):.3g} rad/s estimated, which no smooth torque can follow"
        )
    document = document_of_selection(selection, warnings)
    if blind:
        document["reason"] = blind_reason(turn)
    if lever is not None:
        document["lever"] = {"sensor_from_centre_of_mass_m": lever.r, "sigma": lever.sigma, "left_m_s2": lever.left}
    return BalanceDiagnosis(document=document, model=model_of_selection(selection), record=record, selection=selection)


def _without_effects(record: Record, turn: float) -> Selection:
    """The free body alone, for a record that shows too little of a turn to be searched.

    Raises:
        NotPossible: it shows nothing at all, as of a body that stands still.
    """
    try:
        return rigid_body_alone(record)
    except NotPossible:
        raise NotPossible(blind_reason(turn)) from None


def diagnose_several(
    sequences: dict[str, Sequence], progress: Callable[[str, int, int], None] = lambda what, done, total: None
) -> dict[str, Any]:
    """What several records of one body lack beside a free rigid body: the content of `diagnosis.json`.

    Args:
        sequences: of body rates alone or of attitudes, by name; their body axes are the same.

    Raises:
        InputError: a record holds something else, or its wheel is another one by what `rotor0` states.
        NotPossible: see `diagnose_by_balance`.
    """
    from massprops.diagnosis.several import together
    from massprops.diagnosis.several_document import document_of_together

    for name, sequence in sequences.items():
        if not decides(sequence):
            raise InputError(
                f"{name}: several records are compared by attitudes, or by body rates over at most ten turns, and this one "
                "holds neither: diagnose it by itself"
            )
    diagnoses = [diagnose_by_balance(s, progress) for s in of_one_wheel(sequences).values()]
    joint = together([f.selection for f in diagnoses])
    return document_of_together(joint, list(sequences), [f.document for f in diagnoses])


def write_several(document: dict[str, Any], out: Path, inputs: Iterable[Path], force: bool = False) -> None:
    """`diagnosis.json` of several records (see `diagnose_several`) in the folder `out`.

    Raises:
        InputError: the folder holds files that no diagnosis wrote, or cannot be written.
    """
    from massprops.core.files import json_text
    from massprops.core.outputs import deliver

    deliver(out, "diagnose", {"diagnosis.json": json_text(document)}, None, list(inputs), force)


def _record(sequence: Sequence) -> Record:
    if sequence.attitude is None:
        assert sequence.rates is not None
        record = record_of_rates(sequence.rates, sequence.first_ns)
        refuse_set_clock(sequence.rates)
        return record
    return record_of_attitudes(sequence.attitude, sequence.environment, sequence.rates, sequence.first_ns)


def _noise(s: Selection) -> float:
    return rms(s.noise * s.base.record.rows.spread.reshape(-1, 3))


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
        **d.law,
    }


def residual_table(d: BalanceDiagnosis) -> str:
    """Residuals before and after by measurement, and where no effect is named the likeliest unknown torque with its 1-sigma."""
    lines = [HEAD]
    s = d.selection
    before = s.base.residual / s.noise
    after = (s.named[0].alone if s.named else s.base).residual / s.noise
    kinds = ["rate" if d.record.rows.rates else "attitude"] * len(d.record.stamp)
    kinds += ["rate"] * (len(before) - len(kinds))
    for t, kind, b, a in zip(d.record.row_stamp, kinds, before, after, strict=True):
        lines += [f"{t},{kind},,,{name},{b[k]:.4f},{a[k]:.4f}" for k, name in enumerate("xyz")]
    if s.verdict == "unexplained":
        fit, at = s.likeliest_unknown, d.record.rows.at
        lines += torque_rows(d.record.stamp, fit.torque[at], torque_sd(fit)[at])
    return "\n".join(lines) + "\n"
