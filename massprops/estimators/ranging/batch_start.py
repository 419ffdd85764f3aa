"""A batch fit to the first frames of one camera with ranges: where the filter of volpe2017 can begin linearly.

From a rough guess (all points at one depth, no velocity) the filter's first updates are far from linear, and what
they get wrong with confidence stays. Fitted first to a window that grows from a few frames, the same measurements and
the same equations of motion leave a state whose covariance means what it says.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from massprops.core.compiling import compiled
from massprops.core.levenberg_marquardt import Damping, damped_step, descend
from massprops.dynamics.quaternion import conjugate, multiply, rotation_matrix, rotation_vector
from massprops.estimators.filters.state import BODY_AXES, GRAVITY
from massprops.estimators.ranging.inertial import BASE, RangeData, RangeMotion, RangeStart

STEPS = np.repeat([1e-5, 1e-7, 1e-5, 1e-3, 1e-6], [3, 3, 5, 3, 3])
"""Central differences of attitude, rate, inertia, position, velocity: error of rounding and of curvature both below 1e-8."""
DRAWS = 64
"""Pairs of states drawn to see how the motion bends over their uncertainty."""
DECISIVE = 60.0
"""Cost by which one of two mirrored answers must be worse to be given up."""
HUBER = 2.5
MOST_ROUNDS = 25
LARGEST_TURN = 0.1
"""Rotation [rad] per integration step."""


@dataclass(frozen=True)
class BatchFit:
    """Attributes:
    first: state and covariance at the first epoch; last: at the last epoch of the window.
    y: (n, 13) motion q, w, r, v over the window; block: (n, 17, 17) its covariance.
    square: mean squared residual in units of its stated variance; rows: how many numbers were measured.
    outliers: numbers beyond four sigmas. converged.
    """

    first: RangeStart
    last: RangeStart
    y: np.ndarray
    block: np.ndarray
    square: float
    rows: int
    outliers: int
    converged: bool


def fit_first(
    start: RangeStart,
    data: RangeData,
    windows: tuple[int, ...] = (),
    rival: Callable[[RangeMotion], RangeMotion] | None = None,
) -> BatchFit:
    """Least squares on state, inertia and features, with the start's covariance as prior and Huber's loss.

    Args:
        windows: numbers of epochs of the growing window before the last, all of the data.
        rival: another state that the first window can hardly tell from its answer: both are followed until the measurements
            decide.
    """
    times, task = data.times, _Task(start, data)
    state: RangeMotion = start
    rivals = [state]
    for n in (*[k for k in windows if k < len(times)], len(times)):
        solved = [task.solve(x, n) for x in rivals]
        if rival is not None:
            solved.append(task.solve(rival(solved[0][0]), n))
            rival = None
        cost = np.array([task.cost(x, n) for x, _ in solved]) if len(solved) > 1 else np.zeros(1)
        order = np.argsort(cost, kind="stable")
        (state, converged), rivals = solved[order[0]], [solved[i][0] for i in order if cost[i] < cost.min() + DECISIVE]
    return task.result(state, converged)


class _Task:
    def __init__(self, start: RangeStart, data: RangeData) -> None:
        self.times, self.lens, self.uv, self.sigma_px = data.times, data.intrinsics, data.uv, data.sigma_px
        self.ranges, self.sigma_range = data.ranges, data.sigma_range
        self.chaser, self.C = data.inertial_steps(), rotation_matrix(data.camera)
        self.prior_state = start
        scale = np.sqrt(np.maximum(np.diag(start.P), 1e-24))
        self.prior = np.linalg.pinv(start.P / np.outer(scale, scale), rcond=1e-12, hermitian=True)
        self.prior = self.prior / np.outer(scale, scale)

    def paths(self, states: list[RangeMotion], n: int) -> np.ndarray:
        y = np.array([np.concatenate([x.q, x.w, x.r, x.v]) for x in states])
        s = np.array([x.s for x in states])
        run = compiled("trajectories", "massprops.dynamics.kernels", BODY_AXES, GRAVITY)
        return np.asarray(run(self.times[:n], y, s, self.chaser[:n], LARGEST_TURN))

    def environment(self, x: RangeMotion, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Motion (n, 13) and the derivative of its errors (n, 12, 17): attitude, rate, position, velocity."""
        moves = np.zeros((BASE, BASE + x.f.size))
        moves[:, :BASE] = np.diag(STEPS)
        y = self.paths([x, *(x.moved(d) for d in moves), *(x.moved(-d) for d in moves)], n)
        up, down = y[1 : BASE + 1], y[BASE + 1 :]
        turn = rotation_vector(multiply(conjugate(down[..., :4]), up[..., :4]))
        change = np.concatenate([turn, up[..., 4:] - down[..., 4:]], axis=-1) / (2 * STEPS)[:, None, None]
        return y[0], np.moveaxis(change, 0, -1)

    def residual(self, y: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (n, m, 2) and ranges (n,) in units of their noise, zero where not measured."""
        n = len(y)
        X = y[:, None, 7:10] + np.einsum("nij,mj->nmi", rotation_matrix(y[:, :4]), f)
        Y = np.einsum("nji,nmj->nmi", self.C[:n], X)
        depth = np.maximum(Y[..., 2:], 1e-3)
        pixel = (self.uv[:n] - self.lens[:2] * Y[..., :2] / depth - self.lens[2:]) / self.sigma_px
        span = (self.ranges[:n] - np.linalg.norm(y[:, 7:10], axis=1)) / self.sigma_range
        return np.where(np.isfinite(pixel), pixel, 0.0), np.where(np.isfinite(span), span, 0.0)

    def cost(self, x: RangeMotion, n: int) -> float:
        pixel, span = self.residual(self.paths([x], n)[0], x.f)
        d = x.minus(self.prior_state)
        total = float(
            np.sum(_huber(np.linalg.norm(pixel, axis=-1))) + np.sum(_huber(np.abs(span))) + d @ self.prior @ d
        )
        return total if np.isfinite(total) else np.inf

    def normal(self, x: RangeMotion, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Normal matrix, gradient, motion and its derivative."""
        y, J = self.environment(x, n)
        m = len(x.f)
        pixel, span = self.residual(y, x.f)
        R = rotation_matrix(y[:, :4])
        arm = np.einsum("nij,mj->nmi", R, x.f)
        Y = np.einsum("nji,nmj->nmi", self.C[:n], y[:, None, 7:10] + arm)
        depth = np.maximum(Y[..., 2], 1e-3)
        by_Y = np.zeros((n, m, 2, 3))
        by_Y[..., 0, 0], by_Y[..., 1, 1] = self.lens[0] / depth, self.lens[1] / depth
        by_Y[..., :, 2] = -self.lens[:2] * Y[..., :2] / (depth * depth)[..., None]
        by_X = np.einsum("nmij,nkj->nmik", by_Y, self.C[:n]) / self.sigma_px
        by_f = by_X @ R[:, None]
        # d(R f) = -R [f x] turn: row b of by_f gives f x b
        by_turn = np.cross(x.f[None, :, None, :], by_f)
        seen = np.isfinite(self.uv[:n]).all(axis=-1)
        by_base = by_turn @ J[:, None, :3] + by_X @ J[:, None, 6:9]
        weight = np.where(seen, _weight(np.linalg.norm(pixel, axis=-1)), 0.0)
        w = weight[..., None, None]
        size = BASE + 3 * m
        N, b = self.prior.copy(), -self.prior @ x.minus(self.prior_state)
        wb = w * by_base
        N[:BASE, :BASE] += np.einsum("nmia,nmib->ab", wb, by_base, optimize=True)
        b[:BASE] += np.einsum("nmia,nmi->a", wb, pixel, optimize=True)
        cross = np.einsum("nmia,nmif->maf", wb, by_f, optimize=True)
        feature_blocks = np.einsum("nmia,nmib->mab", w * by_f, by_f, optimize=True)
        right = np.einsum("nmif,nmi->mf", w * by_f, pixel, optimize=True)
        for i in range(m):
            at = slice(BASE + 3 * i, BASE + 3 * i + 3)
            N[:BASE, at] += cross[i]
            N[at, :BASE] += cross[i].T
            N[at, at] += feature_blocks[i]
            b[at] += right[i]
        ranged = np.isfinite(self.ranges[:n])
        toward = y[:, 7:10] / np.linalg.norm(y[:, 7:10], axis=1, keepdims=True) / self.sigma_range
        by_span = np.einsum("ni,nia->na", toward, J[:, 6:9])
        ws = np.where(ranged, _weight(np.abs(span)), 0.0)[:, None]
        N[:BASE, :BASE] += (ws * by_span).T @ by_span if ranged.any() else 0.0
        b[:BASE] += (ws * by_span).T @ span if ranged.any() else 0.0
        assert len(b) == size
        return N, b, y, J

    def solve(self, x: RangeMotion, n: int) -> tuple[RangeMotion, bool]:
        """The state of least cost near one over the first n epochs, and whether the search came to rest."""

        def linearise(x: RangeMotion) -> tuple[float, tuple[np.ndarray, ...]]:
            N, b, _, _ = self.normal(x, n)
            scale = np.sqrt(np.diag(N))
            return self.cost(x, n), (N / np.outer(scale, scale), b / scale, scale)

        def step(x: RangeMotion, equations: tuple[np.ndarray, ...], damping: float) -> tuple[float, RangeMotion]:
            normal, side, scale = equations
            d = damped_step(normal, side, damping) / scale
            d[6:11] = np.clip(d[6:11], -0.5, 0.5)
            new = x.moved(d)
            return self.cost(new, n), new

        for descent in descend(x, linearise, step, MOST_ROUNDS, Damping(1e-4, raised=5.0, least=1e-12, most=1e8)):
            x = descent.place
            if descent.fall < 1e-3 + 1e-6 * descent.cost:
                return x, True
        return x, False

    def result(self, x: RangeMotion, converged: bool) -> BatchFit:
        n = len(self.times)
        N, _, y, J = self.normal(x, n)
        scale = np.sqrt(np.diag(N))
        P = _inverse(N / np.outer(scale, scale)) / np.outer(scale, scale)
        pixel, span = self.residual(y, x.f)
        rows = int(np.isfinite(self.uv).sum() + np.isfinite(self.ranges).sum())
        far = int((np.abs(pixel) > 4).sum() + (np.abs(span) > 4).sum())
        near = np.concatenate([pixel.ravel(), span])
        near = near[np.abs(near) < 4]
        full = np.zeros((n, BASE, BASE))
        full[:, :6], full[:, 11:] = J[:, :6], J[:, 6:]
        full[:, 6:11, 6:11] = np.eye(5)
        block = full @ P[:BASE, :BASE] @ np.swapaxes(full, 1, 2)
        first = RangeStart(x.q, x.w, x.s, x.r, x.v, x.f, P)
        # what Huber's loss gives up of the information at normal noise is small: HUBER = 2.5 keeps 99 %
        square = float(np.sum(near**2)) / max(rows - far - len(P), 1)
        return BatchFit(
            first=first, last=self.at_end(x, P, full[-1], y[-1], n), y=y, block=block, square=square, rows=rows,
            outliers=far, converged=converged,
        )  # fmt: skip

    def at_end(self, x: RangeMotion, P: np.ndarray, J: np.ndarray, y: np.ndarray, n: int) -> RangeStart:
        """State and covariance at the last epoch, with the second order of the motion in both.

        The body axes are known exactly at the first epoch. What ties later attitudes, rates and inertia to that is a
        curved surface; a linear covariance would hold the state to its tangent, many times thinner than the surface
        bends over the uncertainty, and the filter would go on from there sure of what is false.

        Args:
            P: at the first epoch; J (17, 17): derivative of the last epoch's errors by the first one's; y: motion there.
        """
        scale = np.sqrt(np.diag(P)[:BASE])
        root = scale[:, None] * np.linalg.cholesky(P[:BASE, :BASE] / np.outer(scale, scale) + 1e-13 * np.eye(BASE))
        moves = np.zeros((DRAWS, BASE + x.f.size))
        moves[:, :BASE] = np.random.default_rng(DRAWS).standard_normal((DRAWS, BASE)) @ root.T
        ahead = self.paths([*(x.moved(d) for d in moves), *(x.moved(-d) for d in moves)], n)[:, -1]
        off = np.zeros((2 * DRAWS, BASE))
        off[:, :3] = rotation_vector(multiply(conjugate(y[:4]), ahead[:, :4]))
        off[:, 3:6], off[:, 11:] = ahead[:, 4:7] - y[4:7], ahead[:, 7:] - y[7:]
        curvature = 0.5 * (off[:DRAWS] + off[DRAWS:])
        mean = curvature.mean(axis=0)
        last = P.copy()
        last[:BASE] = J @ last[:BASE]
        last[:, :BASE] = last[:, :BASE] @ J.T
        last[:BASE, :BASE] += (curvature - mean).T @ (curvature - mean) / DRAWS
        z = RangeMotion(y[:4], y[4:7], x.s, y[7:10], y[10:], x.f).moved(np.concatenate([mean, np.zeros(x.f.size)]))
        return RangeStart(z.q, z.w, z.s, z.r, z.v, z.f, 0.5 * (last + last.T))


def _huber(size: np.ndarray) -> np.ndarray:
    """Twice Huber's loss of normalised residuals."""
    return np.where(size < HUBER, size * size, 2 * HUBER * size - HUBER**2)


def _weight(size: np.ndarray) -> np.ndarray:
    return np.where(size < HUBER, 1.0, HUBER / np.maximum(size, 1e-300))


def _inverse(information: np.ndarray) -> np.ndarray:
    """Inverse of an information matrix of unit diagonal, positive definite however little the data show of some
    combination, such as of the inertia in a flat spin."""
    value, vector = np.linalg.eigh(0.5 * (information + information.T))
    inverse: np.ndarray = (vector / np.maximum(value, 1e-14 * value[-1])) @ vector.T
    inverse = 0.5 * (inverse + inverse.T)
    return inverse
