"""Coregionalised quasi-periodic process: training and prediction.

Model (kabir2025 section 2.3, GPy's intrinsic coregionalisation): y(t) = mean + g(t) + noise with
cov(g(t), g(t')) = B k(t - t'), B (d, d) positive semidefinite, k the product-periodic kernel with unit variance,
noise white with one variance for all outputs. In the eigenvectors of B the outputs are independent, and each is a
regression on the lines of `kernel`. Hyperparameters maximise the marginal likelihood with analytic gradients; the two
frequencies, which the data fix many orders more sharply than the rest, are found by Gauss-Newton in turn with them.

Unlike the paper's, the predicted variance includes what the record leaves open in the two frequencies: far outside
the record that is most of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.errors import NotPossible
from massprops.estimators.gp.kernel import feature_jacobian, feature_rates, features, lattice, line_weights, per_column
from massprops.estimators.gp.periods import candidate_pairs, frequency_step

WEIGHT_FLOOR = 1e-14
"""Lines whose share of the variance is below this are beneath rounding and keep this floor."""


@dataclass(frozen=True)
class QuasiPeriodicProcess:
    """A trained process.

    Attributes:
        t0: time origin [s].
        mean: (d,) mean of the training data.
        f: (2,) fundamental frequencies [Hz].
        f_cov: (2, 2) their covariance [Hz^2].
        noise_sigma: 1-sigma of the white noise, in the units of y.
        orders: (m, 2) lattice.
        coefficients: (2m - 1, d) posterior mean of the lines' amplitudes.
        factors: (d, 2m - 1, 2m - 1) per eigen-output, F with posterior covariance F F^T.
        U: (d, d) eigenvectors of the coregionalisation B.
        log_likelihood: of the training data.
    """

    t0: float
    mean: np.ndarray
    f: np.ndarray
    f_cov: np.ndarray
    noise_sigma: float
    orders: np.ndarray
    coefficients: np.ndarray
    factors: np.ndarray
    U: np.ndarray
    log_likelihood: float

    def predict(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Noise-free outputs and their rates.

        Args:
            t: (n,) times [s].

        Returns:
            value (n, d); rate (n, d) [1/s]; covariance (n, 2d, 2d) of value and rate together, without white noise.
        """
        s = np.asarray(t, float) - self.t0
        phi = features(s, self.orders, self.f)
        rate = feature_rates(phi, self.orders, self.f)
        n, d = len(s), len(self.mean)
        both = np.stack([phi, rate], axis=1)  # (n, 2, r)
        cov = np.zeros((n, 2 * d, 2 * d))
        for i in range(d):
            g = both @ self.factors[i]
            block = g @ g.transpose(0, 2, 1)  # (n, 2, 2)
            cov += np.einsum("nab,c,e->nacbe", block, self.U[:, i], self.U[:, i]).reshape(n, 2 * d, 2 * d)
        slope = feature_jacobian(phi, s, self.orders)
        lean = np.zeros((n, 2 * d, 2))
        for k in range(2):
            lean[:, :d, k] = slope[k] @ self.coefficients
            lean[:, d:, k] = feature_rates(slope[k], self.orders, self.f) @ self.coefficients
            turn = 2.0 * np.pi * per_column(self.orders[:, k].astype(float))
            swapped = feature_rates(phi, self.orders, self.f) / np.where(
                (w := 2.0 * np.pi * per_column(self.orders @ self.f)) == 0.0, 1.0, w
            )
            lean[:, d:, k] += (swapped * turn) @ self.coefficients
        cov += lean @ self.f_cov @ lean.transpose(0, 2, 1)
        return self.mean + phi @ self.coefficients, rate @ self.coefficients, cov


def fit_process(t: np.ndarray, y: np.ndarray, frequencies: np.ndarray | None = None) -> QuasiPeriodicProcess:
    """Trains the process.

    Args:
        t: (n,) times [s], increasing; gaps are allowed.
        y: (n, d) measurements.
        frequencies: (2,) start [Hz]; by default from the spectrum (`periods.candidate_pairs`).

    Raises:
        NotPossible: fewer than 30 samples, or values that are not finite, or no variation.
    """
    t, y = np.asarray(t, float), np.asarray(y, float)
    if len(t) < 30 or not np.all(np.isfinite(y)):
        raise NotPossible(
            f"Gaussian process: {len(t)} finite samples are too few to learn periods from; give at least 30"
        )
    mean, spread = y.mean(axis=0), float(np.sqrt(np.mean((y - y.mean(axis=0)) ** 2)))
    if spread == 0.0:
        raise NotPossible("Gaussian process: the measurements do not vary, so there is no period to learn; use 'ukf'")
    t0 = float(t[0])
    s, v = t - t0, (y - mean) / spread
    starts = [np.asarray(frequencies, float)] if frequencies is not None else candidate_pairs(s, v)
    if not starts:
        raise NotPossible("Gaussian process: no period stands out; give a longer record, or use 'ukf'")
    trials = [_train(s, v, _start(s, v, f), lattice(3), iterations=20) for f in starts]
    fit = min(trials, key=lambda trial: trial.nll)
    for iterations in (25, 25, 15):
        fit = _train(s, v, fit, fit.worthwhile_lines(len(t)), iterations)
    return fit.process(t0, mean, spread)


@dataclass
class _Fit:
    """State of training, in standardised units."""

    t: np.ndarray
    y: np.ndarray
    f: np.ndarray
    orders: np.ndarray
    chol: np.ndarray
    z: np.ndarray
    noise: float
    nll: float = np.inf

    def worthwhile_lines(self, n: int) -> np.ndarray:
        """Lines whose expected power is not far below the noise left in one fitted amplitude, with some margin."""
        orders = lattice(14)
        weight, _ = line_weights(orders, 1.3 * self.z)
        keep = weight * np.trace(self.chol @ self.chol.T) > 1e-3 * self.noise / n
        keep[0] = True
        return orders[keep]

    def parts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Eigenvalues (d,), eigenvectors (d, d) of B and weight per column (r,)."""
        B = self.chol @ self.chol.T
        lam, U = np.linalg.eigh(B)
        w, _ = line_weights(self.orders, self.z)
        return np.maximum(lam, 1e-12 * lam[-1]), U, per_column(np.maximum(w, WEIGHT_FLOOR))

    def process(self, t0: float, mean: np.ndarray, spread: float) -> QuasiPeriodicProcess:
        """The trained process in the units of the data."""
        from scipy.linalg import solve_triangular

        lam, U, w = self.parts()
        phi = features(self.t, self.orders, self.f)
        gram, b = phi.T @ phi, phi.T @ (self.y @ U)
        factors, c = [], []
        for i in range(len(lam)):
            root = np.sqrt(lam[i] * w)
            chol = np.linalg.cholesky(self.noise * np.eye(len(w)) + root[:, None] * gram * root)
            half = solve_triangular(chol, np.diag(root), lower=True)
            factors.append(np.sqrt(self.noise) * half.T)
            c.append(half.T @ (half @ b[:, i]))
        _, _, information = frequency_step(self.t, self.y @ U, self.orders, self.f, self.noise / np.outer(w, lam))
        return QuasiPeriodicProcess(
            t0=t0,
            mean=mean,
            f=self.f,
            f_cov=self.noise * np.linalg.pinv(information),
            noise_sigma=float(spread * np.sqrt(self.noise)),
            orders=self.orders,
            coefficients=spread * np.stack(c, axis=1) @ U.T,
            factors=spread * np.stack(factors),
            U=U,
            log_likelihood=-self.nll - self.y.size * float(np.log(spread)),
        )


def _start(t: np.ndarray, y: np.ndarray, f: np.ndarray) -> _Fit:
    """Hyperparameters to begin with: the outputs' own covariance and length scales of middling smoothness."""
    d = y.shape[1]
    B = np.cov(y.T).reshape(d, d) + 1e-6 * np.eye(d)
    return _Fit(t, y, f, lattice(0), np.linalg.cholesky(B), np.array([0.5, 0.5]), 1e-4)


def _train(t: np.ndarray, y: np.ndarray, start: _Fit, orders: np.ndarray, iterations: int) -> _Fit:
    """Frequencies by Gauss-Newton, then the other hyperparameters by L-BFGS, then the frequencies once more."""
    from scipy.optimize import minimize

    d = y.shape[1]
    ridge = np.full((2 * len(orders) - 1, d), 1e-7 * len(t))
    fit = _Fit(t, y, start.f, orders, start.chol, start.z, start.noise)
    if len(start.orders) > 1:
        lam, U, w = fit.parts()
        fit.f = _gauss_newton(t, y @ U, orders, fit.f, fit.noise / np.outer(w, lam))
    else:
        fit.f = _gauss_newton(t, y, orders, fit.f, ridge)
    rows, cols = np.tril_indices(d)
    phi = features(t, orders, fit.f)
    gram, b, total = phi.T @ phi, phi.T @ y, y.T @ y

    def unpack(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        chol = np.zeros((d, d))
        chol[rows, cols] = x[:-3]
        return chol, np.exp(x[-3:-1]), float(np.exp(x[-1]))

    def objective(x: np.ndarray) -> tuple[float, np.ndarray]:
        value, by_chol, by_z, by_noise = _nll(gram, b, total, len(t), orders, *unpack(x))
        return value, np.concatenate([by_chol[rows, cols], by_z, [by_noise]])

    x0 = np.concatenate([fit.chol[rows, cols], np.log(fit.z), [np.log(fit.noise)]])
    bounds = [(-1e4, 1e4)] * len(rows) + [(np.log(1e-4), np.log(50.0))] * 2 + [(np.log(1e-16), np.log(10.0))]
    minimum = minimize(objective, x0, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": iterations})
    fit.chol, fit.z, fit.noise = unpack(minimum.x)
    fit.nll = float(minimum.fun)
    lam, U, w = fit.parts()
    fit.f = _gauss_newton(t, y @ U, orders, fit.f, fit.noise / np.outer(w, lam), steps=2)
    return fit


def _gauss_newton(
    t: np.ndarray, y: np.ndarray, orders: np.ndarray, f: np.ndarray, ridge: np.ndarray, steps: int = 4
) -> np.ndarray:
    """Frequencies that minimise the penalised residual; a step that does not help is not taken."""
    limit = 0.2 / (t[-1] - t[0])
    best, best_f = np.inf, f
    for _ in range(steps):
        residual, move, _ = frequency_step(t, y, orders, f, ridge)
        if residual >= best:
            break
        best, best_f = residual, f
        f = f + np.clip(move, -limit, limit)
    return best_f


def _nll(
    gram: np.ndarray,
    b: np.ndarray,
    total: np.ndarray,
    n: int,
    orders: np.ndarray,
    chol: np.ndarray,
    z: np.ndarray,
    noise: float,
) -> tuple[float, np.ndarray, np.ndarray, float]:
    """Negative log marginal likelihood and its gradients by chol(B), log z and log noise.

    With W = lambda_i S on eigen-output i, M = noise I + W^1/2 G W^1/2 and m = M^-1 W^1/2 Phi^T y:
    log|K| = (n - r) log noise + log|M|; y^T K^-1 y = (y^T y - b^T W^1/2 m) / noise;
    w_j phi_j^T K^-1 phi_j = 1 - noise M^-1_jj; w_j (phi_j^T K^-1 y)^2 = m_j^2.
    """
    from scipy.linalg import lapack

    d, r = len(chol), len(gram)
    B = chol @ chol.T
    lam, U = np.linalg.eigh(B)
    lam = np.maximum(lam, 1e-12 * max(lam[-1], 1e-12))
    weight, slope = line_weights(orders, z)
    root = np.sqrt(per_column(np.maximum(weight, WEIGHT_FLOOR)))
    scaled = root[:, None] * gram * root
    bu = root[:, None] * (b @ U)
    tu = np.einsum("di,de,ei->i", U, total, U)
    value, by_noise, by_log_w = 0.0, 0.0, np.zeros(r)
    trace, solved = np.zeros(d), np.zeros((d, r))
    for i in range(d):
        M = lam[i] * scaled
        M.flat[:: r + 1] += noise
        c, info = lapack.dpotrf(M, lower=1, clean=1, overwrite_a=1)
        if info != 0:
            return 1e300, np.zeros_like(chol), np.zeros(2), 0.0
        logdet = 2.0 * np.sum(np.log(np.diag(c)))
        rhs = np.sqrt(lam[i]) * bu[:, i]
        m = lapack.dpotrs(c, rhs, lower=1)[0]
        inverse_diag = np.diag(lapack.dpotri(c, lower=1)[0])
        quad = (tu[i] - rhs @ m) / noise
        value += 0.5 * ((n - r) * np.log(noise) + logdet + quad + n * np.log(2.0 * np.pi))
        gain = 1.0 - noise * inverse_diag
        by_log_w += 0.5 * (gain - m**2)
        # noise * alpha^T alpha = (|y|^2 - 2 m.rhs + m.(M - noise I) m) / noise, and (M - noise I) m = rhs - noise m
        misfit = (tu[i] - rhs @ m - noise * (m @ m)) / noise
        by_noise += 0.5 * ((n - r) + noise * np.sum(inverse_diag) - misfit)
        trace[i], solved[i] = np.sum(gain) / lam[i], m / np.sqrt(lam[i])
    C = 0.5 * (np.diag(trace) - solved @ solved.T)
    by_chol = 2.0 * (U @ C @ U.T) @ chol
    by_z = np.einsum("j,jk->k", by_log_w, per_column(slope)) * z
    return value, by_chol, by_z, by_noise
