"""Pesce, Lavagna and Bevilacqua (2017): stereo EKF and iterated EKF with inertia ratios, Tables 1 to 4.

What the paper leaves open is set here and said: the leader is at perigee at the start, the target's inertia is the one
it prints for the leader, and errors are means over 10 to 100 s (the paper says both "after 10 s" and "around steady
state", so the last ten seconds stand beside them).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.dynamics.orbit import lvlh_rate, position_velocity
from massprops.dynamics.quaternion import angle_between, from_rotation_matrix, normalise, rotate
from massprops.dynamics.rigid_body import propagate
from massprops.estimators.curvature import image_curvature
from massprops.estimators.error_state import Layout, State, covariance_of, difference, state_of
from massprops.estimators.inertia_parameters import (
    from_ratios,
    inertia,
    principal_prior,
    ratios_jacobian,
    ratios_of,
)
from massprops.estimators.iterated import Rule, update
from massprops.estimators.observation import euler_constraint, for_layout, images
from massprops.estimators.surroundings import Surroundings
from massprops.estimators.transition import (
    ProcessNoise,
    predict,
    relative_attitude,
    relative_rate,
    relative_velocity,
)
from massprops.sensing.pinhole import Pinhole
from massprops.sequence.data import Orbit

PAPER = "pesce2017"
CASES = {
    "A": "slow tumble, Euler pseudo-measurement with a real differentiator of measured rates (Table 1)",
    "A-sensor": "slow tumble, pseudo-measurement as the paper simulates it: true acceleration plus noise (Table 1)",
    "B": "slow tumble without the pseudo-measurement (Table 3)",
    "C": "ten times faster tumble without the pseudo-measurement (Table 4)",
    "noise-1": "case A with image noise 1e-5 (Table 2)",
    "noise-5": "case A with image noise 5e-5 (Table 2)",
    "noise-10": "case A with image noise 1e-4 (Table 2)",
    "C-ekf": "case C with the plain EKF",
    "C-paper": "case C by the IEKF with the paper's additive quaternion and its 1 % stopping rule",
}
RUNS = dict.fromkeys(CASES, 100)
CHUNK = 50
COLUMNS = ("rho_m", "rho_dot_m_s", "omega_deg_s", "theta_deg", "k1", "k2")
PERCENTILES = (50, 70, 90, 100)
TABLES: dict[str, dict[str, list[float]]] = {
    "A": {
        "rho_m": [0.51, 0.64, 0.73, 0.90],
        "rho_dot_m_s": [0.0062, 0.0067, 0.0073, 0.011],
        "omega_deg_s": [0.0035, 0.0036, 0.0039, 0.0043],
        "theta_deg": [0.49, 0.61, 0.77, 0.87],
        "k1": [0.067, 0.13, 0.24, 0.53],
        "k2": [0.037, 0.051, 0.23, 0.23],
    },
    "B": {
        "rho_m": [0.51, 0.60, 0.77, 0.96],
        "rho_dot_m_s": [0.0081, 0.009, 0.011, 0.013],
        "omega_deg_s": [0.0058, 0.0059, 0.0063, 0.0069],
        "theta_deg": [0.59, 0.74, 0.88, 1.2],
        "k1": [0.33, 0.6, 1.4, 3.2],
        "k2": [0.35, 0.55, 1.6, 2.6],
    },
    "C": {
        "rho_m": [0.53, 0.64, 0.76, 0.94],
        "rho_dot_m_s": [0.01, 0.013, 0.017, 0.02],
        "omega_deg_s": [0.012, 0.013, 0.014, 0.016],
        "theta_deg": [1.8, 2.0, 2.2, 2.5],
        "k1": [0.035, 0.043, 0.069, 0.15],
        "k2": [0.021, 0.024, 0.032, 0.043],
    },
}
SINGLE_RUN: dict[str, list[float | None]] = {
    "noise-1": [0.26, 0.010, 0.0018, 0.59, 0.037, 0.009],
    "noise-5": [0.35, 0.02, None, 0.63, 0.04, 0.01],
    "noise-10": [0.49, 0.032, 0.0041, 0.67, 0.06, 0.01],
}

# the paper's camera axes: x right, y the depth, z up
CAMERA_ROWS = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])


def configuration(case: str) -> dict[str, Any]:
    """Everything that decides the result of `case`, as plain JSON."""
    letter = "C" if case.startswith("C") else "B" if case == "B" else "A"
    noise = {"noise-5": 5e-5, "noise-10": 1e-4}.get(case, 1e-5)
    return {
        "case": case,
        "orbit": {
            "mu_m3_s2": 3.986004418e14,
            "semi_major_axis_m": 7.17e6,
            "eccentricity": 0.05,
            "true_anomaly_rad": 0.0,
        },
        "baseline_m": 1.0,
        "features": 5,
        "feature_box_m": 1.5,
        "position_m": [10.0, 60.0, 10.0],
        "velocity_m_s": [0.01, -0.0225, -0.01],
        "rate_deg_s": [-1.0, -1.0, 0.934] if letter == "C" else [-0.1, -0.1, 0.034],
        "attitude": [0.0, 0.0, 0.0, 1.0],
        "moments": [0.83, 1.0, 1.083],
        "step_s": 1.0,
        "steps": 100,
        "image_sigma": noise,
        "flow_sigma_per_s": noise,
        "disparity_sigma": noise,
        "sigma_position_m": 1.0,
        "sigma_velocity_m_s": 1.0,
        "sigma_rate_deg_s": 1.0,
        "variance_quaternion": 1e-5,
        "sigma_features_m": 1.0,
        "variance_k": 1.0 if letter == "A" else 0.5,
        "process_noise": {"rotation": 1e-9, "translation": 1e-9, "inertia": 0.0},
        "pseudo": "sensor" if case == "A-sensor" else "differentiator" if letter == "A" else "none",
        "sensor_sigma_rad_s2": 1e-6,
        "additive": case == "C-paper",
        "iterations": 1 if case == "C-ekf" else 10,
        "second_order": case == "C-ekf",
        "paper_tolerance": 0.01 if case == "C-paper" else None,
        "average_from_s": 10.0,
        "steady_from_s": 90.0,
    }


def runs(configuration: dict[str, Any], seeds: list[int]) -> list[dict[str, Any]]:
    """One flat row per seed: mean errors over the paper's interval and over the last seconds, final errors and sigmas."""
    history = simulate(configuration, seeds)
    return _rows(configuration, seeds, *history)


class Setup:
    """The set-up that all runs share: times, truth of the motion, cameras."""

    def __init__(self, c: dict[str, Any]) -> None:
        self.c = c
        self.times = np.arange(c["steps"] + 1) * c["step_s"]
        o = c["orbit"]
        self.surroundings = Surroundings(
            Orbit(
                o["mu_m3_s2"],
                o["semi_major_axis_m"],
                o["eccentricity"],
                o["true_anomaly_rad"],
                _perifocal_in_lvlh(o["true_anomaly_rad"]),
            ),
            turning=True,
        )
        plain = np.array([1.0, 1.0, 0.0, 0.0])
        self.cameras = (
            Pinhole(plain, CAMERA_ROWS, np.zeros(3)),
            Pinhole(plain, CAMERA_ROWS, np.array([c["baseline_m"], 0.0, 0.0])),
        )
        self.frames = [self.surroundings.camera_frame(t) for t in self.times]
        self.frame_q = np.stack([from_rotation_matrix(C) for C, _ in self.frames])
        moments = np.array(c["moments"])
        self.k = np.log(moments[:2] / moments[1:])
        self.a = from_ratios(self.k)
        _, spin = self.frames[0]
        self.q0 = np.array(c["attitude"])
        W0 = np.radians(c["rate_deg_s"]) + spin
        w0 = rotate(self.q0 * [1, -1, -1, -1], W0)
        self.q, self.w = propagate(self.q0, w0, np.diag(moments), self.times)
        self.largest_rate = float(np.linalg.norm(W0)) + 3 * np.radians(c["sigma_rate_deg_s"])
        r0 = np.array(c["position_m"])
        self.r, self.v = self._path(r0, np.array(c["velocity_m_s"]) + np.cross(spin, r0))
        self.rule = Rule(c["iterations"], paper=c["paper_tolerance"])
        self.layout = Layout(c["features"], 2, c["additive"])

    def _path(self, r0: np.ndarray, v0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The target's own Kepler motion, to tight tolerance, less the leader's."""
        from scipy.integrate import solve_ivp

        from massprops.dynamics.kernels import differential_gravity

        orbit = self.surroundings.orbit
        assert orbit is not None

        def slope(t: float, y: np.ndarray) -> np.ndarray:
            leader, _ = position_velocity(orbit, np.asarray(t))
            return np.concatenate([y[3:], differential_gravity(orbit.mu_m3_s2, *leader, *y[:3])])

        out = solve_ivp(
            slope, (0, self.times[-1]), np.concatenate([r0, v0]), "DOP853", self.times, rtol=1e-12, atol=1e-12
        )
        return out.y[:3].T, out.y[3:].T

    def truth(self, step: int, features: np.ndarray) -> State:
        """The true state of runs with body features (B, m, 3)."""
        B = len(features)

        def each(x: np.ndarray) -> np.ndarray:
            return np.repeat(x[None], B, axis=0)

        return state_of(
            each(self.r[step]),
            each(self.v[step]),
            each(self.w[step]),
            each(self.q[step]),
            features,
            each(self.a),
        )


def _perifocal_in_lvlh(anomaly: float) -> np.ndarray:
    """Perifocal axes in the leader's axes at the start, which are the inertial axes here."""
    c, s = np.cos(anomaly), np.sin(anomaly)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def _draw(c: dict[str, Any], setup: Setup, seeds: list[int]) -> tuple[np.ndarray, ...]:
    """Features, first estimates and all measurement noise, run by run from its own seed."""
    m, steps = c["features"], c["steps"]
    parts = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        features = rng.uniform(-c["feature_box_m"], c["feature_box_m"], (m, 3))
        start = rng.standard_normal(15 + 3 * m)
        images_ = rng.standard_normal((steps, 9 * m))
        sensor = rng.standard_normal((steps, 3))
        parts.append((features, start, images_, sensor))
    return tuple(np.stack(p) for p in zip(*parts, strict=True))


def _first(c: dict[str, Any], setup: Setup, features: np.ndarray, draw: np.ndarray) -> tuple[State, np.ndarray]:
    """The paper's first estimate: the truth plus an error drawn from the first covariance, in the paper's variables."""
    B, m = features.shape[:2]
    C, spin = setup.frames[0]
    position = setup.r[0] + c["sigma_position_m"] * draw[:, 0:3]
    relative = setup.v[0] - np.cross(spin, setup.r[0]) + c["sigma_velocity_m_s"] * draw[:, 3:6]
    W = np.radians(c["rate_deg_s"]) + np.radians(c["sigma_rate_deg_s"]) * draw[:, 6:9] + spin
    q = normalise(setup.q0 + np.sqrt(c["variance_quaternion"]) * draw[:, 9:13])
    k = setup.k + np.sqrt(c["variance_k"]) * draw[:, 13:15]
    points = features + c["sigma_features_m"] * draw[:, 15:].reshape(B, m, 3)
    a, spread = principal_prior(k, np.sqrt(c["variance_k"]) * np.ones(2))
    state = state_of(position, relative + np.cross(spin, position), rotate(q * [1, -1, -1, -1], W), q, points, a)
    P = covariance_of(
        setup.layout,
        state,
        c["sigma_position_m"] ** 2 * np.eye(3),
        c["sigma_velocity_m_s"] ** 2 * np.eye(3),
        np.radians(c["sigma_rate_deg_s"]) ** 2 * np.eye(3),
        4 * c["variance_quaternion"] * np.eye(3),
        spread,
        np.broadcast_to(c["sigma_features_m"] ** 2 * np.eye(3), (m, 3, 3)),
    )
    return state, P


def simulate(
    c: dict[str, Any], seeds: list[int]
) -> tuple[Setup, np.ndarray, list[State], list[np.ndarray], np.ndarray]:
    """The filter over all steps.

    Returns:
        the set-up, body features (B, m, 3), states and covariances after each step (1 to `steps`), iterations (B,).
    """
    setup = Setup(c)
    layout, m = setup.layout, c["features"]
    features, start, noise, sensor = _draw(c, setup, seeds)
    state, P = _first(c, setup, features, start)
    scale = np.repeat([c["image_sigma"], c["flow_sigma_per_s"]], 2)
    sigma = np.concatenate([np.tile(scale, 2 * m), np.full(m, c["disparity_sigma"])])
    process = ProcessNoise(**c["process_noise"])
    states, covariances, used = [], [], np.zeros(len(seeds))
    for step in range(1, c["steps"] + 1):
        C, spin = setup.frames[step]
        truth = setup.truth(step, features)
        exact, _, _ = images(layout, truth, setup.cameras, C, spin, True, True)
        z = exact + sigma * noise[:, step - 1]

        def observe(s: State, which: np.ndarray, z=z, C=C, spin=spin) -> tuple[np.ndarray, np.ndarray]:
            value, H, _ = images(layout, s, setup.cameras, C, spin, True, True)
            return z[which] - value, for_layout(layout, s, H)

        state, P = predict(
            layout, state, P, setup.times[step - 1], setup.times[step], setup.surroundings, process, setup.largest_rate
        )
        bend = image_curvature(layout, state, P, setup.cameras, C, spin, True, True) if c["second_order"] else None
        done = update(layout, state, P, observe, np.broadcast_to(sigma, z.shape), setup.rule, bend)
        state, P = done.state, done.P
        used += done.iterations
        states.append(state)
        covariances.append(P)
    return setup, features, states, covariances, used


def errors(setup: Setup, step: int, state: State, truth: State) -> np.ndarray:
    """(B, 6) the paper's errors (eq 49-55), in the leader's axes: m, m/s, deg/s, deg, -, -."""
    C, spin = setup.frames[step]
    q = setup.frame_q[step]
    return np.stack(
        [
            np.linalg.norm(state.r - truth.r, axis=-1),
            np.linalg.norm(relative_velocity(state, C, spin) - relative_velocity(truth, C, spin), axis=-1),
            np.degrees(np.linalg.norm(relative_rate(state, C, spin) - relative_rate(truth, C, spin), axis=-1)),
            np.degrees(angle_between(relative_attitude(state, q), relative_attitude(truth, q))),
            *np.abs(ratios_of(state.k) - setup.k).T,
        ],
        axis=-1,
    )


def _rows(
    c: dict[str, Any],
    seeds: list[int],
    setup: Setup,
    features: np.ndarray,
    states: list[State],
    covariances: list[np.ndarray],
    used: np.ndarray,
) -> list[dict[str, Any]]:
    layout = setup.layout
    every, nees, nees_k = [], [], []
    for step, (state, P) in enumerate(zip(states, covariances, strict=True), start=1):
        truth = setup.truth(step, features)
        every.append(errors(setup, step, state, truth))
        e = difference(layout, truth, state)
        nees.append(_normalised(e, P))
        nees_k.append(_normalised(e[:, layout.k], P[:, layout.k, layout.k]))
    history, times = np.stack(every), setup.times[1:]
    mean = history[times >= c["average_from_s"]].mean(axis=0)
    steady = history[times >= c["steady_from_s"]].mean(axis=0)
    J = ratios_jacobian(states[-1].k)
    spread = J @ covariances[-1][:, layout.k, layout.k] @ np.swapaxes(J, -1, -2)
    final = ratios_of(states[-1].k) - setup.k
    rows = []
    for b, seed in enumerate(seeds):
        row: dict[str, Any] = {"seed": seed}
        row |= {name: float(mean[b, i]) for i, name in enumerate(COLUMNS)}
        row |= {f"steady_{name}": float(steady[b, i]) for i, name in enumerate(COLUMNS)}
        row |= {"final_k1": float(final[b, 0]), "final_k2": float(final[b, 1])}
        row |= {f"sigma_k{i + 1}": float(np.sqrt(spread[b, i, i])) for i in range(2)}
        row |= {f"nees_{t}s": float(nees[t - 1][b]) for t in (10, 50, 100) if t <= len(nees)}
        row |= {f"nees_k_{t}s": float(nees_k[t - 1][b]) for t in (10, 50, 100) if t <= len(nees)}
        row["iterations"] = float(used[b] / len(states))
        if not np.isfinite(history[:, b]).all():
            row["error"] = "non-finite"
        rows.append(row)
    return rows


def _normalised(e: np.ndarray, P: np.ndarray) -> np.ndarray:
    """e^T P^-1 e (B,), scaled first."""
    scale = np.sqrt(np.maximum(np.diagonal(P, axis1=-2, axis2=-1), 1e-200))
    e = e / scale
    return np.sum(e * np.linalg.solve(P / (scale[:, :, None] * scale[:, None, :]), e[..., None])[..., 0], axis=-1)


def _dump(rows: list[dict[str, Any]]) -> None:
    for name in rows[0]:
        v = np.array([r[name] for r in rows if isinstance(r.get(name), float)])
        if len(v):
            print(
                f"{name:22s} mean {v.mean():9.3g} rms {np.sqrt((v**2).mean()):9.3g}",
                *(f"{np.percentile(v, p):9.3g}" for p in PERCENTILES),
            )


if __name__ == "__main__":
    import sys, time

    t = time.process_time()
    out = runs(configuration(sys.argv[1]), list(range(int(sys.argv[2]))))
    print("cpu", time.process_time() - t)
    _dump(out)
