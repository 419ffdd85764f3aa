"""Whether a record with an accelerometer is free flight: off the centre of mass, a rigid body's sensor feels nothing but

    a = w' x r + w x (w x r)

with one lever r for the whole record. What one lever does not explain is a hand, the ground, or the air.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.diagnosis.momentum_balance import skew
from massprops.diagnosis.record import Record
from massprops.sequence.data import Sequence

HELD = 3.0
"""Specific force [m/s^2] beyond what one lever explains from which a record is no free flight. A third of the Earth's
gravity: a hand that holds the body feels all of it. The odd flights leave 0.1 to 0.8."""


@dataclass(frozen=True, kw_only=True)
class Lever:
    """From the centre of mass to the sensor: r (3,) and its 1-sigma [m], body axes; left: rms specific force that it does
    not explain [m/s^2]; offset: (3,) constant of the accelerometer [m/s^2]."""

    r: np.ndarray
    sigma: np.ndarray
    left: float
    offset: np.ndarray


def lever(times: np.ndarray, w: np.ndarray, acceleration: np.ndarray) -> Lever:
    """The lever that explains specific force best.

    Args:
        times: (m,) [s]; w: (m, 3) body rates [rad/s], smooth enough to be differentiated; acceleration: (m, 3) specific
            force in body axes [m/s^2].
    """
    rate = np.gradient(w, times, axis=0)
    columns = skew(rate) + skew(w) @ skew(w)
    X = np.concatenate([columns, np.broadcast_to(np.eye(3), columns.shape)], axis=2).reshape(-1, 6)
    y = acceleration.reshape(-1)
    # the accelerometer's offset is some hundredths of g: more of it would be gravity itself
    prior = np.concatenate([np.zeros(3), np.full(3, 1.0 / 0.5)])
    noise = 1.0
    H = X.T @ X + np.diag((noise * prior) ** 2)
    x = np.linalg.solve(H, X.T @ y)
    left = float(np.sqrt(np.mean((y - X @ x) ** 2)))
    return Lever(r=x[:3], sigma=left * np.sqrt(np.diag(np.linalg.inv(H)))[:3], left=left, offset=x[3:])


def lever_of(sequence: Sequence, record: Record) -> Lever | None:
    """The lever of a record whose rates come with accelerations, as means over the record's own stretches."""
    assert sequence.rates is not None
    acceleration = sequence.rates.acceleration
    if acceleration is None:
        return None
    block = len(sequence.rates.w) // len(record.times)
    means = acceleration[: block * len(record.times)].reshape(len(record.times), block, 3).mean(axis=1)
    good = np.isfinite(means).all(axis=1)
    return lever(record.times[good], record.rows.measured[good], means[good]) if good.sum() >= 6 else None


def held_warning(sequence: Sequence, record: Record) -> str:
    """A line that says so where the record is no free flight; empty where it is, or nothing shows it."""
    found = lever_of(sequence, record)
    if found is None or found.left < HELD:
        return ""
    return (
        f"imu0 feels {found.left:.1f} m/s^2 that no lever from the centre of mass explains: this is no free flight; cut the "
        "record to the flight"
    )
