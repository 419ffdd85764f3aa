"""A body's points and its pose at every epoch, from points measured in space that come and go.

The body axes are the camera's at the first epoch used; the origin is the mean of the points seen then. Epochs join in
waves: those that share three or more known points are aligned together, what they see new joins the body, and so on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.dynamics.quaternion import rotation_matrix
from massprops.estimators.geometry.alignment import LARGEST_MAHALANOBIS, align, horn, inverse_of, spread_out
from massprops.estimators.geometry.jointfit import joint_step, shared_error

MEDIAN_SQUARE = 2.366
"""Median of chi-square with three degrees of freedom."""
TRIPLES = 40
WAVES = 60
STEPS = 2
POLISH = 3
MOST_POLISH = 15
FIRST_REACH = 40
MODES = 24


@dataclass(frozen=True)
class BodyMotion:
    """n epochs, m points.

    Attributes:
        used: (n,) epochs whose pose was found.
        q: (n, 4) body to camera; origin: (n, 3) of the body axes in the camera [m]; NaN where not used.
        covariance: (n, 6, 6) of a small turn about camera axes [rad] and of the origin [m].
        points: (m, 3) in body axes [m], NaN where unknown; good: (n, m) measurements that fit.
        scale: factor on the stated variance that the residuals ask for, at least 1.
        outliers: measurements that do not fit.
        shared: (n, 3, s) turns about camera axes [rad] per unit of s independent errors of the body's points.
    """

    used: np.ndarray
    q: np.ndarray
    origin: np.ndarray
    covariance: np.ndarray
    points: np.ndarray
    good: np.ndarray
    scale: float
    outliers: int
    shared: np.ndarray


def body_motion(points: np.ndarray, covariance: np.ndarray, seed: int = 0) -> BodyMotion | None:
    """Pose at every epoch and the body's points, None when no epoch shows three points off a line.

    Where the record falls apart into stretches that share no three points, the longest is taken.

    Args:
        points: (n, m, 3) measured in the camera's frame, NaN where not; covariance: (n, m, 3, 3) [m^2].
        seed: of the random triples that find the pose among outliers.
    """
    seen = np.isfinite(points).all(axis=-1)
    best: BodyMotion | None = None
    left = spread_out(points, seen)
    while left.any() and (best is None or left.sum() > best.used.sum()):
        start = int(np.argmax(left))
        motion = _grow(points, covariance, seen, start, seed)
        left &= ~motion.used
        left[start] = False
        if best is None or motion.used.sum() > best.used.sum():
            best = motion
    return best


def _grow(points: np.ndarray, covariance: np.ndarray, seen: np.ndarray, start: int, seed: int) -> BodyMotion:
    """The epochs that share points with epoch `start`, directly or through others."""
    n, m = seen.shape
    rng = np.random.default_rng(seed)
    information = np.zeros_like(covariance)
    information[seen] = inverse_of(covariance[seen])
    size = np.einsum("nmii->nm", np.where(seen[..., None, None], covariance, np.inf))
    measured = np.where(seen[..., None], points, 0.0)
    q, shift = np.full((n, 4), np.nan), np.full((n, 3), np.nan)
    pose_covariance = np.full((n, 6, 6), np.nan)
    used = np.zeros(n, bool)
    good = np.zeros((n, m), bool)
    centre = points[start, seen[start]].mean(axis=0)
    body = np.where(seen[start][:, None], points[start] - centre, np.nan)
    vague = np.where(seen[start][:, None, None], covariance[start], np.nan)
    used[start], q[start], shift[start] = True, [1.0, 0, 0, 0], centre
    good[start] = seen[start]
    scale, least, reach = 1.0, 6, FIRST_REACH
    for _ in range(WAVES):
        known: np.ndarray = np.isfinite(body).all(axis=-1)
        common: np.ndarray = seen & known & ~used[:, None]
        enough = np.flatnonzero(common.sum(axis=1) >= least)
        inside = np.flatnonzero(used)[[0, -1]]
        # a body known from few epochs is vague: those near in time join first, then twice as far
        rows = enough[(enough >= inside[0] - reach) & (enough <= inside[1] + reach)]
        reach = min(2 * reach, n)
        if len(rows) < len(enough) and not len(rows):
            continue
        joined = 0
        if len(rows):
            found = _join(
                np.where(known[:, None], body, 0.0),
                np.where(known[:, None, None], vague, 0.0),
                measured[rows],
                covariance[rows] * scale,
                1.0 / size[rows],
                common[rows],
                rng,
            )
            ok, q_rows, shift_rows, good_rows = found
            joined = int(ok.sum())
            used[rows[ok]], q[rows[ok]], shift[rows[ok]] = True, q_rows[ok], shift_rows[ok]
            good[rows[ok]] = good_rows[ok]
        if not joined:
            if least == 3:
                break
            least = {6: 5, 5: 4}.get(least, 3)
            continue
        least = 6
        fresh: np.ndarray = used[:, None] & seen & ~known
        body = np.where(known[:, None], body, _points(q, shift, measured, information, fresh, used)[0])
        for _ in range(STEPS):
            q, shift, body = _together(q, shift, body, measured, information, good | fresh, used)
        q, shift, pose_covariance, good, scale = _refine(q, shift, body, measured, information, seen, used, scale)
        body, good = _doubted(q, shift, body, measured, information / scale, seen, good, used)
        vague = _points(q, shift, measured, information, good, used)[1] * scale
    for turn in range(MOST_POLISH):
        before = scale
        q, shift, body = _together(q, shift, body, measured, information, good, used)
        q, shift = _from_neighbours(q, shift, body, measured, information / scale, seen, used)
        q, shift, pose_covariance, good, scale = _refine(q, shift, body, measured, information, seen, used, scale)
        body, good = _doubted(q, shift, body, measured, information / scale, seen, good, used)
        if turn + 1 >= POLISH and abs(scale - before) < 0.02 * before:
            break
    used &= spread_out(np.broadcast_to(np.nan_to_num(body), measured.shape), good)
    q[~used], shift[~used], pose_covariance[~used] = np.nan, np.nan, np.nan
    outliers = int((seen & used[:, None] & ~good).sum())
    shared = _shared(q, body, information / scale, good, used)
    return BodyMotion(used, q, shift, pose_covariance, body, good, scale, outliers, shared)


def _shared(q: np.ndarray, body: np.ndarray, information: np.ndarray, good: np.ndarray, used: np.ndarray) -> np.ndarray:
    """(n, 3, k) how the used epochs' attitudes share the errors of the body's points (`shared_error`)."""
    column = np.flatnonzero(good[used].any(axis=0))
    shared = np.full((len(q), 3, min(MODES, 3 * len(column))), np.nan)
    if len(column):
        one = np.ix_(used, column)
        shared[used] = shared_error(q[used], body[column], information[one], good[one], MODES)
    return shared


def _join(
    body: np.ndarray,
    vague: np.ndarray,
    seen: np.ndarray,
    covariance: np.ndarray,
    weight: np.ndarray,
    use: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Which epochs fit the body, their poses, and the measurements that fit."""
    every = np.broadcast_to(body, seen.shape)
    q, shift = horn(every, seen, np.where(use, weight, 0.0))
    information = _with_body(q, vague, covariance, use)
    q, shift, _, near = align(body, seen, information, use, q, shift)
    good = use & (near <= LARGEST_MAHALANOBIS)
    ok = _enough(good, use)
    for k in np.flatnonzero(~ok):
        tried = _consensus(body, vague, seen[k], covariance[k], use[k], rng)
        if tried is None:
            continue
        again = align(body, seen[k : k + 1], tried[3][None], tried[2][None], tried[0][None], tried[1][None])
        q[k], shift[k] = again[0][0], again[1][0]
        good[k] = tried[2] & (again[3][0] <= LARGEST_MAHALANOBIS)
        ok[k] = _enough(good[k : k + 1], use[k : k + 1])[0]
    return ok & spread_out(every, good), q, shift, good


def _enough(good: np.ndarray, use: np.ndarray) -> np.ndarray:
    fit, given = good.sum(axis=1), use.sum(axis=1)
    return (fit >= 3) & (fit > 0.5 * given) & ((given > 3) | (fit == given))


def _with_body(q: np.ndarray, vague: np.ndarray, covariance: np.ndarray, use: np.ndarray) -> np.ndarray:
    """Information of measurements (..., m, 3, 3) when the body's points are uncertain too."""
    R = rotation_matrix(q)[..., None, :, :]
    whole = np.where(use[..., None, None], covariance, np.eye(3)) + R @ vague @ np.swapaxes(R, -1, -2)
    return inverse_of(whole)


def _consensus(
    body: np.ndarray,
    vague: np.ndarray,
    seen: np.ndarray,
    covariance: np.ndarray,
    use: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None:
    """The pose of the three points that most others agree with."""
    index = np.flatnonzero(use)
    if len(index) < 4:
        return None
    triples = np.stack([rng.choice(index, 3, replace=False) for _ in range(TRIPLES)])
    q, shift = horn(body[triples], seen[triples], np.ones(triples.shape))
    error = seen - shift[:, None] - np.einsum("tij,mj->tmi", rotation_matrix(q), body)
    information = _with_body(q, vague, covariance, use)
    near = np.einsum("tmi,tmij,tmj->tm", error, information, error)
    # a pose from three noisy points is itself off by a few sigma
    fits = use & (near < 4 * LARGEST_MAHALANOBIS)
    best = int(np.argmax(fits.sum(axis=1)))
    return (q[best], shift[best], fits[best], information[best]) if fits[best].sum() >= 3 else None


def _refine(
    q: np.ndarray,
    shift: np.ndarray,
    body: np.ndarray,
    measured: np.ndarray,
    information: np.ndarray,
    seen: np.ndarray,
    used: np.ndarray,
    scale: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, float]:
    known = np.isfinite(body).all(axis=-1)
    use = seen & known & used[:, None]
    q, shift = q.copy(), shift.copy()
    solid = np.where(known[:, None], body, 0.0)
    q[used], shift[used], covariance, near = align(
        solid, measured[used], information[used] / scale, use[used], q[used], shift[used], soft=1, hard=2
    )
    whole, good = np.full((len(q), 6, 6), np.nan), np.zeros_like(use)
    whole[used], good[used] = covariance, near <= LARGEST_MAHALANOBIS
    finite = near[np.isfinite(near)]
    counts = use[used].sum()
    freedom = max(0.1, 1.0 - (6.0 * used.sum() + 3.0 * known.sum()) / max(3.0 * counts, 1.0))
    asked = scale * float(np.median(finite)) / (MEDIAN_SQUARE * freedom) if len(finite) else 1.0
    return q, shift, whole, good, max(1.0, asked)


def _from_neighbours(
    q: np.ndarray,
    shift: np.ndarray,
    body: np.ndarray,
    measured: np.ndarray,
    information: np.ndarray,
    seen: np.ndarray,
    used: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Poses found again from those of the epochs before and after, where that fits better.

    Four points whose depth is as uncertain as the body is deep fit two attitudes; the wrong one has odd neighbours.
    """
    rows = np.flatnonzero(used)
    use = seen[rows] & np.isfinite(body).all(axis=-1)
    solid = np.where(np.isfinite(body), body, 0.0)
    q, shift = q.copy(), shift.copy()
    for away in (1, -1, 1, -1):
        near = align(solid, measured[rows], information[rows], use, q[rows], shift[rows], soft=0, hard=1)[3]
        order = np.clip(np.arange(len(rows)) - away, 0, len(rows) - 1)
        tried = align(solid, measured[rows], information[rows], use, q[rows[order]], shift[rows[order]], hard=2)
        better = _misfit(tried[3], use) < _misfit(near, use) - LARGEST_MAHALANOBIS / 2
        q[rows[better]], shift[rows[better]] = tried[0][better], tried[1][better]
    return q, shift


def _misfit(near: np.ndarray, use: np.ndarray) -> np.ndarray:
    return np.asarray(np.where(use, np.minimum(near, LARGEST_MAHALANOBIS), 0.0).sum(axis=1))


def _points(
    q: np.ndarray, shift: np.ndarray, measured: np.ndarray, information: np.ndarray, use: np.ndarray, used: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted mean of each point over the epochs in body axes (m, 3), covariance (m, 3, 3); NaN where none is used."""
    R = rotation_matrix(q[used])
    weight = np.where(use[used][..., None, None], information[used], 0.0)
    arm = measured[used] - shift[used][:, None]
    turned = np.swapaxes(R, 1, 2)[:, None] @ weight
    total = (turned @ R[:, None]).sum(axis=0)
    side = np.einsum("nmij,nmj->mi", turned, arm)
    spread = inverse_of(total)
    some = use[used].any(axis=0)
    points = np.einsum("mij,mj->mi", spread, side)
    return np.where(some[:, None], points, np.nan), np.where(some[:, None, None], spread, np.nan)


def _doubted(
    q: np.ndarray,
    shift: np.ndarray,
    body: np.ndarray,
    measured: np.ndarray,
    information: np.ndarray,
    seen: np.ndarray,
    good: np.ndarray,
    used: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Points that most of their measurements contradict, placed anew at the median of them, or forgotten."""
    body, good = body.copy(), good.copy()
    shown = seen & used[:, None]
    for j in np.flatnonzero(np.isfinite(body).all(axis=-1) & (2 * good.sum(axis=0) < shown.sum(axis=0))):
        rows = np.flatnonzero(shown[:, j])
        R = rotation_matrix(q[rows])
        arm = measured[rows, j] - shift[rows]
        place = np.median(np.einsum("nji,nj->ni", R, arm), axis=0)
        for _ in range(4):
            error = arm - R @ place
            near = np.einsum("ni,nij,nj->n", error, information[rows, j], error)
            fits = near <= LARGEST_MAHALANOBIS
            if not fits.any():
                fits = near <= np.median(near)
            turned = np.swapaxes(R[fits], 1, 2) @ information[rows[fits], j]
            total = (turned @ R[fits]).sum(axis=0)
            place = inverse_of(total) @ np.einsum("nij,nj->i", turned, arm[fits])
        error = arm - R @ place
        fits = np.einsum("ni,nij,nj->n", error, information[rows, j], error) <= LARGEST_MAHALANOBIS
        good[:, j] = False
        good[rows, j] = fits
        body[j] = place if 2 * fits.sum() >= len(rows) else np.nan
    return body, good & np.isfinite(body).all(axis=-1)


def _together(
    q: np.ndarray,
    shift: np.ndarray,
    body: np.ndarray,
    measured: np.ndarray,
    information: np.ndarray,
    use: np.ndarray,
    used: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    q, shift, body = q.copy(), shift.copy(), body.copy()
    column = np.flatnonzero(use[used].any(axis=0))
    one = np.ix_(used, column)
    q[used], shift[used], body[column] = joint_step(
        q[used], shift[used], body[column], measured[one], information[one], use[one]
    )
    return q, shift, body
