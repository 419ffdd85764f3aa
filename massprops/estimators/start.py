"""A first guess of everything, from the measurements alone: where every filter and the smoother begin."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from massprops.dynamics.chaser_path import ChaserPath, chaser_path
from massprops.dynamics.quaternion import multiply, rotation_matrix
from massprops.errors import NotPossible
from massprops.estimators import rates
from massprops.estimators.geometry import bodymodel, centre
from massprops.estimators.geometry.onecamera import straight_path
from massprops.estimators.momentum import Momentum, momentum_inertia
from massprops.model.problem import Problem
from massprops.sensing.stereo import triangulate

FEWEST = 6
"""Epochs that must show the attitude."""
PASSES = 2
"""Further fits, by what the rates differ from free rotation with the inertia just found."""


@dataclass(frozen=True, kw_only=True)
class Start:
    """k epochs, m features.

    Attributes:
        times: (k,) [s]; q: (k, 4) body to cam0; w: (k, 3) body rates against inertial axes [rad/s].
        position: (k, 3) of the centre of mass in cam0 [m, or model units where the scale is not known], or None.
        velocity: (3,) at times[0], or None.
        features: (m, 3) from the centre of mass in body axes, NaN where not seen enough; None without any.
        inertia: (3, 3) body axes, trace 1, or None.
        body_frame: 'attitude0', or 'own': cam0's axes at the first epoch used.
        sigma_w: 1-sigma of the rates [rad/s].
        covariance: (k, 6, 6) of a small turn about body axes [rad] and of the rates [rad/s].
        momentum: how the inertia was found, or None. window: epochs that each rate comes from.
        scaled: whether lengths are in metres.
        outliers: measurements left out. warnings: what was assumed.
        index: (k,) which of the problem's epochs these are. velocities: (k, 3) along the path, or None.
        cpu_s: CPU time that it took [s].
        poses: attitudes as each epoch alone shows them, None from body rates.
        block: (k,) stretches that each have a momentum of their own, because the attitude drifts; None for one.
        early: a start from the first part of the data only, for the filters (`filters.begin.early_start`), or None.
        unexplained: share of the stated variance of the attitudes that the residuals show, at most 1; 1 where none is stated.
    """

    times: np.ndarray
    q: np.ndarray
    w: np.ndarray
    inertia: np.ndarray | None
    sigma_w: float
    warnings: tuple[str, ...]
    covariance: np.ndarray
    position: np.ndarray | None = None
    velocity: np.ndarray | None = None
    features: np.ndarray | None = None
    body_frame: str = "own"
    momentum: Momentum | None = None
    window: int = 1
    scaled: bool = True
    outliers: int = 0
    index: np.ndarray | None = None
    velocities: np.ndarray | None = None
    cpu_s: float = 0.0
    poses: Poses | None = None
    block: np.ndarray | None = None
    early: Start | None = None
    unexplained: float = 1.0


@dataclass(frozen=True)
class Poses:
    """Epochs `rows` (k,) of the problem, attitudes q (k, 4) in the start's body axes to cam0, and their 1-sigma (k,)."""

    rows: np.ndarray
    q: np.ndarray
    sigma: np.ndarray


def first_guess(problem: Problem, until_s: float | None = None) -> Start:
    """Attitude, rates, path, features and inertia from the measurements up to `until_s` seconds.

    In order of preference: attitude0 with the features that it places; two cameras; body rates alone.

    Raises:
        NotPossible: nothing here shows the attitude, or too few epochs do.
    """
    begun = time.process_time()
    early = problem.times <= (np.inf if until_s is None else until_s) + 1e-9
    start = _complete(_first(problem, early))
    return replace(start, cpu_s=time.process_time() - begun)


def _first(problem: Problem, early: np.ndarray) -> Start:
    if np.isfinite(problem.attitude[early]).all(axis=1).sum() >= FEWEST:
        return _from_attitude(problem, early)
    if problem.stereo:
        stereo_start = _from_stereo(problem, early)
        if stereo_start is not None:
            return stereo_start
    if np.isfinite(problem.rates[early]).all(axis=1).sum() >= FEWEST:
        return _from_rates(problem, early)
    if problem.has_tracks and not problem.stereo:
        raise NotPossible(
            "tracks of one camera show no motion without attitude0, which 'massprops reconstruct' writes for an object that "
            "tumbles"
        )
    raise NotPossible(
        f"fewer than {FEWEST} epochs show the attitude: give more in which both cameras see three features off a line"
    )


def _from_stereo(problem: Problem, early: np.ndarray) -> Start | None:
    rows = np.flatnonzero(early)
    points, covariance = triangulate(problem.cameras, np.moveaxis(problem.uv[rows], 1, 2), problem.sigma_px)
    motion = bodymodel.body_motion(points, covariance)
    if motion is None or motion.used.sum() < FEWEST:
        return None
    warnings = []
    lost = int((np.isfinite(points).all(axis=-1).sum(axis=1) >= 3).sum() - motion.used.sum())
    if lost > 0:
        warnings.append(f"{lost} epochs share too few features with the others and are left out of the first guess")
    if motion.scale > 2.0:
        warnings.append(
            f"triangulated points scatter {np.sqrt(motion.scale):.1f} times as much as sigma_px allows: check sigma_px and "
            "the calibration"
        )
    used = motion.used
    rows, times = rows[used], problem.times[rows[used]]
    q, origin = motion.q[used], motion.origin[used]
    fit, w, momentum = _inertia(problem, times, q, motion.covariance[used][:, :3, :3], motion.shared[used])
    offset, position, velocity = centre.centre_of_mass(times, q, origin, motion.covariance[used][:, 3:, 3:])
    start = _of_fit(times, rows, fit, w, momentum, warnings)
    return replace(
        start,
        position=position,
        velocity=velocity[0],
        velocities=velocity,
        features=motion.points - offset,
        outliers=motion.outliers + start.outliers,
        poses=Poses(rows, q, np.sqrt(np.einsum("nii->n", motion.covariance[used][:, :3, :3]) / 3.0)),
    )


def _from_attitude(problem: Problem, early: np.ndarray) -> Start:
    rows = np.flatnonzero(early & np.isfinite(problem.attitude).all(axis=1))
    times, q = problem.times[rows], problem.attitude[rows]
    sigma = problem.sigma_attitude[rows]
    stated = bool((np.isfinite(sigma) & (sigma > 0)).any())
    sigma = np.where(np.isfinite(sigma) & (sigma > 0), sigma, np.nanmedian(np.where(sigma > 0, sigma, np.nan)))
    sigma = np.where(np.isfinite(sigma), sigma, 1e-3)
    fit, w, momentum = _inertia(problem, times, q, sigma[:, None, None] ** 2 * np.eye(3), None)
    position = velocity = features = None
    scaled, warnings = True, []
    if problem.stereo:
        points, covariance = triangulate(problem.cameras, np.moveaxis(problem.uv[rows], 1, 2), problem.sigma_px)
        placed = centre.features_on_path(times, fit.q, points, covariance)
        if placed is not None:
            position, velocity, features = placed
    elif problem.has_tracks:
        placed_one = straight_path(problem, rows, fit.q)
        if placed_one is None:
            warnings.append("the tracks of one camera do not place the features")
        else:
            position, velocity, features, scaled = placed_one
            if not scaled:
                warnings.append(
                    "one camera without ranges (range0) shows no lengths: positions have no unit; inertia ratios need none"
                )
    return replace(
        _of_fit(times, rows, fit, w, momentum, warnings),
        position=position,
        velocity=velocity,
        features=features,
        body_frame="attitude0",
        scaled=scaled,
        poses=Poses(rows, q, sigma),
        unexplained=min(fit.scale, 1.0) if stated else 1.0,
    )


def _from_rates(problem: Problem, early: np.ndarray) -> Start:
    rows = np.flatnonzero(early & np.isfinite(problem.rates).all(axis=1))
    times, w = problem.times[rows], problem.rates[rows]
    fit = rates.from_rates(times, w, problem.sigma_rate)
    block = _blocks(times, fit)
    momentum = momentum_inertia(fit.q, fit.w, within(fit.covariance, block), block, fit.window)
    note = "attitude integrated from body rates, from the body's axes at the first epoch"
    return replace(_of_fit(times, rows, fit, fit.w, momentum, [note]), block=block)


def _of_fit(
    times: np.ndarray,
    rows: np.ndarray,
    fit: rates.LocalFit,
    w: np.ndarray,
    momentum: Momentum | None,
    warnings: list[str],
) -> Start:
    """The start in the fit's own body axes, without a path: its epochs `rows`, rates w, and the inertia where it was found."""
    return Start(
        times=times,
        q=fit.q,
        w=w,
        inertia=None if momentum is None else momentum.inertia,
        sigma_w=float(np.sqrt(np.nanmedian(np.einsum("nii->n", fit.covariance[:, 3:, 3:]) / 3.0))),
        warnings=tuple(warnings),
        covariance=fit.covariance,
        momentum=momentum,
        window=fit.window,
        outliers=int((~fit.good).sum()),
        index=rows,
    )


def _inertia(
    problem: Problem, times: np.ndarray, q: np.ndarray, covariance: np.ndarray, shared: np.ndarray | None
) -> tuple[rates.LocalFit, np.ndarray, Momentum | None]:
    """Smoothed attitude, rates against inertial axes, and the inertia that keeps the momentum.

    The first fit takes the rates from cubics alone; the next ones from the difference to free rotation with the
    inertia just found, which a cubic follows far better.
    """
    chaser = chaser_path(problem.environment, times)
    fit = rates.from_attitude(times, q, covariance, shared)
    w, conserved = _conserved(chaser, fit, None)
    for _ in range(PASSES):
        if conserved is None or not np.isfinite(fit.w).all():
            break
        again = rates.from_attitude(times, q, covariance, shared, (conserved.inertia, fit.w))
        w_again, found_again = _conserved(chaser, again, conserved.inertia)
        if found_again is None:
            break
        fit, w, conserved = again, w_again, found_again
    return fit, w, conserved


def _conserved(chaser: ChaserPath, fit: rates.LocalFit, first: np.ndarray | None) -> tuple[np.ndarray, Momentum | None]:
    w = fit.w + np.einsum("nji,nj->ni", rotation_matrix(fit.q), chaser.rate)
    return w, momentum_inertia(multiply(chaser.q, fit.q), w, fit.covariance, None, fit.window, first, fit)


def _blocks(times: np.ndarray, fit: rates.LocalFit) -> np.ndarray:
    """Stretches over which the integrated attitude drifts no more than the noise of the rates tilts the momentum."""
    speed = max(float(np.median(np.linalg.norm(fit.w, axis=1))), 1e-12)
    tilt = np.sqrt(np.median(fit.covariance[:, 3, 3])) / speed
    total = float(fit.covariance[-1, 0, 0])
    span = float(times[-1] - times[0])
    longest = span * max(tilt, 1e-9) ** 2 / max(total, 1e-300)
    shortest = 2 * np.pi / speed
    count = max(1, int(np.floor(span / max(4.0 * longest, shortest))))
    return np.minimum(((times - times[0]) / span * count).astype(int), count - 1)


def within(covariance: np.ndarray, block: np.ndarray) -> np.ndarray:
    """Covariances (n, 6, 6) with the turn's counted from the middle of each block (n,), since each has a momentum of its own."""
    out = covariance.copy()
    for b in np.unique(block):
        rows = np.flatnonzero(block == b)
        middle = covariance[rows[len(rows) // 2], :3, :3]
        out[rows, :3, :3] = np.abs(covariance[rows, :3, :3] - middle)
    return out


def _complete(start: Start) -> Start:
    """Without the epochs whose rates nothing shows."""
    ok = np.isfinite(start.w).all(axis=1) & np.isfinite(start.q).all(axis=1)
    if ok.all():
        return start
    if ok.sum() < FEWEST:
        raise NotPossible(f"fewer than {FEWEST} epochs stand close enough together to show rates")
    each = ("times", "q", "w", "position", "velocities", "covariance", "index", "block")
    kept = {name: values[ok] for name in each if (values := getattr(start, name)) is not None}
    line = f"{int((~ok).sum())} lone epochs left out of the first guess"
    return replace(start, **kept, warnings=(*start.warnings, line))
