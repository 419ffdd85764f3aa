"""kabir2025: what a step of the filter and the training of a process cost."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from massprops.campaigns.papers import _kabir2025_model as model
from massprops.campaigns.papers._kabir2025_setup import configuration
from massprops.estimators.filters import Measurements, Settings, State, filter_epochs
from massprops.estimators.filters.state import Noise

SAMPLES = 1000
AHEAD = 2000
STEPS, PASSES = 500, 30
"""Short passes, of which the least disturbed counts."""


def speed() -> dict[str, Any]:
    """CPU costs, measured now.

    Returns:
        ukf_us_per_step: the paper's model with its four quaternion components: 24 states, 45 measurements, fourth-order
        Runge-Kutta, after loading, the best of thirty passes over 500 steps; gp_gpy_ratio: GPy's CPU time over ours to train on the same 1000 samples with the same kernel, None
        without GPy (then `gpy` says so); gp_cpu_s, gpy_cpu_s; gp_rmse, gpy_rmse: errors over the next 2000 s [rad].
    """
    return {**_filter_speed(), **_process_speed()}


def _filter_speed() -> dict[str, Any]:
    c = configuration("occlusion-0.075")
    q, w = model.truth(tuple(c["moments"]), tuple(c["w0"]), STEPS)
    z = model.measured(c, q, w, 0)
    start, first = model.begin(c, z)
    state = State(start.w, start.q, start.k, start.features, with_fourth_component(start), position=start.position)
    seen = Measurements(
        np.concatenate([[0.0], np.ones(STEPS - first - 1)]),
        z[first:].reshape(STEPS - first, -1),
        np.tile(model.sigmas(c) ** 2, (STEPS - first, len(c["features_m"]))),
        model.cameras(c),
        disparity=True,
        flow=True,
    )
    Q = c["process_noise"]
    noise = Noise(w=Q["w"], attitude=Q["q"], k=Q["k"], features=Q["features"])

    settings = Settings(gate=0.0, additive=True, largest_turn=c["largest_turn_rad"])
    filter_epochs(state, seen, noise, settings)  # loads and compiles
    passes = [filter_epochs(state, seen, noise, settings) for _ in range(PASSES)]
    best = min(1e6 * run.cpu_s / len(run.w) for run in passes)
    return {"states": len(state.P), "measurements": seen.z.shape[1], "ukf_us_per_step": best}


def with_fourth_component(state: State) -> np.ndarray:
    """Covariance with the attitude as four quaternion components in place of a turn: dq = q (0, a) / 2."""
    w, x, y, z = state.q
    half = 0.5 * np.array([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]])
    n = len(state.P)
    J = np.zeros((n + 1, n))
    J[:3, :3], J[3:7, 3:6], J[7:, 6:] = np.eye(3), half, np.eye(n - 6)
    P: np.ndarray = J @ state.P @ J.T
    # the direction of q itself, which a unit quaternion does not have, gets a width of its own
    P[3:7, 3:7] += 1e-8 * np.outer(state.q, state.q)
    return P


def _process_speed() -> dict[str, Any]:
    from massprops.estimators.gp import fit_process

    c = configuration("gp-0.075")
    q, w = model.truth(tuple(c["moments"]), tuple(c["w0"]), SAMPLES + AHEAD)
    clean = model.images(c, q, w)[:, 0, :3]
    y = model.measured(c, q, w, 0)[:, 0, :3]
    t = np.arange(len(y), dtype=float)
    fit_process(t[:200], y[:200])  # loads what it needs
    begun = time.process_time()
    process = fit_process(t[:SAMPLES], y[:SAMPLES])
    ours = time.process_time() - begun

    def error(value: np.ndarray) -> float:
        return float(np.sqrt(np.mean((value - clean[SAMPLES:]) ** 2)))

    out: dict[str, Any] = {"gp_samples": SAMPLES, "gp_cpu_s": ours, "gp_rmse": error(process.predict(t[SAMPLES:])[0])}
    try:
        import GPy
    except ImportError:
        return {**out, "gp_gpy_ratio": None, "gpy": "not installed: pip install 'massprops[bench]'"}
    theirs, value = _gpy(GPy, t, y, 1.0 / process.f)
    return {**out, "gpy_cpu_s": theirs, "gpy_rmse": error(value), "gp_gpy_ratio": theirs / ours}


def _gpy(GPy: Any, t: np.ndarray, y: np.ndarray, periods: np.ndarray) -> tuple[float, np.ndarray]:
    """CPU time of GPy's training as the paper does it, one start from good periods, and its prediction.

    GPy is handed the periods that ours found, which spares it the search: the comparison leans its way.
    """
    mean, spread = y[:SAMPLES].mean(axis=0), y[:SAMPLES].std(axis=0)
    scaled = (y - mean) / spread
    base = GPy.kern.StdPeriodic(1, period=periods[0], lengthscale=1.0) * GPy.kern.StdPeriodic(
        1, period=periods[1], lengthscale=1.0
    )
    kernel = base ** GPy.kern.Coregionalize(1, output_dim=3, rank=3)
    X = np.vstack([np.column_stack([t[:SAMPLES], np.full(SAMPLES, i)]) for i in range(3)])
    model_ = GPy.models.GPRegression(X, np.concatenate([scaled[:SAMPLES, i] for i in range(3)])[:, None], kernel)
    model_.likelihood.variance = 1e-6
    begun = time.process_time()
    model_.optimize("lbfgsb", max_iters=100)
    spent = time.process_time() - begun
    ahead = t[SAMPLES:]
    told = [model_.predict(np.column_stack([ahead, np.full(len(ahead), i)]))[0][:, 0] for i in range(3)]
    return spent, np.column_stack(told) * spread + mean
