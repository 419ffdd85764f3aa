"""The measurements of one record as the balance of momentum takes them: a path, rows, their noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import comb

import numpy as np

from massprops.core.robust import MAD_TO_SIGMA
from massprops.diagnosis.momentum_balance import Rows
from massprops.diagnosis.motion_path import MotionPath, nearest, path_from_attitudes, path_from_rates
from massprops.dynamics.environment import EnvironmentModel, EnvironmentState
from massprops.errors import NotPossible
from massprops.estimators.rates import LocalFit, from_attitude
from massprops.sequence.data import AttitudeSeries, Environment, RateSeries

MOST_ROWS = 300
"""Longer records are taken as means over so many equal stretches: what changes faster is noise to a rigid body."""
FEWEST_ROWS = 12
COEFFICIENTS = 4
"""Of the local cubic behind each rate of a record of attitudes (`estimators.rates`)."""
LARGEST_ROW_TURN = 0.7
"""Turn [rad] between two rows up to which a cubic follows the rate of a tumble to a thousandth."""
SMALL_TURN = 0.1
"""Turn [rad] over which the mean of a gyroscope's rates beside attitudes is the rate at the middle, to a thousandth."""
ORDER = 5
"""Of the differences that noise is taken from. A racquet turning at 15 rad/s, seen 100 times a second, still shows in third
ones: two to three times the noise."""
FEWEST_NEAR = 15
WHOLE_COUNTS = 4.0
"""Samples about one that its noise is taken from, at least, and as how many more the whole record's noise counts."""
STATED_ROWS = 100.0
"""As how many rows a stated noise counts: it is believed within about 10 %."""


@dataclass(frozen=True, kw_only=True)
class Record:
    """One record.

    Attributes:
        path: the measured motion; rows: what was measured along it; times: (m,) of the rows [s].
        noise_rows: as how many rows the noise in `rows` counts. speed: typical rate [rad/s].
        environment: what acts from outside, or None where nothing ties the axes to it. stamp: (m,) [ns].
        reach: how far in time a row looks about itself [s]; screen: the same record as rates, where its rows are
            attitudes, or None. walk: variance that the path's turn gains in a second, of the noise it is integrated from [rad^2/s].
    """

    path: MotionPath
    rows: Rows
    times: np.ndarray
    noise_rows: float
    speed: float
    environment: EnvironmentModel | None
    stamp: np.ndarray
    reach: float = 0.0
    screen: Record | None = None
    walk: float = 0.0

    @property
    def row_times(self) -> np.ndarray:
        """(all,) of every row, those of a gyroscope beside attitudes last [s]."""
        beside = self.rows.gyroscope
        return self.times if beside is None else np.concatenate([self.times, self.path.t[beside.at]])

    @property
    def row_stamp(self) -> np.ndarray:
        """(all,) of every row [ns]."""
        more = self.row_times[len(self.times) :]
        return np.concatenate([self.stamp, self.stamp[0] + np.round((more - self.times[0]) * 1e9).astype(np.int64)])

    @property
    def stated(self) -> bool:
        """Whether the noise of the rows is stated, not estimated."""
        return self.noise_rows > 1.0

    @property
    def sun(self) -> np.ndarray:
        """(n, 3) direction of the Sun along the path, body axes."""
        assert self.environment_state is not None
        return np.asarray(np.swapaxes(self.path.R, 1, 2) @ np.array(self.environment_state.sun))

    @cached_property
    def environment_state(self) -> EnvironmentState | None:
        """What acts from outside along the path, inertial axes."""
        return None if self.environment is None else self.environment.state(self.path.t)


def record_of_rates(series: RateSeries, first_ns: int | None = None) -> Record:
    """A record of a gyroscope.

    Args:
        first_ns: timestamp from which times count [ns]; else its own first.

    Raises:
        NotPossible: too few samples, or the body turns too far between two of them.
    """
    stamp, w = series.timestamp_ns, series.w
    block = max(1, len(stamp) // MOST_ROWS)
    count = len(stamp) // block
    if count < FEWEST_ROWS:
        raise NotPossible(
            f"imu0 holds {len(stamp)} rates and a diagnosis needs at least {FEWEST_ROWS}: give a longer record"
        )
    first = int(stamp[0]) if first_ns is None else first_ns
    seconds = (stamp - first) * 1e-9
    times = seconds[: count * block].reshape(count, block).mean(axis=1)
    rates = w[: count * block].reshape(count, block, 3).mean(axis=1)
    speed = float(np.median(np.linalg.norm(rates, axis=1)))
    turn = float(np.max(np.diff(times) * np.linalg.norm(rates[1:], axis=1)))
    if turn > LARGEST_ROW_TURN:
        raise NotPossible(
            f"the body turns by {np.degrees(turn):.0f} deg between two rates of imu0, too far to follow: give a faster record"
        )
    path = path_from_rates(times, rates)
    noise = np.full(count, series.sigma / np.sqrt(block)) if series.sigma else local_noise(rates)
    at = np.asarray(np.searchsorted(path.t, times))
    rows = Rows(at=at, measured=rates, sigma=noise, rates=True)
    return Record(
        path=path, rows=rows, times=times, noise_rows=STATED_ROWS if series.sigma else 1.0, speed=speed, environment=None,
        stamp=first + np.round(times * 1e9).astype(np.int64),
        walk=float(np.median(noise) ** 2 * np.median(np.diff(times))),
    )  # fmt: skip


def local_noise(values: np.ndarray) -> np.ndarray:
    """(n, k) 1-sigma of samples (n, k) about each, by component, from differences that no smooth motion has.

    A thing that shakes while its motor runs is noisier then. The variance about a sample is the mean over a twentieth of
    the record, with the whole record's (its median, so a burst has no part in it) as some more samples.
    """
    from scipy.ndimage import uniform_filter1d

    square = np.diff(values, ORDER, axis=0) ** 2 / comb(2 * ORDER, ORDER)
    whole = MAD_TO_SIGMA**2 * np.median(square, axis=0)
    window = max(FEWEST_NEAR, len(values) // 20)
    near = uniform_filter1d(square, window, axis=0, mode="nearest")
    near = np.pad(near, ((ORDER // 2, ORDER - ORDER // 2), (0, 0)), mode="edge")
    return np.maximum(np.sqrt((window * near + WHOLE_COUNTS * whole) / (window + WHOLE_COUNTS)), 1e-12)


def record_of_attitudes(
    series: AttitudeSeries, given: Environment, rates: RateSeries | None = None, first_ns: int | None = None
) -> Record:
    """A record of attitudes, turned into inertial axes by the chaser's own, with a gyroscope's rates beside them or
    without.

    Args:
        first_ns: timestamp from which times count [ns], those of what acts from outside and of a measured wheel too; else the
            first of both.

    Raises:
        NotPossible: too few attitudes.
    """
    from massprops.dynamics.chaser_path import chaser_path
    from massprops.dynamics.quaternion import multiply

    stamp, q, sigma = series.timestamp_ns, series.q, series.sigma
    step = max(1, len(stamp) // MOST_ROWS)
    stamp, q, sigma = stamp[::step], q[::step], sigma[::step]
    if len(stamp) < FEWEST_ROWS:
        raise NotPossible(
            f"attitude0 holds {len(stamp)} attitudes and a diagnosis needs at least {FEWEST_ROWS}: give a longer record"
        )
    begins = (int(s.timestamp_ns[0]) for s in (series, rates) if s is not None and len(s.timestamp_ns))
    first = min(begins) if first_ns is None else first_ns
    times = (stamp - first) * 1e-9
    q = multiply(chaser_path(given, times).q, q)
    local = from_attitude(times, q, sigma[:, None, None] ** 2 * np.eye(3))
    fine = np.isfinite(local.w).all(axis=1)
    if fine.sum() < FEWEST_ROWS:
        raise NotPossible(
            "the attitudes of attitude0 lie too far apart to show a rate: give a record with more of them"
        )
    w = np.stack([np.interp(times, times[fine], local.w[fine, k]) for k in range(3)], axis=1)
    # the attitudes themselves, not smoothed: smoothing bends the path where something happens at once
    gyroscope = None if rates is None else _beside(times, rates, first)
    path = path_from_attitudes(times, q, w, None if gyroscope is None else gyroscope.times)
    at = np.asarray(np.searchsorted(path.t, times))
    environment = EnvironmentModel(given)
    speed = float(np.median(np.linalg.norm(w, axis=1)))
    record = Record(
        path=path, times=times,
        rows=Rows(
            at=at, measured=np.zeros((len(at), 3)), sigma=sigma, rates=False,
            gyroscope=None if gyroscope is None else gyroscope.rows(path),
        ),
        noise_rows=STATED_ROWS, speed=speed, environment=environment, stamp=stamp,
        screen=_as_rates(times, local, environment, stamp, speed),
    )  # fmt: skip
    return along(record, path, q)


@dataclass(frozen=True, kw_only=True)
class _Gyroscope:
    """Rates w (g, 3) [rad/s] beside attitudes, at times (g,) [s], with their 1-sigma (g, 3)."""

    times: np.ndarray
    w: np.ndarray
    sigma: np.ndarray

    def rows(self, path: MotionPath) -> Rows:
        """Along a path that has points at the times."""
        return Rows(at=nearest(path.t, self.times), measured=self.w, sigma=self.sigma, rates=True)


def _beside(times: np.ndarray, rates: RateSeries, first: int) -> _Gyroscope | None:
    """The rates within the times (m,) of attitudes, as means over stretches in which the body turns little; None of none.

    Args:
        first: stamp from which times count [ns].
    """
    since = (rates.timestamp_ns - first) * 1e-9
    in_span = (since >= times[0]) & (since <= times[-1])
    since, w = since[in_span], rates.w[in_span]
    if len(since) < FEWEST_ROWS:
        return None
    sigma = np.maximum(rates.sigma or 0.0, np.median(local_noise(w), axis=0))
    gap = float(np.median(np.diff(since)))
    turn = gap * float(np.max(np.linalg.norm(w, axis=1)))
    block = max(1, min(len(since) // MOST_ROWS, int(SMALL_TURN / max(turn, 1e-300))))
    count = len(since) // block
    every = slice(None, None, max(1, count // MOST_ROWS))
    middle = since[: count * block].reshape(count, block).mean(axis=1)[every]
    mean = w[: count * block].reshape(count, block, 3).mean(axis=1)[every]
    return _Gyroscope(times=middle, w=mean, sigma=np.tile(sigma / np.sqrt(block), (len(middle), 1)))


def _as_rates(
    times: np.ndarray, local: LocalFit, environment: EnvironmentModel, stamp: np.ndarray, speed: float
) -> Record:
    """A record of attitudes as rates by local polynomials, whose rows carry the attitudes' errors too: those times the
    momentum. Neighbours share most of their samples, so each counts as its part of a polynomial's four coefficients."""
    fine = np.flatnonzero(np.isfinite(local.w).all(axis=1))
    t, q, w = times[fine], local.q[fine], local.w[fine]
    spread = np.einsum("nii->ni", local.covariance[fine])
    square = spread[:, 3:].mean(axis=1) + np.sum(w**2, axis=1) * spread[:, :3].mean(axis=1)
    sigma = np.sqrt(square * max(1.0, local.window / COEFFICIENTS))
    path = path_from_attitudes(t, q, w)
    rows = Rows(at=np.asarray(np.searchsorted(path.t, t)), measured=w, sigma=sigma, rates=True)
    return Record(
        path=path, rows=rows, times=t, noise_rows=STATED_ROWS, speed=speed, environment=environment, stamp=stamp[fine],
        reach=0.5 * local.window * float(np.median(np.diff(times))),
    )  # fmt: skip


def along(record: Record, path: MotionPath, q: np.ndarray) -> Record:
    """The record of attitudes q (m, 4) along another path."""
    from massprops.dynamics.quaternion import conjugate, multiply, rotation_vector

    turn = rotation_vector(multiply(conjugate(path.q[record.rows.at]), q))
    moved = replace(record, path=path, rows=replace(record.rows, measured=turn))
    if path.t is record.path.t:  # what acts from outside depends on time alone
        vars(moved)["environment_state"] = record.environment_state
    return moved


def in_turned_axes(record: Record, turn: np.ndarray) -> Record:
    """The record in body axes of which its own are turned by `turn` (3,) [rad]."""
    from massprops.dynamics.quaternion import from_rotation_vector, multiply, rotation_matrix

    by = from_rotation_vector(turn)
    C = rotation_matrix(by)
    path = replace(record.path, q=multiply(record.path.q, by), w=record.path.w @ C)
    beside = record.rows.gyroscope
    if beside is not None:
        beside = replace(beside, measured=beside.measured @ C)
    rows = replace(record.rows, measured=record.rows.measured @ C, gyroscope=beside)
    return replace(record, path=path, rows=rows)


def with_points(record: Record, more: np.ndarray) -> Record:
    """The record along the same path with points at further times (k,) [s], where something changes within a step."""
    old, rows = record.path, record.rows
    path = path_from_attitudes(old.t, old.q, old.w, more[(more > old.t[0]) & (more < old.t[-1])])
    beside = rows.gyroscope
    if beside is not None:
        beside = replace(beside, at=nearest(path.t, old.t[beside.at]))
    rows = replace(rows, at=nearest(path.t, old.t[rows.at]), gyroscope=beside)
    return replace(record, path=path, rows=rows)


def attitudes_of(record: Record) -> np.ndarray:
    """(m, 4) attitudes that the record's rows hold."""
    from massprops.dynamics.quaternion import from_rotation_vector, multiply

    return multiply(record.path.q[record.rows.at], from_rotation_vector(record.rows.measured))
