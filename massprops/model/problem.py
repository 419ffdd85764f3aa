"""A sequence as every estimator takes it: epochs in order, one row of measurements each, NaN where there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from massprops.core.robust import mad_sigma
from massprops.errors import InputError
from massprops.memory import refuse_beyond
from massprops.sensing.pinhole import Pinhole, pinhole_of
from massprops.sequence.data import Body, Camera, Environment, RangeSeries, RateSeries, Sequence

DEFAULT_SIGMA_PX = 0.5
FEWEST_EPOCHS = 4
BYTES_A_PIXEL = 64
"""A pixel position is 16 bytes; estimators hold it with its prediction and residuals: four copies are reckoned with (not measured)."""
LONG_ENOUGH = 64
"""Rates from which their noise can be told."""
MOST_MEANS = 120
"""Means that a record of correlated rates is reduced to, at least."""
CORRELATED = 0.2
"""Correlation of noise that still counts as such."""


@dataclass(frozen=True)
class Problem:
    """n epochs, c cameras, m features.

    Attributes:
        stamp_ns: (n,) int64 timestamps; times: (n,) seconds since the first.
        cameras: c pinhole cameras in cam0's frame.
        uv: (n, c, m, 2) pixels without distortion, NaN where a feature is not seen; sigma_px: (c,) 1-sigma.
        features: (m,) the sequence's numbers of the features.
        range_m: (n,) distance from cam0 to the centre of mass, NaN where none; sigma_range [m].
        rates: (n, 3) body rates [rad/s], NaN where none; sigma_rate [rad/s].
        attitude: (n, 4) body to cam0, NaN where none; sigma_attitude: (n,) [rad].
        body, environment: what the sequence assumes and knows.
        warnings: what was left out or assumed.
        rate_memory: epochs over which errors of the body rates stay alike; 1 for white noise.
        alike: how many times wider attitudes' sigmas have been made because their errors hang together
            (`attitude_noise`); so do those of one camera's pixels that they were found from. 1 for white noise.
        own_attitudes: the attitudes come from a sensor of their own, and not from the images of the tracks.
    """

    stamp_ns: np.ndarray
    times: np.ndarray
    cameras: tuple[Pinhole, ...]
    uv: np.ndarray
    sigma_px: np.ndarray
    features: np.ndarray
    range_m: np.ndarray
    sigma_range: float
    rates: np.ndarray
    sigma_rate: float
    attitude: np.ndarray
    sigma_attitude: np.ndarray
    body: Body | None = None
    environment: Environment = field(default_factory=Environment)
    warnings: tuple[str, ...] = ()
    rate_memory: int = 1
    alike: float = 1.0
    own_attitudes: bool = True

    @staticmethod
    def of_tracks(
        times: np.ndarray,
        cameras: tuple[Pinhole, ...],
        uv: np.ndarray,
        sigma_px: float,
        environment: Environment | None = None,
    ) -> Problem:
        """What cameras see of features, uv (n, c, m, 2), at times (n,) [s], and nothing else."""
        n, c, m = uv.shape[:3]
        stamp, none = np.round(times * 1e9).astype(np.int64), np.full(n, np.nan)
        vector, quaternion = np.full((n, 3), np.nan), np.full((n, 4), np.nan)
        return Problem(
            stamp_ns=stamp, times=times, cameras=cameras, uv=uv, sigma_px=np.full(c, sigma_px), features=np.arange(m),
            range_m=none, sigma_range=np.nan, rates=vector, sigma_rate=np.nan, attitude=quaternion, sigma_attitude=none,
            environment=environment or Environment(),
        )  # fmt: skip

    def of_epochs(self, change: Callable[[np.ndarray], np.ndarray]) -> Problem:
        """The problem with what it has for each epoch (n, ...) changed: some epochs of it, or more."""
        names = ("stamp_ns", "times", "uv", "range_m", "rates", "attitude", "sigma_attitude")
        changed: dict[str, Any] = {name: change(getattr(self, name)) for name in names}
        return replace(self, **changed)

    @property
    def first_ns(self) -> int:
        """The timestamp from which `times` count [ns]: the sequence's first, before the first of means of rates."""
        return int(self.stamp_ns[0] - np.round(self.times[0] * 1e9))

    def stamps(self, times: np.ndarray) -> np.ndarray:
        """(n,) int64 timestamps [ns] of times (n,) [s] as `times` counts them."""
        return self.first_ns + np.round(np.asarray(times) * 1e9).astype(np.int64)

    @property
    def seen(self) -> np.ndarray:
        """(n, c, m) True where a feature was measured."""
        return np.asarray(np.isfinite(self.uv[..., 0]))

    @property
    def has_tracks(self) -> bool:
        return bool(self.uv.shape[2]) and bool(self.seen.any())

    @property
    def stereo(self) -> bool:
        """Two cameras see common features at the same times."""
        return len(self.cameras) == 2 and bool((self.seen[:, 0] & self.seen[:, 1]).any())

    @property
    def has_range(self) -> bool:
        return bool(np.isfinite(self.range_m).any())

    @property
    def has_rates(self) -> bool:
        return bool(np.isfinite(self.rates).any())

    @property
    def has_attitude(self) -> bool:
        return bool(np.isfinite(self.attitude).any())


def problem_of(sequence: Sequence, most_features: int = 300) -> Problem:
    """The sequence's measurements on common epochs.

    Features seen fewer than three times say nothing about motion and are left out, with a warning that counts them;
    of more than `most_features` those seen longest are kept.

    Raises:
        InputError: nothing that moves was measured, too few epochs, tracks without intrinsics, or a baseline of zero.
    """
    warnings = list(sequence.warnings)
    memory, first = 1, sequence.first_ns
    if sequence.rates is not None and sequence.rates.sigma is None and len(sequence.rates.w) >= LONG_ENOUGH:
        rates_given, memory = _thinned(sequence.rates, warnings)
        sequence = replace(sequence, rates=rates_given)
    sequence = _with_usable_tracks(sequence, warnings)
    stamp = _epochs(sequence)
    n = len(stamp)
    numbers, cameras = _cameras(sequence)
    features = np.zeros(0, np.int64)
    uv = np.full((n, len(cameras), 0, 2), np.nan)
    if sequence.tracks is not None:
        features, uv = _tracks(sequence, numbers, stamp, most_features, warnings)
        if len(cameras) == 2 and not (np.isfinite(uv[:, 0, :, 0]) & np.isfinite(uv[:, 1, :, 0])).any():
            apart = "the two cameras never see a feature at the same time: bring tracks0 to one clock"
            if sequence.attitude is None and sequence.rates is None:
                raise InputError(f"{_name(sequence)}: {apart}")
            warnings.append(apart)
    sigma_px = np.array([_sigma_px(sequence.cameras[k], k, warnings) for k in numbers])
    span = sequence.range or RangeSeries(np.zeros(0, int), np.zeros(0))
    template = "range0 states no sigma_m: {:.3g} m estimated from the data"
    ranges, sigma_range = _on_epochs(stamp, span.timestamp_ns, span.range_m, span.sigma_m, template, warnings)
    turning = sequence.rates or RateSeries(np.zeros(0, int), np.zeros((0, 3)))
    template = "imu0 states no noise: {:.3g} rad/s estimated from the data"
    rates, sigma_rate = _on_epochs(stamp, turning.timestamp_ns, turning.w, turning.sigma, template, warnings)
    attitude, sigma_attitude = np.full((n, 4), np.nan), np.full(n, np.nan)
    if sequence.attitude is not None and len(sequence.attitude.q):
        at = np.searchsorted(stamp, sequence.attitude.timestamp_ns)
        attitude[at], sigma_attitude[at] = sequence.attitude.q, sequence.attitude.sigma
    return Problem(
        stamp_ns=stamp,
        times=(stamp - first) * 1e-9,
        cameras=cameras,
        uv=uv,
        sigma_px=sigma_px,
        features=features,
        range_m=ranges,
        sigma_range=float(sigma_range),
        rates=rates,
        sigma_rate=float(sigma_rate),
        attitude=attitude,
        sigma_attitude=sigma_attitude,
        body=sequence.body,
        environment=sequence.environment,
        warnings=tuple(warnings),
        rate_memory=memory,
        own_attitudes=not sequence.of_run,
    )


def _name(sequence: Sequence) -> str:
    return str(sequence.folder or "sequence")


def _with_usable_tracks(sequence: Sequence, warnings: list[str]) -> Sequence:
    """The sequence without tracks0 where that is empty.

    Raises:
        InputError: nothing else was measured, or the tracks' camera is not described.
    """
    tracks = sequence.tracks
    if tracks is None:
        return sequence
    if not len(tracks.feature):
        if sequence.attitude is None and sequence.rates is None:
            raise InputError(
                f"{_name(sequence)}: tracks0 is empty, and there is no attitude0 or imu0: give one of the three"
            )
        warnings.append("tracks0 is empty and is not used")
        return replace(sequence, tracks=None)
    if 0 not in sequence.cameras:
        raise InputError(f"{_name(sequence)}: tracks0 needs cam0/sensor.yaml with intrinsics: [fu, fv, cu, cv]")
    return sequence


def _epochs(sequence: Sequence) -> np.ndarray:
    """(n,) all times [ns] at which something was measured.

    Raises:
        InputError: nothing that moves was, or too few.
    """
    moving = (sequence.tracks, sequence.rates, sequence.attitude)
    stamps = [s.timestamp_ns for s in moving if s is not None]
    if not stamps:
        raise InputError(f"{_name(sequence)}: nothing to estimate from: give tracks0, attitude0 or imu0")
    if sequence.range is not None:
        stamps.append(sequence.range.timestamp_ns)
    stamp: np.ndarray = np.unique(np.concatenate(stamps))
    if len(stamp) < FEWEST_EPOCHS:
        raise InputError(
            f"{_name(sequence)}: {len(stamp)} epochs are too few to show a motion: give at least {FEWEST_EPOCHS}"
        )
    return stamp


def _cameras(sequence: Sequence) -> tuple[list[int], tuple[Pinhole, ...]]:
    """Numbers of the cameras that tracked something, and these.

    Raises:
        InputError: two stand in one place.
    """
    tracks, first = sequence.tracks, sequence.cameras.get(0)
    if tracks is None or first is None:
        return [], ()
    numbers = [k for k in sorted(sequence.cameras) if k == 0 or bool((tracks.camera == k).any())]
    cameras = tuple(pinhole_of(sequence.cameras[k], first) for k in numbers)
    if len(cameras) == 2 and np.linalg.norm(cameras[1].t) < 1e-9:
        raise InputError(f"{_name(sequence)}: the stereo baseline is zero: give T_BS of cam1 in cam1/sensor.yaml")
    return numbers, cameras


def _on_epochs(
    stamp: np.ndarray, at: np.ndarray, values: np.ndarray, stated: float | None, said: str, warnings: list[str]
) -> tuple[np.ndarray, float]:
    """Values (k, ...) of the times `at` at all epochs, NaN where there is none, and their 1-sigma, told from the data with a
    warning where none is stated."""
    out = np.full((len(stamp), *values.shape[1:]), np.nan)
    if not len(values):
        return out, np.nan
    out[np.searchsorted(stamp, at)] = values
    sigma = stated or _spread(values.reshape(len(values), -1))
    if stated is None:
        warnings.append(said.format(sigma))
    return out, sigma


def _tracks(
    sequence: Sequence, numbers: list[int], stamp: np.ndarray, most: int, warnings: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    tracks = sequence.tracks
    assert tracks is not None
    known, place, count = np.unique(tracks.feature, return_inverse=True, return_counts=True)
    good = count >= 3
    if not good.all():
        warnings.append(f"tracks0: {int((~good).sum())} features were seen fewer than three times and are left out")
    if good.sum() > most:
        warnings.append(f"tracks0: the {most} longest of {int(good.sum())} tracks are used")
        order = np.lexsort((known, -count))
        good &= np.isin(np.arange(len(known)), order[:most])
    refuse_beyond(
        BYTES_A_PIXEL * len(stamp) * len(numbers) * int(good.sum()),
        f"tracks0: {len(stamp)} epochs of {int(good.sum())} features in {len(numbers)} cameras",
        "use fewer features or a shorter record",
    )
    column = np.cumsum(good) - 1
    rows = good[place]
    uv = np.full((len(stamp), len(numbers), int(good.sum()), 2), np.nan)
    for c, k in enumerate(numbers):
        of_camera = rows & (tracks.camera == k)
        at = np.searchsorted(stamp, tracks.timestamp_ns[of_camera])
        uv[at, c, column[place[of_camera]]] = _without_distortion(sequence.cameras[k], tracks.uv[of_camera])
    return known[good], uv


def _without_distortion(camera: Camera, uv: np.ndarray) -> np.ndarray:
    if not len(uv) or not np.any(camera.distortion):
        return uv
    import cv2

    fu, fv, cu, cv = camera.intrinsics
    K = np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1.0]])
    done: np.ndarray = cv2.undistortPoints(uv[:, None].astype(float), K, camera.distortion.astype(float), P=K)
    return done[:, 0]


def _sigma_px(camera: Camera, number: int, warnings: list[str]) -> float:
    if camera.sigma_px is None:
        warnings.append(no_sigma_px(number))
        return DEFAULT_SIGMA_PX
    return camera.sigma_px


def no_sigma_px(number: int) -> str:
    """The warning for a camera that states no noise."""
    return f"cam{number} states no sigma_px: {DEFAULT_SIGMA_PX} px is assumed"


def _thinned(rates: RateSeries, warnings: list[str]) -> tuple[RateSeries, int]:
    """Body rates of unknown noise as means over stretches as long as that noise stays correlated, with its 1-sigma.

    Noise is what a polynomial, of a degree that follows the body's turning, leaves over. Also given: over how many of the means
    their errors stay alike.
    """
    times = (rates.timestamp_ns - rates.timestamp_ns[0]) * 1e-9
    w = rates.w
    turn = float(np.sum(np.linalg.norm(w[1:], axis=1) * np.diff(times)))
    degree = int(min(4 + round(2 * turn), len(times) // 8, 60))
    fit = np.polynomial.chebyshev.Chebyshev.fit
    residual = w - np.stack([fit(times, w[:, k], degree)(times) for k in range(3)], axis=1)
    square = float(np.mean(residual**2)) or 1e-24
    length = 1
    while length < len(times) // 8 and float(np.mean(residual[length:] * residual[:-length])) > CORRELATED * square:
        length += 1
    if length == 1:
        warnings.append(f"imu0 states no noise: {np.sqrt(square):.3g} rad/s is estimated from the data")
        return replace(rates, sigma=float(np.sqrt(square))), 1
    block = max(1, min(length // 4, len(times) // MOST_MEANS))
    count = len(times) // block
    use = count * block

    def means(x: np.ndarray) -> np.ndarray:
        return np.asarray(x[:use].reshape(count, block, *x.shape[1:]).mean(axis=1))

    # means closer together than the noise's memory say no more in all: each counts for less
    sigma = float(np.sqrt(np.mean(means(residual) ** 2) * max(1.0, length / block)))
    stamp = rates.timestamp_ns[0] + np.round(means(times) * 1e9).astype(np.int64)
    warnings.append(
        f"imu0 states no noise: {sigma:.3g} rad/s is estimated for means over {block} samples, with errors that are "
        f"correlated over {length} samples"
    )
    return RateSeries(stamp, means(w), sigma), int(np.ceil(length / block))


def _spread(values: np.ndarray) -> float:
    """White noise of smooth series (n, k) from third differences, which a smooth motion hardly has."""
    if len(values) < 8:
        return float(np.std(values)) or 1.0
    third = np.diff(values, 3, axis=0) / np.sqrt(20.0)
    return mad_sigma(third - np.median(third, axis=0)) or 1e-12
