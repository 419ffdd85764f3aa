"""Where a fit begins: inertia and momentum that a hypothesis conserves best, without a guess.

The balance in momentum, I u + h - R^T (L0 + integral of R torque) = 0 along the path's own rate u, is homogeneous in
the six numbers of I, in L0 and in every unknown. The solution is the eigenvector of least |M x|^2 over |N x|^2, N the
part I u, so momentum cannot be fitted to nothing (Feng et al. 2018 use the case without effects). A wheel of any
history along one axis drops out of the components across it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.diagnosis.momentum_balance import Forcing
from massprops.diagnosis.motion_path import MotionPath

PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
DIRECTIONS = 400
FEW_DIRECTIONS = 60
"""For a scan: some 18 degrees apart."""
TOGETHER = 100
"""Directions solved for at once: more only take more memory."""
RIDGE = 1e-10
"""Of the mean square of the unknowns' columns: keeps those that are alike apart."""
LEAST_MOMENT = 0.002
"""Least second moment of mass over their sum: a body of such shape is a disk 20 times as wide as thick."""


@dataclass(frozen=True, kw_only=True)
class Start:
    """Where a fit begins.

    Attributes:
        inertia: (3, 3), trace 3, of a body that can be; left: momentum that is not conserved, over all of it.
        axis: (3,) of a wheel, or None; history: (n,) its momentum along the path over the mean moment [rad/s], or None.
    """

    inertia: np.ndarray
    left: float
    axis: np.ndarray | None = None
    history: np.ndarray | None = None


def physical_inertia(inertia: np.ndarray) -> np.ndarray:
    """The nearest inertia (3, 3) of trace 3 that a body can have."""
    from massprops.dynamics.inertia import project_to_physical

    return np.asarray(3.0 * project_to_physical(inertia / np.trace(inertia), LEAST_MOMENT))


def conserved(path: MotionPath, at: np.ndarray, forcing: Forcing | None = None) -> Start:
    """The start under torques or internal momenta that are linear in their unknowns."""
    M, N = _columns(path, at, forcing)
    M, N = M.reshape(-1, M.shape[2]), N.reshape(-1, 6)
    value, six = _least((M.T @ M)[None], (N.T @ N)[None], np.eye(6)[None])
    return start_of(value[0], six[0])


def conserved_by_both(
    path: MotionPath, at: np.ndarray, a: list[Forcing], b: list[Forcing]
) -> tuple[np.ndarray, np.ndarray]:
    """Square of the share of momentum left (a, b) and six of the inertia (a, b, 6), for `start_of`, under one forcing of `a` together with one
    of `b`, for all of either: as `conserved` of both, but each column's products with the others are taken once."""
    M, N = _columns(path, at, None)
    sides = [[_sized(path, at, f) for f in side] for side in (a, b)]
    X = np.concatenate([M, *sides[0], *sides[1]], axis=2).reshape(3 * len(at), -1)
    whole = X.T @ X
    whole[range(6, len(whole)), range(6, len(whole))] += RIDGE * np.mean(np.diag(whole)[6:])
    part = np.einsum("nic,nid->cd", N, N, optimize=True)
    ends = 9 + np.cumsum([f.shape[2] for side in sides for f in side])
    places = [np.arange(end - f.shape[2], end) for f, end in zip([*sides[0], *sides[1]], ends, strict=True)]
    firsts, seconds = places[: len(a)], places[len(a) :]
    out = []
    for columns_of_first in firsts:
        kept = np.concatenate([np.arange(6), *seconds])
        remaining_products = _without(whole, kept, np.concatenate([np.arange(6, 9), columns_of_first]))
        where = np.searchsorted(kept, np.concatenate(seconds)).tolist()
        begun, sixes = 0, []
        for second in seconds:
            sixes.append(_without(remaining_products, np.arange(6), np.array(where[begun : begun + len(second)])))
            begun += len(second)
        out.append(_least(np.array(sixes), np.broadcast_to(part, (len(sixes), 6, 6)), np.eye(6)[None]))
    return np.array([value for value, _ in out]), np.array([six for _, six in out])


def _without(whole: np.ndarray, kept: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Inner products of the columns `kept`, once those of `out` have taken what they can (Schur's complement)."""
    across = whole[np.ix_(kept, out)]
    return whole[np.ix_(kept, kept)] - across @ np.linalg.solve(whole[np.ix_(out, out)], across.T)


def start_of(value: float, six: np.ndarray) -> Start:
    """From the square of the share of momentum left and the six of an inertia (6,)."""
    return Start(inertia=physical_inertia(_positive(_matrix(six))), left=float(np.sqrt(max(value, 0.0))))


def conserved_across(path: MotionPath, at: np.ndarray, forcing: Forcing | None = None) -> Start:
    """The start with a wheel of any history along an axis that the data show: the one across which momentum is
    conserved best under `forcing`, of many directions and then by Nelder and Mead's method.

    The moment about the axis does not show, for the wheel can answer for it: it is taken so that the wheel's momentum
    changes least in all (total variation).
    """
    from scipy.optimize import minimize

    across = _Across(path, at, forcing)
    minimum = minimize(
        lambda v: np.log(max(across.least(v[None] / np.linalg.norm(v))[0][0], 1e-300)), across.best(DIRECTIONS)[1],
        method="Nelder-Mead", options={"maxfev": 150, "xatol": 1e-3, "fatol": 1e-3},
    )  # fmt: skip
    axis = minimum.x / np.linalg.norm(minimum.x)
    values, sixes = across.least(axis[None])
    value, x = float(values[0]), sixes[0]
    inertia = _matrix(x)
    if np.trace(inertia) - axis @ inertia @ axis < 0:
        inertia, x = -inertia, -x
    u = path.w[at]
    h = -(u @ inertia + across.others(axis, x)) @ axis
    more = _least_variation(h, u @ axis)
    inertia, h = inertia + more * np.outer(axis, axis), h - more * (u @ axis)
    size = 3.0 / np.trace(inertia)
    history = np.interp(path.t, path.t[at], size * h)
    return Start(
        inertia=physical_inertia(_positive(inertia)), left=float(np.sqrt(max(value, 0.0))), axis=axis, history=history
    )


def with_mean_moment_about_axis(start: Start, path: MotionPath) -> Start:
    """The same start of a wheel with the moment about its axis as large as those across it are in the mean, which the wheel
    answers for: the balance across the axis says nothing of that moment, and from a needle's a fit seldom comes back."""
    assert start.axis is not None
    about = float(start.axis @ start.inertia @ start.axis)
    return with_more_about_axis(start, path.w, 0.5 * (float(np.trace(start.inertia)) - about) - about)


def with_more_about_axis(start: Start, rate: np.ndarray, more: float) -> Start:
    """The same start of a wheel with another moment about its axis, which the wheel's momentum answers for.

    Args:
        rate: (n, 3) of the body along the path; more: of the moment, over the mean one.
    """
    assert start.axis is not None and start.history is not None
    axis = start.axis
    inertia, h = start.inertia + more * np.outer(axis, axis), start.history - more * (rate @ axis)
    size = 3.0 / np.trace(inertia)
    return Start(inertia=physical_inertia(inertia), left=start.left, axis=axis, history=size * h)


def left_across(path: MotionPath, at: np.ndarray, forcing: Forcing) -> float:
    """Share of momentum that is not conserved under `forcing` across the best of a few directions: what a wheel of any
    history along it leaves of a motion, for a scan."""
    return float(np.sqrt(max(_Across(path, at, forcing).best(FEW_DIRECTIONS)[0], 0.0)))


class _Across:
    """The balance across an axis, from inner products of its columns."""

    def __init__(self, path: MotionPath, at: np.ndarray, forcing: Forcing | None) -> None:
        self._M, N = _columns(path, at, forcing)
        self._whole = np.einsum("nic,njd->ijcd", self._M, self._M, optimize=True)
        self._part = np.einsum("nic,njd->ijcd", N, N, optimize=True)

    def least(self, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Least share (d,) of momentum left across each of some axes (d, 3), and the six of the inertia (d, 6)."""
        P = np.eye(3) - axes[:, :, None] * axes[:, None, :]
        along = np.stack([axes[:, i] * axes[:, j] for i, j in PLACES], axis=1)
        free = np.swapaxes(np.linalg.svd(along[:, None])[2][:, 1:], 1, 2)
        return _least(_projected(P, self._whole), _projected(P, self._part), free)

    def best(self, directions: int) -> tuple[float, np.ndarray]:
        """The least share left, and across which of so many directions."""
        axes = hemisphere(directions)
        value = np.concatenate([self.least(some)[0] for some in np.array_split(axes, max(1, directions // TOGETHER))])
        k = int(np.argmin(value))
        return float(value[k]), axes[k]

    def others(self, axis: np.ndarray, six: np.ndarray) -> np.ndarray:
        """(m, 3) what all but the inertia holds of the balance, body axes, when the six are these."""
        whole = np.einsum("ij,ijcd->cd", np.eye(3) - np.outer(axis, axis), self._whole)
        rest = whole[6:, 6:]
        x = -np.linalg.solve(rest + 1e-10 * np.trace(rest) * np.eye(len(rest)), whole[6:, :6] @ six)
        return np.asarray(self._M[:, :, 6:] @ x)


def hemisphere(count: int) -> np.ndarray:
    """(count, 3) directions spread evenly over half a sphere (Fibonacci's spiral)."""
    k = np.arange(count)
    z = (k + 0.5) / count
    angle = np.pi * (1 + np.sqrt(5.0)) * k
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)


def _columns(path: MotionPath, at: np.ndarray, forcing: Forcing | None) -> tuple[np.ndarray, np.ndarray]:
    """(m, 3, 9 + k) of the six of the inertia, of L0 and of a forcing's unknowns, each as large as the rates, in the balance,
    and (m, 3, 6) of the inertia's part."""
    u = path.w[at]
    N = np.zeros((len(at), 3, 6))
    for k, (i, j) in enumerate(PLACES):
        N[:, i, k] += u[:, j]
        if i != j:
            N[:, j, k] += u[:, i]
    parts = [N, -np.swapaxes(path.R[at], 1, 2)]
    if forcing is not None and forcing.count:
        parts.append(_sized(path, at, forcing))
    return np.concatenate(parts, axis=2), N


def _sized(path: MotionPath, at: np.ndarray, forcing: Forcing) -> np.ndarray:
    """(m, 3, k) of a forcing's unknowns in the balance, each as large as the rates."""
    extra = np.zeros((len(at), 3, forcing.count))
    if forcing.momentum is not None:
        extra -= np.swapaxes(path.R[at], 1, 2) @ forcing.momentum[at]
    if forcing.internal is not None:
        extra += forcing.internal[at]
    size = np.sqrt(np.mean(extra**2, axis=(0, 1)))
    return np.asarray(extra * (np.sqrt(np.mean(path.w[at] ** 2)) / np.maximum(size, 1e-300)))


def _projected(P: np.ndarray, products: np.ndarray) -> np.ndarray:
    """(d, c, c) of products (3, 3, c, c) under each of some projections (d, 3, 3)."""
    c = products.shape[2]
    return np.asarray((P.reshape(-1, 9) @ products.reshape(9, c * c)).reshape(-1, c, c))


def _least(whole: np.ndarray, part: np.ndarray, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least share (d,) of momentum left over and the six of the inertia (d, 6), combinations of `free` (d, 6, f), of inner
    products (d, c, c) of all columns, those of the inertia first, and (d, 6, 6) of the inertia's part."""
    free_T = np.swapaxes(free, 1, 2)
    S = whole[:, :6, :6]
    if whole.shape[1] > 6:
        rest, across = whole[:, 6:, 6:], whole[:, 6:, :6]
        size = RIDGE * np.trace(rest, axis1=1, axis2=2) / rest.shape[1]
        rest = rest + size[:, None, None] * np.eye(rest.shape[1])
        S = S - np.swapaxes(across, 1, 2) @ np.linalg.solve(rest, across)
    P = free_T @ part @ free
    P = P + 1e-9 * (np.trace(P, axis1=1, axis2=2) / P.shape[1])[:, None, None] * np.eye(P.shape[1])
    # the generalised problem in axes in which the inertia's part is round
    root = np.linalg.inv(np.linalg.cholesky(P))
    value, vector = np.linalg.eigh(root @ (free_T @ S @ free) @ np.swapaxes(root, 1, 2))
    six = free @ (np.swapaxes(root, 1, 2) @ vector[:, :, :1])
    return value[:, 0], np.asarray(six[:, :, 0])


def _matrix(six: np.ndarray) -> np.ndarray:
    out = np.zeros((3, 3))
    for value, (i, j) in zip(six, PLACES, strict=True):
        out[i, j] = out[j, i] = value
    return out


def _positive(inertia: np.ndarray) -> np.ndarray:
    return -inertia if np.trace(inertia) < 0 else inertia


def _least_variation(h: np.ndarray, rate: np.ndarray) -> float:
    """The c that makes the total variation of h - c rate least: the median of their slopes, weighted."""
    dh, dr = np.diff(h), np.diff(rate)
    use = np.abs(dr) > 0
    slope, weight = dh[use] / dr[use], np.abs(dr[use])
    order = np.argsort(slope)
    total = np.cumsum(weight[order])
    return float(slope[order][np.searchsorted(total, 0.5 * total[-1])])
