"""kabir2025: the tumbling target, what the stereo pair measures of it, and the three filters held side by side."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from massprops.core.linalg import normalised_square
from massprops.dynamics.inertia import ratios_of_moments
from massprops.dynamics.kernels import euler_acceleration, quaternion_rate
from massprops.dynamics.quaternion import angle_between, multiply, normalise, rotate
from massprops.estimators.filters import Measurements, Noise, Run, Settings, State, filter_epochs
from massprops.estimators.filters.foresight import Foresight, foresee_features
from massprops.estimators.result import Prior
from massprops.model.problem import Problem
from massprops.sensing.pinhole import Pinhole


@lru_cache(maxsize=8)
def truth(moments: tuple[float, ...], w0: tuple[float, ...], n: int) -> tuple[np.ndarray, np.ndarray]:
    """Attitude (n, 4) and body rates (n, 3) at whole seconds, by an integrator that no filter uses."""
    from scipy.integrate import solve_ivp

    def slope(_: float, y: np.ndarray) -> list[Any]:
        a, b, c = moments
        turn = euler_acceleration((a, b, c, 0.0, 0.0, 0.0), tuple(y[4:7]), (0.0, 0.0, 0.0))
        return [*quaternion_rate(*y), *turn]

    y0 = np.concatenate([[1.0, 0.0, 0.0, 0.0], w0])
    out = solve_ivp(slope, (0.0, n - 1.0), y0, "DOP853", np.arange(n, dtype=float), rtol=1e-12, atol=1e-14).y.T
    return normalise(out[:, :4]), out[:, 4:]


def cameras(configuration: dict[str, Any]) -> tuple[Pinhole, Pinhole]:
    """Right and left camera: depth along y of the chaser's axes, v along z, focal length f [rad]; u_L = f (x + b)/y."""
    f, b = configuration["focal_length"], configuration["baseline_m"]
    R = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    eye = np.array([f, -f, 0.0, 0.0])
    return Pinhole(eye, R, np.zeros(3)), Pinhole(eye, R, np.array([-b, 0.0, 0.0]))


def images(configuration: dict[str, Any], q: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Noise-free measurements (n, m, 9) of the features, each u_R, v_R, u_L, v_L, disparity, and the rates of the first four
    (paper, section 2.2.2)."""
    p = np.array(configuration["features_m"], float)
    f, b = configuration["focal_length"], configuration["baseline_m"]
    X = np.array(configuration["position_m"]) + rotate(q[:, None], p[None])
    V = rotate(q[:, None], np.cross(w[:, None], p[None]))
    x, y, z = (X[..., i] for i in range(3))
    vx, vy, vz = (V[..., i] for i in range(3))
    right, left, up = f * x / y, f * (x + b) / y, f * z / y
    flow = [f * vx / y - right * vy / y, f * vz / y - up * vy / y, f * vx / y - left * vy / y]
    return np.stack([right, up, left, up, left - right, flow[0], flow[1], flow[2], flow[1]], axis=-1)


def measured(configuration: dict[str, Any], q: np.ndarray, w: np.ndarray, seed: int) -> np.ndarray:
    """Measurements (n, m, 9) with white noise in every channel, as the paper draws them."""
    clean = images(configuration, q, w)
    return clean + sigmas(configuration) * np.random.default_rng(seed).normal(size=clean.shape)


def sigmas(configuration: dict[str, Any]) -> np.ndarray:
    """(9,) 1-sigma of a feature's channels."""
    projection, disparity = configuration["sigma_projection"], configuration["sigma_disparity"]
    return np.array([projection] * 4 + [disparity] + [configuration["sigma_flow"]] * 4)


def prediction_limit(configuration: dict[str, Any], span: int, ahead: int) -> float:
    """Cramer-Rao limit of the images' rms error over `ahead` seconds after `span` [rad], for one feature.

    It holds for whoever knows Euler's equations and the position, and fits attitude, rates, ratios and feature; a
    process that knows none of that cannot be expected below it.
    """
    from massprops.dynamics.quaternion import from_rotation_vector
    from massprops.estimators.free_fit import free_paths

    t = np.arange(span + ahead, dtype=float)
    moments, w0 = np.array(configuration["moments"]), np.array(configuration["w0"])

    def seen(x: np.ndarray) -> np.ndarray:
        inertia = np.diag(moments * np.exp([x[6], 0.0, x[7]]))
        path = free_paths(t, [(from_rotation_vector(x[:3]), w0 + x[3:6], inertia)])[0]
        moved = {**configuration, "features_m": [list(np.array(configuration["features_m"][0]) + x[8:])]}
        return images(moved, path[:, :4], path[:, 4:])[:, 0, :3].ravel()

    h = np.array([1e-6] * 3 + [1e-7] * 3 + [1e-6] * 5)
    J = np.stack([(seen(d) - seen(-d)) / (2.0 * step) for d, step in zip(np.diag(h), h, strict=True)], axis=-1)
    past, future = J[: 3 * span], J[3 * span :]
    scale = np.linalg.norm(past, axis=0)
    covariance = np.linalg.inv((past / scale).T @ (past / scale)) * configuration["sigma_projection"] ** 2
    future = future / scale
    return float(np.sqrt(np.mean(np.einsum("ij,jk,ik->i", future, covariance, future))))


def as_problem(configuration: dict[str, Any], z: np.ndarray) -> Problem:
    """The image positions alone, as any sequence gives them."""
    n, m = z.shape[:2]
    uv = np.moveaxis(z[:, :, :4].reshape(n, m, 2, 2), 2, 1)
    return Problem.of_tracks(np.arange(n, dtype=float), cameras(configuration), uv, configuration["sigma_projection"])


def begin(configuration: dict[str, Any], z: np.ndarray) -> tuple[State, int]:
    """State from least squares and momentum on the first seconds, and its epoch; the position is known (section 2.1).

    Raises:
        NotPossible: the first seconds show no rotation.
    """
    from massprops.estimators.filters.principal_axes import in_principal_axes
    from massprops.estimators.filters.setup import setup
    from massprops.estimators.start import first_guess

    until = float(configuration["start_s"])
    problem = as_problem(configuration, z[: int(until) + 1])
    start = first_guess(problem, until_s=until)
    ready = in_principal_axes(setup(problem, Prior(), start, most=len(configuration["features_m"])))
    full = ready.state
    at, rows = np.arange(8, 14), np.r_[0:8, 14 : len(full.P)]
    # what a known position and velocity tell of the rest
    gain = full.P[np.ix_(rows, at)] @ np.linalg.inv(full.P[np.ix_(at, at)])
    P = full.P[np.ix_(rows, rows)] - gain @ full.P[np.ix_(at, rows)]
    position = np.array(configuration["position_m"], float)
    shift = gain @ np.concatenate([position - full.position, -full.velocity])
    features = full.features + shift[8:].reshape(-1, 3)
    state = State(full.w, full.q, full.k, features, 0.5 * (P + P.T), position=position)
    return state, ready.first


def process_noise(configuration: dict[str, Any]) -> Noise:
    """The paper's, per step of one second; its quaternion's variance is a quarter of the turn's."""
    Q = configuration["process_noise"]
    return Noise(w=Q["w"], attitude=4.0 * Q["q"], k=Q["k"], features=Q["features"])


def filtered(
    configuration: dict[str, Any], state: State, z: np.ndarray, variance: np.ndarray, settings: Settings | None = None
) -> Run:
    """The filter over all epochs of z (n, m, 9), one second apart."""
    n = len(z)
    seen = Measurements(
        np.concatenate([[0.0], np.ones(n - 1)]),
        z.reshape(n, -1),
        np.ascontiguousarray(np.broadcast_to(variance, z.shape)).reshape(n, -1),
        cameras(configuration),
        disparity=True,
        flow=True,
    )
    c = configuration
    settings = settings or Settings(c["alpha"], c["beta"], c["kappa"], gate=0.0, largest_turn=c["largest_turn_rad"])
    return filter_epochs(state, seen, process_noise(configuration), settings)


def pseudo_measurements(
    configuration: dict[str, Any], z: np.ndarray, dark: int
) -> tuple[np.ndarray, np.ndarray, list[Foresight | None]]:
    """z with the epochs from `dark` on replaced by what one process per feature foresees, and the variances.

    The process of a feature learns u_R, v_R and u_L (paper, Table 1). What follows from those, v_L and the disparity,
    is not counted a second time; rates come from the process itself, not from differences.
    """
    n, m = z.shape[:2]
    t = np.arange(n, dtype=float)
    told = foresee_features(t[:dark], [z[:dark, i, :3] for i in range(m)], t[dark:])
    filled = z.copy()
    filled[dark:] = np.nan
    variance = np.broadcast_to(sigmas(configuration) ** 2, z.shape).copy()
    for i, one in enumerate(told):
        if one is not None:
            filled[dark:, i, [0, 1, 2]], filled[dark:, i, [5, 6, 7]] = one.value, one.rate
            variance[dark:, i, [0, 1, 2]] = one.variance[:, :3]
            variance[dark:, i, [5, 6, 7]] = one.variance[:, 3:]
    return filled, variance, told


TURNS = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]])
"""Half turns about the principal axes: the frames that the principal axes leave open."""


def errors(configuration: dict[str, Any], run: Run, q: np.ndarray, w: np.ndarray, anchor: int) -> dict[str, np.ndarray]:
    """Errors at each epoch, in the principal frame that is nearest at epoch `anchor`.

    Returns:
        w (n,) length [rad/s], attitude (n,) [rad], k1, k2 (n,) absolute, nees (n,) of rates, attitude and ratios.
    """
    turn = TURNS[np.argmin([angle_between(multiply(run.q[anchor], s), q[anchor]) for s in TURNS])]
    back = rotate(turn * np.array([1.0, -1, -1, -1]), np.eye(3)).T  # estimated principal axes to true ones
    moments = np.array(configuration["moments"])
    k = ratios_of_moments(moments)
    estimated = multiply(run.q, turn)
    from massprops.dynamics.quaternion import conjugate, rotation_vector

    dw = w - run.w @ back.T
    da = rotation_vector(multiply(conjugate(estimated), q))
    dk = k - run.k
    error = np.concatenate([dw @ back, da @ back, dk], axis=1)  # in the filter's own axes, as its covariance
    nees = np.full(len(w), np.nan)
    good = np.isfinite(run.block).all(axis=(1, 2)) & np.isfinite(error).all(axis=1)
    nees[good] = normalised_square(error[good], run.block[good])
    return {
        "w": np.linalg.norm(dw, axis=1),
        "attitude": np.linalg.norm(da, axis=1),
        "k1": np.abs(dk[:, 0]),
        "k2": np.abs(dk[:, 1]),
        "nees": nees,
    }
