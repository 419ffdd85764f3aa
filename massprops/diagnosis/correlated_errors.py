"""Errors of attitudes that are alike in time, as those of a camera are: a first-order autoregression of the stated size.

The stated noise is that of each attitude by itself. How long its error stays is not stated: with a time constant T, errors dt
apart are alike by exp(-dt / T), and a fit works on what each holds beyond what the one before it foretold.
"""

from __future__ import annotations

import numpy as np

from massprops.diagnosis.record import Record


def innovations(rows: np.ndarray, record: Record, memory: float) -> np.ndarray:
    """Rows (3 all,) or (3 all, k) over their noise, those of attitudes as independent parts of unit variance."""
    part = _foretold(record, memory)
    if part is None:
        return rows
    m = len(record.times)
    attitude_rows = rows[: 3 * m].reshape(m, 3, -1)
    new = attitude_rows.copy()
    new[1:] = (attitude_rows[1:] - part[:, None, None] * attitude_rows[:-1]) / np.sqrt(1.0 - part**2)[:, None, None]
    return np.concatenate([new.reshape(rows[: 3 * m].shape), rows[3 * m :]])


def log_density(record: Record, memory: float) -> float:
    """What the density of the innovations lacks to that of the rows."""
    part = _foretold(record, memory)
    return 0.0 if part is None else float(-1.5 * np.sum(np.log1p(-(part**2))))


def _foretold(record: Record, memory: float) -> np.ndarray | None:
    """(m - 1,) part of each error that the next one keeps; None where errors are independent."""
    return None if memory <= 0.0 or record.rows.rates else np.exp(-np.diff(record.times) / memory)
