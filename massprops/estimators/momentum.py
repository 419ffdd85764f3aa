"""Inertia, up to scale, from conservation of angular momentum: R(q) I w is constant in inertial axes.

Plain least squares on noisy rates is biased towards a body whose moments are all alike, because the noise of the
rates stands in the matrix (feng2018 eq 23-29). Here every residual is weighted by the covariance that the noise of
attitude and rates gives it *for the inertia being tried*, which takes the bias away (total least squares).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.dynamics.quaternion import rotation_matrix
from massprops.estimators.rates import LocalFit

LARGEST_SQUARE = 20.0
SMALLEST_PART = 1e-4
"""Least eigenvalue of Sigma = tr(I)/2 - I over its trace, for a start inside the physical bodies."""


@dataclass(frozen=True)
class Momentum:
    """Inertia from momentum; n epochs, b blocks with a momentum of their own.

    Attributes:
        inertia: (3, 3) body axes, trace 1, physically possible.
        momentum: (b, 3) in the reference frame, in units of the inertia times rad/s.
        information: (5, 5) second derivative of half the cost by `DIRECTIONS`, the noise's own share taken away.
        score_covariance: (5, 5) of the cost's first derivative, from the residuals themselves, correlation included.
        covariance: (5, 5) of the coordinates along `DIRECTIONS`.
        noise_share: (5, 5) the part of the raw information that the noise of the rates alone would give.
        square: mean squared residual in units of its stated variance. used: (n,) epochs that fit.
        correlation: of the epochs used, how many share measurements.
    """

    inertia: np.ndarray
    momentum: np.ndarray
    information: np.ndarray
    score_covariance: np.ndarray
    covariance: np.ndarray
    noise_share: np.ndarray
    square: float
    used: np.ndarray
    correlation: int = 1


def _directions() -> np.ndarray:
    r = np.sqrt(0.5)
    E = np.zeros((5, 3, 3))
    E[0] = np.diag([r, -r, 0])
    E[1] = np.diag([1, 1, -2]) / np.sqrt(6)
    for k, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
        E[2 + k, i, j] = E[2 + k, j, i] = r
    return E


DIRECTIONS = _directions()
"""(5, 3, 3) orthonormal symmetric matrices without trace: the ways an inertia of trace 1 can change."""


def plain_inertia(q: np.ndarray, w: np.ndarray) -> np.ndarray:
    """(3, 3), trace 1: unweighted least squares of feng2018 (eq 23-28), without its constraints; biased.

    Args:
        q: (n, 4) body to inertial; w: (n, 3) body rates [rad/s].
    """
    R = rotation_matrix(q)
    J = R @ _by_direction(w)
    base = np.einsum("nij,nj->ni", R, w) / 3.0
    J, base = J - J.mean(axis=0), base - base.mean(axis=0)
    x = np.linalg.lstsq(J.reshape(-1, 5), -base.reshape(-1), rcond=None)[0]
    return np.eye(3) / 3.0 + np.einsum("a,aij->ij", x, DIRECTIONS)


def physical(inertia: np.ndarray, least: float = SMALLEST_PART) -> np.ndarray:
    """The nearest body of trace 1 with positive moments that meet the triangle inequalities.

    Those hold together exactly when Sigma = tr(I)/2 - I, the second moments of mass, is positive definite.
    """
    inertia = 0.5 * (inertia + inertia.T)
    values, axes = np.linalg.eigh(0.5 * np.trace(inertia) * np.eye(3) - inertia)
    trace = max(float(np.trace(inertia)) / 2, 1e-12)
    sigma = axes @ np.diag(_simplex(values / trace, least)) @ axes.T
    return _from_sigma(sigma)


def _simplex(values: np.ndarray, least: float) -> np.ndarray:
    """Nearest values that are at least `least` and sum to one."""
    room = 1.0 - 3 * least
    v = np.sort(values - least)[::-1]
    total = np.cumsum(v) - room
    k = np.flatnonzero(v - total / np.arange(1, 4) > 0)[-1]
    return np.maximum(values - least - total[k] / (k + 1), 0.0) + least


def _from_sigma(sigma: np.ndarray) -> np.ndarray:
    sigma = sigma / np.trace(sigma) / 2.0
    return np.trace(sigma) * np.eye(3) - sigma


def momentum_inertia(
    q: np.ndarray,
    w: np.ndarray,
    covariance: np.ndarray,
    block: np.ndarray | None = None,
    correlation: int = 1,
    first: np.ndarray | None = None,
    noise: LocalFit | None = None,
) -> Momentum | None:
    """Errors-in-variables least squares for the inertia, over physically possible bodies only.

    Args:
        q: (n, 4) body to inertial; w: (n, 3) body rates [rad/s]; covariance: (n, 6, 6) of a small turn about body
        axes and of the rates. Rows with NaN are left out.
        block: (n,) numbers of blocks that each have a momentum of their own (when attitude drifts); one by default.
        correlation: epochs over which neighbouring rates share measurements.
        first: (3, 3) start; the plain least squares by default.
        noise: where attitude and rates come from, so that errors which neighbours share are counted; without it the
        residuals' own correlation serves.

    Returns:
        the result, or None with fewer than six usable epochs.
    """
    from scipy.optimize import least_squares

    fine = np.isfinite(q).all(axis=1) & np.isfinite(w).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    if fine.sum() < 6:
        return None
    # rates from overlapping windows repeat each other: a sixth of a window apart loses nothing
    rows = np.flatnonzero(fine)[:: max(1, correlation // 6)]
    correlation = int(np.ceil(correlation / max(1, correlation // 6)))
    if len(rows) < 6:
        return None
    R, w, P = rotation_matrix(q[rows]), w[rows], covariance[rows]
    place = np.zeros(len(rows), int) if block is None else np.unique(block[rows], return_inverse=True)[1]
    start = physical(plain_inertia(q[rows], w) if first is None else first, 0.02)
    use = np.ones(len(rows), bool)
    inertia = start
    for _ in range(3):
        problem = _Conservation(R[use], w[use], P[use], np.unique(place[use], return_inverse=True)[1])
        guesses = (inertia, np.eye(3) / 3.0) if first is None and use.all() else (inertia,)
        fits = [_solve(least_squares, problem, guess) for guess in guesses]
        inertia = min(fits, key=lambda pair: pair[0])[1]
        every = _Conservation(R, w, P, place)
        residual, _ = every.residual(inertia)
        square = np.sum(residual**2, axis=1)
        scale = max(float(np.median(square)) / 2.366, 1e-12)
        keep = square < LARGEST_SQUARE * scale
        if (keep == use).all() or keep.sum() < 6:
            break
        use = keep
    problem = _Conservation(R[use], w[use], P[use], np.unique(place[use], return_inverse=True)[1])
    residual, H = problem.residual(inertia)
    information, score, J = _information(problem, inertia, correlation)
    if noise is not None and noise.influence is not None:
        score = _propagated(problem, inertia, J, rows[use], noise) * max(1.0, float(np.mean(residual**2)))
    share = problem.noise_share(inertia)
    inverse = np.linalg.pinv(information, hermitian=True)
    spread = inverse @ score @ inverse
    used = np.zeros(len(q), bool)
    used[rows[use]] = True
    square_mean = float(np.mean(residual**2))
    return Momentum(inertia, H, information, score, spread, share, square_mean, used, correlation)


def _solve(least_squares, problem: _Conservation, guess: np.ndarray) -> tuple[float, np.ndarray]:  # type: ignore[no-untyped-def]
    sigma = 0.5 * np.trace(guess) * np.eye(3) - guess
    values, axes = np.linalg.eigh(sigma / np.trace(sigma))
    L = np.linalg.cholesky(axes @ np.diag(_simplex(values, 1e-3)) @ axes.T)
    low = np.tril_indices(3)

    def body(x: np.ndarray) -> np.ndarray:
        L = np.zeros((3, 3))
        L[low] = x
        return _from_sigma(L @ L.T)

    fit = least_squares(lambda x: problem.residual(body(x))[0].ravel(), L[low], method="trf", x_scale=0.3, max_nfev=60)
    return float(fit.cost), body(fit.x)


class _Conservation:
    """The residuals of one set of epochs, whitened for the inertia being tried."""

    def __init__(self, R: np.ndarray, w: np.ndarray, P: np.ndarray, block: np.ndarray) -> None:
        self.R, self.w, self.P, self.block = R, w, P, block
        self.count = np.bincount(block)

    def sums(self, values: np.ndarray) -> np.ndarray:
        out = np.zeros((len(self.count), *values.shape[1:]))
        np.add.at(out, self.block, values)
        return out

    def weights(self, inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """I w (n, 3), Cholesky factor of the residuals' covariance (n, 3, 3) in body axes, H (b, 3)."""
        h = self.w @ inertia
        turned = np.einsum("nij,nj->ni", self.R, h)
        mean = (self.sums(turned) / self.count[:, None])[self.block]
        G = np.empty((len(h), 3, 6))
        G[:, :, :3] = -_cross(np.einsum("nji,nj->ni", self.R, mean))
        G[:, :, 3:] = inertia
        S = G @ self.P @ np.swapaxes(G, 1, 2)
        S += 1e-12 * np.einsum("nii->n", S)[:, None, None] * np.eye(3) + 1e-300 * np.eye(3)
        weight = self.R @ np.linalg.inv(S) @ np.swapaxes(self.R, 1, 2)
        H = np.linalg.solve(self.sums(weight), self.sums(np.einsum("nij,nj->ni", weight, turned))[..., None])[..., 0]
        return h, np.linalg.cholesky(S), H

    def residual(self, inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, 3) of unit variance when the covariance is right, and H (b, 3)."""
        h, L, H = self.weights(inertia)
        r = h - np.einsum("nji,nj->ni", self.R, H[self.block])
        return np.linalg.solve(L, r[..., None])[..., 0], H

    def noise_share(self, inertia: np.ndarray) -> np.ndarray:
        """(5, 5): what rates of pure noise would add to the normal matrix."""
        _, L, _ = self.weights(inertia)
        inverse = np.linalg.inv(L)
        weight = np.swapaxes(inverse, 1, 2) @ inverse
        rates = self.P[:, 3:, 3:]
        middle = np.einsum("aij,nik,bkl->nabjl", DIRECTIONS, weight, DIRECTIONS, optimize=True)
        return np.asarray(np.einsum("nabjl,njl->ab", middle, rates, optimize=True))


def _information(
    problem: _Conservation, inertia: np.ndarray, correlation: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Second derivative of half the cost, covariance of its first, and the residuals' derivative (n, 3, 5)."""
    step = 2e-4
    offsets = np.concatenate([np.eye(5), -np.eye(5)]) * step
    raised = [problem.residual(inertia + np.einsum("a,aij->ij", o, DIRECTIONS))[0] for o in offsets]
    centre = problem.residual(inertia)[0]
    J = np.stack([(raised[a] - raised[a + 5]) / (2 * step) for a in range(5)], axis=-1)
    score = np.einsum("ni,nia->na", centre, J)
    half = 0.5 * np.array([np.sum(r**2) for r in raised])
    middle = 0.5 * float(np.sum(centre**2))
    information = np.empty((5, 5))
    for a in range(5):
        information[a, a] = (half[a] - 2 * middle + half[a + 5]) / step**2
        for b in range(a):
            both = step * (np.eye(5)[a] + np.eye(5)[b])
            up = 0.5 * np.sum(problem.residual(inertia + np.einsum("a,aij->ij", both, DIRECTIONS))[0] ** 2)
            down = 0.5 * np.sum(problem.residual(inertia - np.einsum("a,aij->ij", both, DIRECTIONS))[0] ** 2)
            mixed = (up + down - half[a] - half[a + 5] - half[b] - half[b + 5] + 2 * middle) / (2 * step**2)
            information[a, b] = information[b, a] = mixed
    return information, _long_run(score - score.mean(axis=0), correlation), J


def _propagated(
    problem: _Conservation, inertia: np.ndarray, J: np.ndarray, rows: np.ndarray, noise: LocalFit
) -> np.ndarray:
    """Covariance (5, 5) of the score from that of every attitude measured and of what all of them share."""
    assert noise.influence is not None and noise.index is not None and noise.sample_covariance is not None
    _, L, H = problem.weights(inertia)
    G = np.empty((len(rows), 3, 6))
    G[:, :, :3] = -_cross(np.einsum("nji,nj->ni", problem.R, H[problem.block]))
    G[:, :, 3:] = inertia
    F = np.swapaxes(J, 1, 2) @ np.linalg.solve(L, G)
    each = F[:, None] @ noise.influence[rows]
    total = np.zeros((len(noise.q), 5, 3))
    np.add.at(total, noise.index[rows], each)
    score = np.einsum("nai,nij,nbj->ab", total, noise.sample_covariance, total)
    if noise.shared is not None:
        common = np.einsum("nax,nxs->as", F, noise.shared[rows])
        score = score + common @ common.T
    return np.asarray(score)


def _long_run(score: np.ndarray, correlation: int) -> np.ndarray:
    """Covariance of the sum of a correlated series (n, 5), Bartlett's weights (Newey and West)."""
    n = len(score)
    lags = min(max(2 * correlation, 1), max(n // 4, 1))
    total = score.T @ score
    for lag in range(1, lags):
        part = score[lag:].T @ score[:-lag]
        total += (1.0 - lag / lags) * (part + part.T)
    return np.asarray(total * n / max(n - 8, 1))


def ratio_covariance(inertia: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the covariance along `DIRECTIONS` means for the ratios and axes.

    Returns:
        k covariance (2, 2); covariance (3, 3) of a small turn of the principal axes about body axes [rad^2]; 1-sigma
        of the gaps I2 - I1 and I3 - I2 (2,).
    """
    moments, axes = np.linalg.eigh(inertia)
    local = np.einsum("ia,nij,jb->nab", axes, DIRECTIONS, axes)
    by_moment = np.stack([local[:, i, i] for i in range(3)])
    log = by_moment / moments[:, None]
    k = np.stack([log[0] - log[1], log[1] - log[2]])
    gaps = np.stack([by_moment[1] - by_moment[0], by_moment[2] - by_moment[1]])
    turns = []
    for i, j in ((1, 2), (2, 0), (0, 1)):
        gap = moments[j] - moments[i]
        turns.append(local[:, i, j] / (np.copysign(max(abs(gap), 1e-9), gap)))
    # axes turned by theta: R(theta) D R(theta)^T has off-diagonal theta_k (d_i - d_j)
    turn = axes @ -np.stack(turns)
    return k @ covariance @ k.T, turn @ covariance @ turn.T, np.sqrt(np.maximum(np.diag(gaps @ covariance @ gaps.T), 0))


def _by_direction(w: np.ndarray) -> np.ndarray:
    """(n, 3, 5): I w is w / 3 plus this times the coordinates."""
    return np.einsum("aij,nj->nia", DIRECTIONS, w)


def _cross(v: np.ndarray) -> np.ndarray:
    zero = np.zeros(len(v))
    rows = [[zero, -v[:, 2], v[:, 1]], [v[:, 2], zero, -v[:, 0]], [-v[:, 1], v[:, 0], zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
