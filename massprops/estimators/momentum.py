"""Inertia, up to scale, from conservation of angular momentum: R(q) I w is constant in inertial axes.

Plain least squares on noisy rates is biased towards a body whose moments are all alike, because the noise of the
rates stands in the matrix (feng2018 eq 23-29). Here every residual is weighted by the covariance that the noise of
attitude and rates gives it *for the inertia being tried*, which takes the bias away (total least squares).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.core.levenberg_marquardt import Damping, damped_step, descend
from massprops.core.linalg import inverse_of
from massprops.dynamics.inertia import DIRECTIONS, LEAST_PART, principal_axes, project_to_physical, ratio_derivatives
from massprops.dynamics.quaternion import rotation_matrix
from massprops.estimators.rates import LocalFit
from massprops.geometry.vectors import skew

FEWEST = 6
"""Epochs with rates from which an inertia is sought."""
LARGEST_COUNT = 60
"""Steps of the search."""
LARGEST_SQUARE = 20.0
"""Squared residual, over the usual one, from which an epoch is an outlier."""


@dataclass(frozen=True)
class Momentum:
    """Inertia from momentum; n epochs, b blocks with a momentum of their own.

    Attributes:
        inertia: (3, 3) body axes, trace 1, physically possible.
        momentum: (b, 3) in the reference frame, in units of the inertia times rad/s.
        information: (5, 5) second derivative of half the cost by `DIRECTIONS`, the noise's own share taken away.
        covariance: (5, 5) of the coordinates along `DIRECTIONS`, from the residuals themselves, correlation included.
        noise_share: (5, 5) the part of the raw information that the noise of the rates alone would give.
        square: mean squared residual in units of its stated variance. used: (n,) epochs that fit.
        correlation: of the epochs used, how many share measurements.
    """

    inertia: np.ndarray
    momentum: np.ndarray
    information: np.ndarray
    covariance: np.ndarray
    noise_share: np.ndarray
    square: float
    used: np.ndarray
    correlation: int = 1


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
        the result, or None with fewer than six usable epochs, or of a body that does not turn at all.
    """
    fine = np.isfinite(q).all(axis=1) & np.isfinite(w).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    # rates from overlapping windows repeat each other: a sixth of a window apart loses nothing
    stride = max(1, correlation // 6)
    rows = np.flatnonzero(fine)[::stride]
    correlation = int(np.ceil(correlation / stride))
    if len(rows) < FEWEST:
        return None
    R, w, P = rotation_matrix(q[rows]), w[rows], covariance[rows]
    if not w.any():
        return None
    place = np.zeros(len(rows), int) if block is None else np.unique(block[rows], return_inverse=True)[1]
    use = _plausible(w)
    starts = (
        [project_to_physical(plain_inertia(q[rows][use], w[use]), 0.02), np.eye(3) / 3.0] if first is None else [first]
    )
    every = Conservation(R, w, P, place)
    inertia, use = _without_outliers(every, use, starts)
    problem = every.of(use)
    at = problem.at(inertia)
    information = _information(problem, inertia)
    square_mean = float(np.mean(np.einsum("ni,ni->n", at.residual, at.force))) / 3.0
    spread = _long_run(problem.score(at), correlation)
    if noise is not None and noise.influence is not None:
        spread = _propagated(problem, at, rows[use], noise) * max(1.0, square_mean)
    inverse = np.linalg.pinv(information, hermitian=True)
    used = np.zeros(len(q), bool)
    used[rows[use]] = True
    return Momentum(
        inertia=inertia,
        momentum=at.momentum,
        information=information,
        covariance=inverse @ spread @ inverse,
        noise_share=problem.noise_share(at),
        square=square_mean,
        used=used,
        correlation=correlation,
    )


def _without_outliers(every: Conservation, use: np.ndarray, starts: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The inertia of least cost from the best of the starts, and the epochs (n,) that fit it."""
    inertia = starts[0]
    for turn in range(4):
        problem = every.of(use)
        fits = [_least(problem, guess) for guess in (starts if turn == 0 else [inertia])]
        inertia = min(fits, key=lambda at: at.cost).inertia
        at = every.at(inertia, use)
        square = np.einsum("ni,ni->n", at.residual, at.force)
        scale = max(float(np.median(square)) / 2.366, 1e-12)
        keep = square < LARGEST_SQUARE * scale
        if (keep == use).all() or keep.sum() < FEWEST:
            break
        use = keep
    return inertia, use


def _information(problem: Conservation, inertia: np.ndarray) -> np.ndarray:
    """(5, 5) second derivative of the cost along `DIRECTIONS`, by differences of the score."""
    step = 1e-5
    total = np.array(
        [problem.score(problem.at(inertia + s * step * E)).sum(axis=0) for E in DIRECTIONS for s in (1, -1)]
    )
    information = (total[::2] - total[1::2]) / (2 * step)
    return np.asarray(0.5 * (information + information.T))


def _plausible(w: np.ndarray) -> np.ndarray:
    """Rates no further from their median than rates of a tumble are from each other."""
    away = np.linalg.norm(w - np.median(w, axis=0), axis=1)
    use: np.ndarray = away <= 10.0 * max(float(np.median(away)), 1e-300)
    return use if use.sum() >= FEWEST else np.ones(len(w), bool)


def _least(problem: Conservation, inertia: np.ndarray) -> At:
    """The residuals at the inertia of least cost near one, among the physical bodies."""

    def linearise(at: At) -> tuple[float, tuple[np.ndarray, np.ndarray]]:
        regressor = problem.corrected(at)
        M = np.einsum("nia,nij,njb->ab", regressor, at.weight, regressor, optimize=True)
        return at.cost, (M + 1e-12 * np.trace(M) * np.eye(5), -problem.score(at).sum(axis=0))

    def step(at: At, equations: tuple[np.ndarray, np.ndarray], damping: float) -> tuple[float, At]:
        trial = at.inertia + np.einsum("a,aij->ij", damped_step(*equations, damping), DIRECTIONS)
        new = problem.at(project_to_physical(trial) if np.linalg.eigvalsh(trial)[2] >= 0.5 - LEAST_PART / 2 else trial)
        return new.cost, new

    at = problem.at(inertia)
    for descent in descend(at, linearise, step, LARGEST_COUNT, Damping(tries=12)):
        change = float(np.linalg.norm(descent.place.inertia - at.inertia))
        at = descent.place
        if descent.fall < 1e-10 * (1.0 + descent.cost + descent.fall) and change < 1e-7:
            break
    return at


@dataclass(frozen=True)
class At:
    """The residuals at one inertia; n epochs, body axes.

    Attributes:
        inertia: (3, 3) trace 1. residual: (n, 3) I w - R^T H; weight: (n, 3, 3) inverse of its covariance; force: (n, 3) their product.
        blamed: (n, 3) the share of each residual that the error of the rates is blamed for, as an error of w.
        lever: (n, 3, 6) of a small turn and of the rates on the residual. momentum: (b, 3). cost: half their squares.
    """

    inertia: np.ndarray
    residual: np.ndarray
    weight: np.ndarray
    force: np.ndarray
    blamed: np.ndarray
    lever: np.ndarray
    momentum: np.ndarray
    cost: float


class Conservation:
    """Residuals of R I w = H over one set of epochs, weighted for the inertia being tried, H eliminated."""

    def __init__(self, R: np.ndarray, w: np.ndarray, P: np.ndarray, block: np.ndarray) -> None:
        self.R, self.w, self.P, self.block = R, w, P, block
        self.blocks = int(block.max()) + 1
        self.by_rate = np.einsum("aij,nj->nia", DIRECTIONS, w)

    def of(self, use: np.ndarray) -> Conservation:
        """The epochs in use."""
        block = np.unique(self.block[use], return_inverse=True)[1]
        return Conservation(self.R[use], self.w[use], self.P[use], block)

    def sums(self, values: np.ndarray) -> np.ndarray:
        """(b, ...) sums of (n, ...) over each block."""
        if self.blocks == 1:
            return np.asarray(values.sum(axis=0, keepdims=True))
        out = np.zeros((self.blocks, *values.shape[1:]))
        np.add.at(out, self.block, values)
        return out

    def at(self, inertia: np.ndarray, use: np.ndarray | None = None) -> At:
        """Residuals at an inertia; with `use`, the momentum comes from those epochs alone."""
        R, Rt = self.R, np.swapaxes(self.R, 1, 2)
        h = self.w @ inertia
        lever = np.empty((len(h), 3, 6))
        lever[:, :, :3] = -skew(h)
        lever[:, :, 3:] = inertia
        carried = self.P @ np.swapaxes(lever, 1, 2)
        S = lever @ carried
        S += 1e-13 * np.einsum("nii->n", S)[:, None, None] * np.eye(3) + 1e-300 * np.eye(3)
        weight = np.linalg.inv(S)
        turned = R @ weight @ Rt
        side = (R @ weight @ h[..., None])[..., 0]
        if use is not None:
            turned, side = turned * use[:, None, None], side * use[:, None]
        whole = self.sums(turned)
        H = (inverse_of(whole) @ self.sums(side)[..., None])[..., 0]
        residual = h - (Rt @ H[self.block][..., None])[..., 0]
        force = (weight @ residual[..., None])[..., 0]
        blamed = (carried[:, 3:] @ force[..., None])[..., 0]
        return At(
            inertia=inertia, residual=residual, weight=weight, force=force, blamed=blamed, lever=lever, momentum=H,
            cost=0.5 * float(np.sum(residual * force)),
        )  # fmt: skip

    def score(self, at: At) -> np.ndarray:
        """(n, 5) derivative of each epoch's cost along `DIRECTIONS`, the blamed error of the rates taken off."""
        slope = np.einsum("aij,nj->nia", DIRECTIONS, self.w - at.blamed)
        moving = np.einsum("nia,ni->na", slope, at.force)
        # the noise of attitude also weighs more as the momentum grows along a direction
        turned = (self.P[:, :3] @ np.swapaxes(at.lever, 1, 2) @ at.force[..., None])[..., 0]
        by_turn = np.cross(at.force, turned)
        return np.asarray(moving - np.einsum("nia,ni->na", self.by_rate, by_turn))

    def corrected(self, at: At) -> np.ndarray:
        """(n, 3, 5): the residuals' slopes at the corrected rates, less what the momentum takes up."""
        slope = np.einsum("aij,nj->nia", DIRECTIONS, self.w - at.blamed)
        weighted = at.weight @ slope
        whole = self.sums(self.R @ at.weight @ np.swapaxes(self.R, 1, 2))
        taken = inverse_of(whole) @ self.sums(self.R @ weighted)
        return np.asarray(slope - np.swapaxes(self.R, 1, 2) @ taken[self.block])

    def noise_share(self, at: At) -> np.ndarray:
        """(5, 5): what rates of pure noise would add to the normal matrix."""
        middle = np.einsum("aij,nik,bkl->nabjl", DIRECTIONS, at.weight, DIRECTIONS, optimize=True)
        return np.asarray(np.einsum("nabjl,njl->ab", middle, self.P[:, 3:, 3:], optimize=True))


def _long_run(score: np.ndarray, correlation: int) -> np.ndarray:
    """Covariance of the sum of a correlated series (n, 5), Bartlett's weights (Newey and West)."""
    n = len(score)
    score = score - score.mean(axis=0)
    lags = min(max(2 * correlation, 1), max(n // 4, 1))
    total = score.T @ score
    for lag in range(1, lags):
        part = score[lag:].T @ score[:-lag]
        total += (1.0 - lag / lags) * (part + part.T)
    return np.asarray(total * n / max(n - 8, 1))


def _propagated(problem: Conservation, at: At, rows: np.ndarray, noise: LocalFit) -> np.ndarray:
    """Covariance (5, 5) of the score from that of every attitude measured and of what all of them share."""
    assert noise.influence is not None and noise.index is not None and noise.sample_covariance is not None
    F = np.swapaxes(problem.corrected(at), 1, 2) @ at.weight @ at.lever
    each = F[:, None] @ noise.influence[rows]
    total = np.zeros((len(noise.q), 5, 3))
    np.add.at(total, noise.index[rows], each)
    score = np.einsum("nai,nij,nbj->ab", total, noise.sample_covariance, total)
    if noise.shared is not None:
        common = np.einsum("nax,nxs->as", F, noise.shared[rows])
        score = score + common @ common.T
    return np.asarray(score)


def ratio_covariance(inertia: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What the covariance along `DIRECTIONS` means for the ratios and axes.

    Returns:
        k covariance (2, 2); covariance (3, 3) of a small turn of the principal axes about body axes [rad^2]; 1-sigma
        of the gaps I2 - I1 and I3 - I2 (2,).
    """
    moments, axes = principal_axes(inertia)
    by_k, by_turn = ratio_derivatives(moments, axes, DIRECTIONS)
    by_moment = np.einsum("ai,nab,bi->in", axes, DIRECTIONS, axes)
    turn, gaps = axes @ by_turn, np.diff(by_moment, axis=0)
    spread = np.sqrt(np.maximum(np.diag(gaps @ covariance @ gaps.T), 0))
    return by_k @ covariance @ by_k.T, turn @ covariance @ turn.T, spread


def _by_direction(w: np.ndarray) -> np.ndarray:
    """(n, 3, 5): I w is w / 3 plus this times the coordinates."""
    return np.einsum("aij,nj->nia", DIRECTIONS, w)
