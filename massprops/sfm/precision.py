"""How well the adjustment fixes the focal length and each attitude, from the measured residuals.

A track's observations share their errors (a feature on a curved edge or a moving shadow slides the same way in every
frame), so the usual inverse normal matrix is too confident. The covariance here is the sandwich with tracks as
clusters: Cov = H⁺ (Σ_p s_p s_pᵀ) H⁺, H the camera system after the points are eliminated, s_p the score of track p
(Huber 1967; Liang and Zeger 1986, eq. 5).

Of the focal lengths, errors may also be alike on one place of the body, in one block of time and on one side of the camera: a codec's
blocks stand still while the body turns, and the limb slides the same way all the time. So their covariance has clusters of
all three, each judged without itself (`massprops.core.clustered`), and is never below that of independent errors as large as
the residuals. The information there is the mean curvature of the loss, not the weight of least squares that stands for it: for
normal errors as wide as the loss the weights promise 1.7 times too much.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from massprops.core.clustered import SIDES, Scores, in_blocks, in_places, multiway_meat
from massprops.core.linalg import at_least
from massprops.sfm.points import SparsePoints, radial_factor, residuals
from massprops.views import Views


@dataclass(frozen=True)
class ShownInertia:
    """The inertia (3, 3) that the motion of a film shows, of determinant 1 in the body's axes, and the covariance (5, 5) of its logarithm
    in `massprops.sfm.free_motion.BASIS`."""

    inertia: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True)
class Precision:
    """Standard deviations at the end of an adjustment.

    Attributes:
        rms_px: root mean square residual of one coordinate [px].
        focal_relative: of the focal length, relative; 0 when it was given. Of several cameras, the one with most views.
        distortion: of its k1 with tracks as clusters, as its test was set on; 0 when it was not estimated.
        attitude: (n,) of each view's rotation, per axis [rad].
        focal_relative_model: what independent errors of size `rms_px` would give for `focal_relative`.
        focal_by_camera: relative, of every camera number.
        shown: the inertia, where the images were placed by one free motion.
    """

    rms_px: float
    focal_relative: float
    distortion: float
    attitude: np.ndarray
    focal_relative_model: float
    focal_by_camera: dict[int, float] = field(default_factory=dict)
    shown: ShownInertia | None = None


@dataclass(frozen=True)
class Adjusted:
    """How a model was adjusted; as the arguments of `precision`, but an infinite loss is least squares."""

    free_focal: bool
    radial_terms: int | dict[int, int]
    loss_px: float
    camera: np.ndarray
    constant: frozenset[int] = frozenset()

    def weight(self, residual: np.ndarray) -> np.ndarray:
        """(k,) of the loss, of residuals (k, 2) [px]."""
        return 1 / (1 + (residual**2).sum(1) / self.loss_px**2)


def further_parameters(
    views: Views, points: SparsePoints, how: Adjusted, columns: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """What further parameters of all cameras would be, adjusted with poses, points and lenses; to first order.

    Args:
        columns: derivatives (k, 2) of each observation by each of them [px].

    Returns:
        (e,) values, from where the model stands, and (e,) standard deviations, by the sandwich of the module.
    """
    r = residuals(views, points)
    weight = how.weight(r)
    slopes = derivatives(views, points)
    lens = _lens(slopes, points, how)
    lens.columns.extend(columns)
    system = System(len(views), points, slopes, lens, weight)
    inverse, score = pseudo_inverse(system.normal), system.scores(r, weight)
    value = -inverse @ np.asarray(score.sum(axis=0)).ravel()
    sigma, _ = _deviations(inverse, score)
    return value[-len(columns) :], sigma[-len(columns) :]


def precision(
    views: Views,
    points: SparsePoints,
    free_focal: bool,
    radial_terms: int | dict[int, int],
    loss_px: float | None = None,
    camera: np.ndarray | None = None,
    constant: frozenset[int] = frozenset(),
) -> Precision:
    """See the module.

    Args:
        free_focal: whether focal lengths were estimated.
        radial_terms: estimated terms of the distortion, of all cameras or by number.
        loss_px: scale of the Cauchy loss of the adjustment, None for least squares.
        camera: (n,) number of each view's camera; None for one camera.
        constant: numbers of cameras whose focal length was given all the same.
    """
    n, k = len(views), len(points.obs_view)
    r = residuals(views, points)
    rms = float(np.sqrt(np.mean(r**2))) if k else float("nan")
    camera = np.zeros(n, int) if camera is None else np.asarray(camera)
    numbers, many = np.unique(camera, return_counts=True)
    if not determined(views, points):
        return Precision(rms, np.nan if free_focal else 0.0, np.nan, np.full(n, np.nan), np.nan)
    how = Adjusted(free_focal, radial_terms, np.inf if loss_px is None else loss_px, camera, constant)
    weight = how.weight(r)
    slopes = derivatives(views, points)
    lens = _lens(slopes, points, how)
    system = System(n, points, slopes, lens, weight)
    stated, independent = _deviations(pseudo_inverse(system.normal), system.scores(r, weight))
    optics = _of_lenses(views, points, system, lens, r, weight)
    by_camera = {c: float(optics[i]) for c, i in lens.focal_at.items()}
    first = int(numbers[int(np.argmax(many))])
    bent, long = lens.bent_at.get(first), lens.focal_at.get(first)
    return Precision(
        rms_px=rms,
        focal_relative=by_camera.get(first, 0.0),
        distortion=0.0 if bent is None else float(stated[6 * n + bent]),
        attitude=np.sqrt(np.mean(stated[: 6 * n].reshape(n, 6)[:, :3] ** 2, axis=1)),
        focal_relative_model=0.0 if long is None else float((independent * rms)[6 * n + long]),
        focal_by_camera=by_camera,
    )


def determined(views: Views, points: SparsePoints) -> bool:
    """Whether there are views and observations enough for their adjustment to have a precision."""
    return len(views) >= 3 and len(points.obs_view) >= 6 * len(views)


@dataclass(frozen=True)
class Derivatives:
    """Of k observations: normalised place x, y, squared radius r2, radial factor and focal length f (k,); derivatives of
    the pixel by the pose (k, 2, 6), turn before shift, and by the point (k, 2, 3)."""

    x: np.ndarray
    y: np.ndarray
    r2: np.ndarray
    radial: np.ndarray
    f: np.ndarray
    pose: np.ndarray
    point: np.ndarray


def derivatives(views: Views, points: SparsePoints) -> Derivatives:
    """The tangential terms are left out: they are far below the rest."""
    v, p = points.obs_view, points.obs_point
    R, D, f = views.R[v], views.distortion[v], views.K[v][:, 0, 0]
    a = np.einsum("kij,kj->ki", R, points.xyz[p])
    c = a + views.t[v]
    x, y, z = c[:, 0] / c[:, 2], c[:, 1] / c[:, 2], c[:, 2]
    r2 = x * x + y * y
    radial, g = radial_factor(D, r2)
    dx = np.stack([radial + 2 * x * x * g, 2 * x * y * g], 1)
    dy = np.stack([2 * x * y * g, radial + 2 * y * y * g], 1)
    by_place = np.stack([dx, dy], 1) * f[:, None, None]
    place = np.stack([np.stack([1 / z, 0 * z, -x / z], 1), np.stack([0 * z, 1 / z, -y / z], 1)], 1)
    by_camera = np.einsum("kij,kjl->kil", by_place, place)
    cross = np.zeros((len(v), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2] = a[:, 2], -a[:, 1]
    cross[:, 1, 0], cross[:, 1, 2] = -a[:, 2], a[:, 0]
    cross[:, 2, 0], cross[:, 2, 1] = a[:, 1], -a[:, 0]
    return Derivatives(x, y, r2, radial, f, np.concatenate([by_camera @ cross, by_camera], 2), by_camera @ R)


@dataclass(frozen=True)
class Lens:
    """Derivatives (k, 2) by each estimated number of the lenses, and which of them is a camera's focal length and its
    first radial term."""

    columns: list[np.ndarray]
    focal_at: dict[int, int]
    bent_at: dict[int, int]


def radial_column(s: Derivatives, power: int) -> np.ndarray:
    """Derivatives (k, 2) of each observation by the radial term of that power of the squared radius [px]."""
    return np.stack([s.x * s.r2**power, s.y * s.r2**power], 1) * s.f[:, None]


def _lens(s: Derivatives, points: SparsePoints, how: Adjusted) -> Lens:
    """Of every camera what was estimated of it."""
    camera, numbers = how.camera[points.obs_view], np.unique(how.camera).tolist()
    free = [c for c in numbers if how.free_focal and c not in how.constant]
    terms = {c: how.radial_terms if isinstance(how.radial_terms, int) else how.radial_terms.get(c, 0) for c in numbers}
    columns: list[np.ndarray] = []
    focal_at: dict[int, int] = {}
    bent_at: dict[int, int] = {}
    for c, number in terms.items():
        of_camera = (camera == c)[:, None]
        if c in free:
            focal_at[c] = len(columns)
            columns.append(np.where(of_camera, np.stack([s.x * s.radial, s.y * s.radial], 1) * s.f[:, None], 0.0))
        for power in range(1, number + 1):
            bent_at.setdefault(c, len(columns))
            columns.append(np.where(of_camera, radial_column(s, power), 0.0))
    return Lens(columns, focal_at, bent_at)


def _sparse(n: int, points: SparsePoints, s: Derivatives, lens: Lens) -> tuple[Any, Any]:
    """Derivatives of all residuals by poses and lenses (2k, 6n + e), and by the points (2k, 3m)."""
    import scipy.sparse as sp

    v, p, k = points.obs_view, points.obs_point, len(points.obs_view)
    rows = np.arange(2 * k).reshape(k, 2)
    cols = 6 * v[:, None] + np.arange(6)
    parts_r = [np.repeat(rows[:, :, None], 6, 2).ravel()]
    parts_c = [np.repeat(cols[:, None, :], 2, 1).ravel()]
    parts_v = [s.pose.ravel()]
    for i, column in enumerate(lens.columns):
        parts_r.append(rows.ravel())
        parts_c.append(np.full(2 * k, 6 * n + i))
        parts_v.append(column.ravel())
    shape = (2 * k, 6 * n + len(lens.columns))
    A = sp.csr_matrix((np.concatenate(parts_v), (np.concatenate(parts_r), np.concatenate(parts_c))), shape)
    pc = np.repeat((3 * p[:, None] + np.arange(3))[:, None, :], 2, 1).ravel()
    B = sp.csr_matrix((s.point.ravel(), (np.repeat(rows[:, :, None], 3, 2).ravel(), pc)), (2 * k, 3 * len(points.xyz)))
    return A, B


class System:
    """Least squares of q = 6n + e numbers, poses and lenses, with the points eliminated.

    Attributes:
        normal: (q, q) matrix.
    """

    def __init__(self, n: int, points: SparsePoints, s: Derivatives, lens: Lens, weight: np.ndarray) -> None:
        """weight: (k,) of the observations."""
        self._point, self._points, self.derivatives = points.obs_point, len(points.xyz), s
        self._A, self._B = _sparse(n, points, s, lens)
        self._weigh(weight)

    def weighed(self, weight: np.ndarray) -> System:
        """The same, of other weights (k,)."""
        out = copy(self)
        out._weigh(weight)
        return out

    def _weigh(self, weight: np.ndarray) -> None:
        import scipy.sparse as sp

        p, m, s = self._point, self._points, self.derivatives
        AW = (self._A.T @ sp.diags(np.repeat(weight, 2))).tocsr()
        V = np.zeros((m, 3, 3))
        np.add.at(V, p, np.einsum("k,kia,kib->kab", weight, s.point, s.point))
        V += np.eye(3) * 1e-12 * np.trace(V, axis1=1, axis2=2)[:, None, None]
        self._Vinv = sp.bsr_matrix((np.linalg.inv(V), np.arange(m), np.arange(m + 1)), (3 * m, 3 * m))
        self._C = (AW @ self._B).tocsr()
        self.normal = np.asarray((AW @ self._A).todense() - (self._C @ self._Vinv @ self._C.T).todense())

    def scores(self, r: np.ndarray, weight: np.ndarray) -> Any:
        """(m, q) of each track, of weighed residuals (k, 2). What is eliminated of a score vanishes at the optimum, and is
        kept near it."""
        import scipy.sparse as sp

        p, k, m = self._point, len(self._point), self._points
        track = sp.csr_matrix((np.ones(2 * k), (np.repeat(p, 2), np.arange(2 * k))), (m, 2 * k))
        S = (track @ sp.diags((r * weight[:, None]).ravel()) @ self._A).tocsr()
        b = self.point_jacobian(r, weight)
        back = sp.bsr_matrix((b[:, None, :], np.arange(m), np.arange(m + 1)), (m, 3 * m))
        return S - back @ self._Vinv @ self._C.T

    def point_jacobian(self, r: np.ndarray, weight: np.ndarray) -> np.ndarray:
        """(m, 3) slopes of half the weighed squares of residuals (k, 2) by each point."""
        out = np.zeros((self._points, 3))
        np.add.at(out, self._point, np.einsum("k,kia,ki->ka", weight, self.derivatives.point, r))
        return out

    def points_follow(self, step: np.ndarray, of_points: np.ndarray) -> np.ndarray:
        """(m, 3) steps of the points to one (q,) of poses and lenses, with their own slopes of_points (m, 3)."""
        return -(self._Vinv @ (of_points.ravel() + self._C.T @ step)).reshape(-1, 3)

    def along(self, directions: np.ndarray) -> np.ndarray:
        """(k, 2, e) derivatives of each observation along directions (q, e), its point following."""
        moved = self._A @ directions - self._B @ (self._Vinv @ (self._C.T @ directions))
        return np.asarray(moved).reshape(-1, 2, directions.shape[1])


def _of_lenses(
    views: Views, points: SparsePoints, system: System, lens: Lens, r: np.ndarray, weight: np.ndarray
) -> np.ndarray:
    """1-sigma (e,) of each number of the lenses, with clusters in three ways: see the module."""
    n, e = len(views), len(lens.columns)
    if not e:
        return np.zeros(0)
    # a Cauchy loss curves by weight^2, in the mean over the directions of a residual
    curved = weight**2
    system = system.weighed(curved)
    every = pseudo_inverse(system.normal)[:, 6 * n :]
    inverse = 0.5 * (every[6 * n :] + every[6 * n :].T)
    # poses and points follow: what an observation says of the lenses alone
    slope = system.along(every @ np.linalg.inv(inverse))
    score = weight[:, None] * np.einsum("kie,ki->ke", slope, r)
    seen = Scores(score, np.sqrt(curved)[:, None, None] * slope, np.linalg.cholesky(inverse).T)
    xyz = points.xyz - np.median(points.xyz, axis=0)
    before = np.einsum("kij,kj->ki", views.R[points.obs_view], xyz[points.obs_point])
    labels = (
        in_places(xyz)[points.obs_point],
        in_blocks(points.obs_view, n, points.obs_point),
        in_places(before, SIDES),
    )
    clustered = inverse @ multiway_meat(seen, labels) @ inverse
    independent = inverse * float(np.mean(r**2))
    return np.sqrt(np.diag(at_least(independent, clustered)))


def _deviations(inverse: np.ndarray, score: Any) -> tuple[np.ndarray, np.ndarray]:
    """1-sigma (q,) of each number by the sandwich, and what independent errors of size 1 would give; inverse (q, q) of the
    normal matrix."""
    meat = np.asarray((score.T @ score).todense())
    cov = inverse @ meat @ inverse
    return np.sqrt(np.maximum(np.diag(cov), 0)), np.sqrt(np.maximum(np.diag(inverse), 0))


def pseudo_inverse(H: np.ndarray) -> np.ndarray:
    """Inverse (q, q) of a normal matrix but for what nothing fixes."""
    import scipy.linalg

    scale = 1 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    values, vectors = scipy.linalg.eigh(H * scale[:, None] * scale)
    keep = np.arange(len(values)) >= 7  # rotation, translation and scale of the whole are free
    inverse = (vectors[:, keep] / np.maximum(values[keep], 1e-14)) @ vectors[:, keep].T
    inverse *= scale[:, None] * scale
    return inverse
