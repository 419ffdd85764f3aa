"""A body's points and its pose at every epoch, from points measured in space that come and go.

The body axes are the camera's at the first epoch used; the origin is the mean of the points seen then. Epochs join in
waves: those that share three or more known points are aligned together, what they see new joins the body, and so on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.core.linalg import inverse_of
from massprops.dynamics.alignment import LARGEST_MAHALANOBIS, align, horn, spread_out
from massprops.dynamics.quaternion import rotation_matrix
from massprops.estimators.geometry.jointfit import joint_step, shared_error

MEDIAN_SQUARE = 2.366
"""Median of chi-square with three degrees of freedom."""
TRIPLES = 40
"""Random sets of three points that are tried for the pose of an epoch with outliers."""
WAVES, STEPS = 60, 2
"""Waves in which epochs join at most, and steps of all poses and the body after each."""
POLISH, MOST_POLISH = 3, 15
"""Joint steps at the end, at least and at most."""
FIRST_REACH = 40
"""Epochs about those placed that may join in the first wave."""
MODES = 24
"""Independent errors of the body's points that are kept."""


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


def body_motion(points: np.ndarray, covariance: np.ndarray) -> BodyMotion | None:
    """Pose at every epoch and the body's points, None when no epoch shows three points off a line.

    Where the record falls apart into stretches that share no three points, the longest is taken.

    Args:
        points: (n, m, 3) measured in the camera's frame, NaN where not; covariance: (n, m, 3, 3) [m^2].
    """
    seen = np.isfinite(points).all(axis=-1)
    best: BodyMotion | None = None
    remaining_epochs = spread_out(points, seen)
    while remaining_epochs.any() and (best is None or remaining_epochs.sum() > best.used.sum()):
        start = int(np.argmax(remaining_epochs))
        growth = _Growth(points, covariance, seen, start)
        growth.spread()
        growth.polish()
        motion = growth.motion()
        remaining_epochs &= ~motion.used
        remaining_epochs[start] = False
        if best is None or motion.used.sum() > best.used.sum():
            best = motion
    return best


class _Growth:
    """The epochs that share points with epoch `start`, directly or through others, with the body that they show.

    Attributes: as of `BodyMotion`, with shift for origin, body (m, 3) for points; vague: (m, 3, 3) covariance of body.
    """

    def __init__(self, points: np.ndarray, covariance: np.ndarray, seen: np.ndarray, start: int) -> None:
        n, m = seen.shape
        self.rng = np.random.default_rng(0)  # of the random triples that find the pose among outliers
        self.seen, self.stated = seen, covariance
        self.information = np.zeros_like(covariance)
        self.information[seen] = inverse_of(covariance[seen])
        self.size = np.einsum("nmii->nm", np.where(seen[..., None, None], covariance, np.inf))
        self.measured = np.where(seen[..., None], points, 0.0)
        self.q, self.shift = np.full((n, 4), np.nan), np.full((n, 3), np.nan)
        self.covariance = np.full((n, 6, 6), np.nan)
        self.used = np.zeros(n, bool)
        self.good = np.zeros((n, m), bool)
        centre = points[start, seen[start]].mean(axis=0)
        self.body = np.where(seen[start][:, None], points[start] - centre, np.nan)
        self.vague = np.where(seen[start][:, None, None], covariance[start], np.nan)
        self.used[start], self.q[start], self.shift[start] = True, [1.0, 0, 0, 0], centre
        self.good[start] = seen[start]
        self.scale = 1.0

    def spread(self) -> None:
        """Lets epochs join in waves until none does any more."""
        least, reach, n = 6, FIRST_REACH, len(self.used)
        for _ in range(WAVES):
            known: np.ndarray = np.isfinite(self.body).all(axis=-1)
            common: np.ndarray = self.seen & known & ~self.used[:, None]
            enough = np.flatnonzero(common.sum(axis=1) >= least)
            inside = np.flatnonzero(self.used)[[0, -1]]
            # a body known from few epochs is vague: those near in time join first, then twice as far
            rows = enough[(enough >= inside[0] - reach) & (enough <= inside[1] + reach)]
            reach = min(2 * reach, n)
            if len(rows) < len(enough) and not len(rows):
                continue
            if not (len(rows) and self._join(rows, common[rows], known)):
                if least == 3:
                    break
                least = {6: 5, 5: 4}.get(least, 3)
                continue
            least = 6
            fresh: np.ndarray = self.used[:, None] & self.seen & ~known
            self.body = np.where(known[:, None], self.body, self._points(fresh)[0])
            for _ in range(STEPS):
                self._step(self.good | fresh)
            self._settle()
            self.vague = self._points(self.good)[1] * self.scale

    def polish(self) -> None:
        """Refines poses and body together until the residuals' size stays."""
        for turn in range(MOST_POLISH):
            before = self.scale
            self._step(self.good)
            self._from_neighbours()
            self._settle()
            if turn + 1 >= POLISH and abs(self.scale - before) < 0.02 * before:
                break

    def motion(self) -> BodyMotion:
        """What has been found, without epochs whose points lie on a line."""
        used, good = self.used, self.good
        used &= spread_out(np.broadcast_to(np.nan_to_num(self.body), self.measured.shape), good)
        self.q[~used], self.shift[~used], self.covariance[~used] = np.nan, np.nan, np.nan
        outliers = int((self.seen & used[:, None] & ~good).sum())
        column = np.flatnonzero(good[used].any(axis=0))
        shared = np.full((len(used), 3, min(MODES, 3 * len(column))), np.nan)
        if len(column):
            one = np.ix_(used, column)
            information = self.information[one] / self.scale
            shared[used] = shared_error(self.q[used], self.body[column], information, good[one], MODES)
        return BodyMotion(
            used=used, q=self.q, origin=self.shift, covariance=self.covariance, points=self.body, good=good,
            scale=self.scale, outliers=outliers, shared=shared,
        )  # fmt: skip

    def _join(self, rows: np.ndarray, use: np.ndarray, known: np.ndarray) -> int:
        """Takes in those of the epochs `rows`, with points `use` (k, m) in common, that fit the known body: how many."""
        body = np.where(known[:, None], self.body, 0.0)
        vague = np.where(known[:, None, None], self.vague, 0.0)
        seen, covariance = self.measured[rows], self.stated[rows] * self.scale
        every = np.broadcast_to(body, seen.shape)
        q, shift = horn(every, seen, np.where(use, 1.0 / self.size[rows], 0.0))
        information = _with_body(q, vague, covariance, use)
        q, shift, _, near = align(body, seen, information, use, q, shift)
        good: np.ndarray = use & (near <= LARGEST_MAHALANOBIS)
        ok = _enough(good, use)
        for k in np.flatnonzero(~ok):
            tried = _consensus(body, vague, seen[k], covariance[k], use[k], self.rng)
            if tried is None:
                continue
            again = align(body, seen[k : k + 1], tried[3][None], tried[2][None], tried[0][None], tried[1][None])
            q[k], shift[k] = again[0][0], again[1][0]
            good[k] = tried[2] & (again[3][0] <= LARGEST_MAHALANOBIS)
            ok[k] = _enough(good[k : k + 1], use[k : k + 1])[0]
        ok = ok & spread_out(every, good)
        self.used[rows[ok]], self.q[rows[ok]], self.shift[rows[ok]] = True, q[ok], shift[ok]
        self.good[rows[ok]] = good[ok]
        return int(ok.sum())

    def _settle(self) -> None:
        """Poses against the body as it is, which measurements fit, how large the residuals are; then the body's points
        that most of their measurements contradict."""
        used = self.used
        known: np.ndarray = np.isfinite(self.body).all(axis=-1)
        use: np.ndarray = self.seen & known & used[:, None]
        q, shift = self.q.copy(), self.shift.copy()
        solid = np.where(known[:, None], self.body, 0.0)
        q[used], shift[used], covariance, near = align(
            solid,
            self.measured[used],
            self.information[used] / self.scale,
            use[used],
            q[used],
            shift[used],
            soft=1,
            hard=2,
        )
        whole, good = np.full((len(q), 6, 6), np.nan), np.zeros_like(use)
        whole[used], good[used] = covariance, near <= LARGEST_MAHALANOBIS
        finite = near[np.isfinite(near)]
        counts = use[used].sum()
        freedom = max(0.1, 1.0 - (6.0 * used.sum() + 3.0 * known.sum()) / max(3.0 * counts, 1.0))
        asked = self.scale * float(np.median(finite)) / (MEDIAN_SQUARE * freedom) if len(finite) else 1.0
        self.q, self.shift, self.covariance, self.good, self.scale = q, shift, whole, good, max(1.0, asked)
        self._replace_doubted()

    def _from_neighbours(self) -> None:
        """Finds poses again from those of the epochs before and after, where that fits better.

        Four points whose depth is as uncertain as the body is deep fit two attitudes; the wrong one has odd neighbours.
        """
        rows = np.flatnonzero(self.used)
        known = np.isfinite(self.body).all(axis=-1)
        use, solid = self.seen[rows] & known, np.where(np.isfinite(self.body), self.body, 0.0)
        measured, information = self.measured[rows], self.information[rows] / self.scale
        q, shift = self.q.copy(), self.shift.copy()
        for away in (1, -1, 1, -1):
            near = align(solid, measured, information, use, q[rows], shift[rows], soft=0, hard=1)[3]
            order = np.clip(np.arange(len(rows)) - away, 0, len(rows) - 1)
            tried = align(solid, measured, information, use, q[rows[order]], shift[rows[order]], hard=2)
            better = _misfit(tried[3], use) < _misfit(near, use) - LARGEST_MAHALANOBIS / 2
            q[rows[better]], shift[rows[better]] = tried[0][better], tried[1][better]
        self.q, self.shift = q, shift

    def _points(self, use: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weighted mean of each point over the epochs in body axes (m, 3), covariance (m, 3, 3); NaN where none is used."""
        used = self.used
        R = rotation_matrix(self.q[used])
        weight = np.where(use[used][..., None, None], self.information[used], 0.0)
        arm = self.measured[used] - self.shift[used][:, None]
        turned = np.swapaxes(R, 1, 2)[:, None] @ weight
        total = (turned @ R[:, None]).sum(axis=0)
        side = np.einsum("nmij,nmj->mi", turned, arm)
        spread = inverse_of(total)
        some: np.ndarray = use[used].any(axis=0)
        points = np.einsum("mij,mj->mi", spread, side)
        return np.where(some[:, None], points, np.nan), np.where(some[:, None, None], spread, np.nan)

    def _replace_doubted(self) -> None:
        """Places points that most of their measurements contradict anew at the median of them, or forgets them."""
        body, good, information = self.body.copy(), self.good.copy(), self.information / self.scale
        shown = self.seen & self.used[:, None]
        for j in np.flatnonzero(np.isfinite(body).all(axis=-1) & (2 * good.sum(axis=0) < shown.sum(axis=0))):
            rows = np.flatnonzero(shown[:, j])
            R = rotation_matrix(self.q[rows])
            arm = self.measured[rows, j] - self.shift[rows]
            place, fits = _median_place(R, arm, information[rows, j])
            good[:, j] = False
            good[rows, j] = fits
            body[j] = place if 2 * fits.sum() >= len(rows) else np.nan
        self.body, self.good = body, good & np.isfinite(body).all(axis=-1)

    def _step(self, use: np.ndarray) -> None:
        """One step of all poses and the body together, by the measurements `use` (n, m)."""
        used, column = self.used, np.flatnonzero(use[self.used].any(axis=0))
        one = np.ix_(used, column)
        self.q[used], self.shift[used], self.body[column] = joint_step(
            self.q[used], self.shift[used], self.body[column], self.measured[one], self.information[one], use[one]
        )


def _median_place(R: np.ndarray, arm: np.ndarray, information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A body point (3,) near the median of its sights, arms (k, 3) turned by R (k, 3, 3), and which of them fit it."""
    place = np.median(np.einsum("nji,nj->ni", R, arm), axis=0)
    for _ in range(4):
        error = arm - R @ place
        near = np.einsum("ni,nij,nj->n", error, information, error)
        fits = near <= LARGEST_MAHALANOBIS
        if not fits.any():
            fits = near <= np.median(near)
        turned = np.swapaxes(R[fits], 1, 2) @ information[fits]
        total = (turned @ R[fits]).sum(axis=0)
        place = inverse_of(total) @ np.einsum("nij,nj->i", turned, arm[fits])
    error = arm - R @ place
    return place, np.einsum("ni,nij,nj->n", error, information, error) <= LARGEST_MAHALANOBIS


def _enough(good: np.ndarray, use: np.ndarray) -> np.ndarray:
    """(k,) bool: three points or more fit, and more than half of those given; of three, all. good, use: (k, m) bool."""
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


def _misfit(near: np.ndarray, use: np.ndarray) -> np.ndarray:
    """(k,) sums of squared Mahalanobis distances (k, m), each at most that of an outlier."""
    return np.asarray(np.where(use, np.minimum(near, LARGEST_MAHALANOBIS), 0.0).sum(axis=1))
