"""Whether a record with an accelerometer is free flight: off the centre of mass, a rigid body's sensor feels nothing but

    a = w' x r + w x (w x r)

with one lever r for the whole record. What one lever does not explain is a hand, the ground, or the air.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.documents.tables import ACCELEROMETER
from massprops.errors import NotPossible
from massprops.geometry.vectors import skew
from massprops.sequence.data import Sequence

HELD = 3.0
"""Specific force [m/s^2] beyond what one lever explains from which a record is no free flight. A third of the Earth's
gravity: a hand that holds the body feels all of it. The flights leave 0.05 to 0.26, and at most 0.5 in the middle of a tenth. A constant in body axes above it is gravity on
a body that turns about the vertical: in the flights it is 0.04 to 0.25."""
PARTS = 10
"""Of a record, of which a hand may hold one."""
SMALL_TURN = 0.1
"""Of the body [rad] over which rates and accelerations are averaged."""


LONGEST_HEADER = 2000
FEWEST = 12


@dataclass(frozen=True, kw_only=True)
class Lever:
    """From the centre of mass to the sensor: r (3,) and its 1-sigma [m], body axes; left: rms specific force that it does
    not explain [m/s^2]; offset: (3,) constant of the accelerometer [m/s^2]; worst: the most that it leaves in the middle of the samples
    of a tenth of the record [m/s^2], and that tenth's times [s]."""

    r: np.ndarray
    sigma: np.ndarray
    left: float
    offset: np.ndarray
    worst: tuple[float, float, float]


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
    H = X.T @ X + np.diag(prior**2)
    x = np.linalg.solve(H, X.T @ y)
    beyond = (y - X @ x).reshape(-1, 3)
    residual_rms = float(np.sqrt(np.mean(beyond**2)))
    # a hand holds on, a knock is over at once
    parts = np.array_split(np.arange(len(times)), min(PARTS, len(times)))
    worst = max(
        (float(np.median(np.linalg.norm(beyond[p], axis=1))), float(times[p[0]]), float(times[p[-1]])) for p in parts
    )
    sigma = residual_rms * np.sqrt(np.diag(np.linalg.inv(H)))[:3]
    return Lever(r=x[:3], sigma=sigma, left=residual_rms, offset=x[3:], worst=worst)


def accelerations(sequence: Sequence) -> tuple[np.ndarray, np.ndarray] | None:
    """Timestamps (m,) [ns] and specific force (m, 3) [m/s^2] of imu0; None where its table has no such columns.

    Raises:
        InputError: the columns are there and cannot be read.
    """
    from massprops.sequence.table import read_table

    path = None if sequence.folder is None else sequence.folder / "imu0" / "data.csv"
    if path is None or not path.is_file():
        return None
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        header = file.readline(LONGEST_HEADER)
    if not any(name in header for name in ACCELEROMETER.columns[1].others + ("a_x",)):
        return None
    table = read_table(path, ACCELEROMETER).columns
    return table["timestamp"], np.column_stack([table[k] for k in ("a_x", "a_y", "a_z")])


def lever_of(sequence: Sequence, middle: np.ndarray, w: np.ndarray) -> Lever | None:
    """The lever of rates (n, 3) [rad/s] about timestamps (n,) [ns] that come with accelerations, of which means about the same
    times are taken."""
    measured = accelerations(sequence)
    if measured is None or len(middle) < FEWEST:
        return None
    stamp, force = measured
    edges = np.concatenate([[middle[0] - 1], (middle[1:] + middle[:-1]) // 2, [stamp[-1]]])
    part = np.clip(np.searchsorted(edges, stamp, side="left") - 1, 0, len(middle) - 1)
    count = np.bincount(part, minlength=len(middle))
    sums = np.stack([np.bincount(part, force[:, k], minlength=len(count)) for k in range(3)], axis=1)
    good = count > 0
    if good.sum() < FEWEST:
        return None
    return lever((middle[good] - middle[0]) * 1e-9, w[good], sums[good] / count[good, None])


def check_free_flight(sequence: Sequence) -> Lever | None:
    """The lever, or None where there is no accelerometer.

    Raises:
        NotPossible: one lever does not explain what the accelerometer felt.
    """
    rates = sequence.rates
    if rates is None or len(rates.w) < FEWEST:
        return None
    stamp, w = rates.timestamp_ns, rates.w
    turn = float(np.median(np.linalg.norm(w, axis=1)) * np.median(np.diff(stamp)) * 1e-9)
    block = int(np.clip(SMALL_TURN / max(turn, 1e-300), 1, len(w) // FEWEST))
    count = len(w) // block
    middle = stamp[: count * block].reshape(count, block)
    since = np.mean(middle - stamp[0], axis=1).astype(np.int64)
    fitted_lever = lever_of(sequence, stamp[0] + since, w[: count * block].reshape(count, block, 3).mean(axis=1))
    if fitted_lever is None:
        return None
    felt, start, end = fitted_lever.worst
    begun = (int(stamp[0]) + int(since[0]) - sequence.first_ns) * 1e-9
    when = f" from {begun + start:.4g} to {begun + end:.4g} s"
    if max(fitted_lever.left, float(np.linalg.norm(fitted_lever.offset))) > max(felt, HELD):
        felt, when = max(fitted_lever.left, float(np.linalg.norm(fitted_lever.offset))), ""
    if felt > HELD:
        raise NotPossible(
            f"imu0 measures {felt:.1f} m/s^2{when} that no distance from the centre of mass explains, so this is no free "
            "flight: cut the record to the flight"
        )
    return fitted_lever
