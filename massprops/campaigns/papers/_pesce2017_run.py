"""pesce2017's simulation: the motion and the images, the filter over all runs at once, and the errors of its tables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from massprops.campaigns.papers._pesce2017_curvature import bends, constraint_curvature, image_curvature
from massprops.campaigns.papers._pesce2017_differentiator import rates_from_flow, slope
from massprops.campaigns.papers._pesce2017_inertia import from_ratios, principal_prior, ratios_jacobian, ratios_of
from massprops.campaigns.papers._pesce2017_observation import euler_constraint, for_layout, images
from massprops.campaigns.papers._pesce2017_state import (
    COLUMNS,
    Layout,
    State,
    covariance_of,
    cross,
    difference,
    state_of,
)
from massprops.campaigns.papers._pesce2017_together import update_again, update_together
from massprops.campaigns.papers._pesce2017_transition import (
    ProcessNoise,
    predict,
    transition,
)
from massprops.campaigns.papers._pesce2017_update import Observe, Rule, Updated, update
from massprops.campaigns.papers._seeds import stereo_pair
from massprops.core.linalg import normalised_square
from massprops.dynamics.kernels import differential_gravity
from massprops.dynamics.orbit import lvlh_axes, lvlh_rate, position_velocity
from massprops.dynamics.quaternion import angle_between, conjugate, from_rotation_matrix, multiply, normalise, rotate
from massprops.dynamics.rigid_body import angular_acceleration, propagate
from massprops.sensing.stereo import triangulate
from massprops.sequence.data import Orbit

# the paper's camera axes: x right, y the depth, z up
CAMERA_ROWS = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])


class Setup:
    """The set-up that all runs share: times, truth of the motion, cameras."""

    def __init__(self, c: dict[str, Any]) -> None:
        self.c = c
        self.times = np.arange(c["steps"] + 1) * c["step_s"]
        o = c["orbit"]
        self.orbit = Orbit(
            o["mu_m3_s2"],
            o["semi_major_axis_m"],
            o["eccentricity"],
            o["true_anomaly_rad"],
            _perifocal_in_lvlh(o["true_anomaly_rad"]),
        )
        self.cameras = stereo_pair(1.0, c["baseline_m"], CAMERA_ROWS)
        self.frames = [_camera_frame(self.orbit, t) for t in self.times]
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
        self.layout = Layout(c["features"], c["additive"])

    def _path(self, r0: np.ndarray, v0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The target's own Kepler motion, to tight tolerance, less the leader's."""
        from scipy.integrate import solve_ivp

        orbit = self.orbit

        def slope(t: float, y: np.ndarray) -> np.ndarray:
            leader, _ = position_velocity(orbit, np.asarray(t))
            return np.concatenate([y[3:], differential_gravity(orbit.mu_m3_s2, *leader, *y[:3])])

        out = solve_ivp(
            slope, (0, self.times[-1]), np.concatenate([r0, v0]), "DOP853", self.times, rtol=1e-12, atol=1e-12
        )
        return out.y[:3].T, out.y[3:].T

    def sensed(self, step: int, draw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The paper's simulated sensor: the true acceleration, inertial axes, plus noise (B, 3); and its sigma."""
        sigma = self.c["sensor_sigma_rad_s2"]
        exact = rotate(self.q[step], angular_acceleration(self.w[step], np.diag(self.c["moments"])))
        return exact + sigma * draw, np.full(draw.shape, sigma)

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


@dataclass(frozen=True)
class Passage:
    """Filters over all steps: features (B, m, 3) of the bodies, states and covariances after each step, iterations (B,)."""

    setup: Setup
    features: np.ndarray
    states: list[State]
    covariances: list[np.ndarray]
    iterations: np.ndarray


def _camera_frame(orbit: Orbit, t: float) -> tuple[np.ndarray, np.ndarray]:
    """C (3, 3), cam0 axes at t into inertial axes (cam0's at the first epoch), and their rate (3,) [rad/s]."""
    now, first = lvlh_axes(orbit, np.array([t, 0.0]))
    return now @ first.T, lvlh_rate(orbit, np.asarray(t))[0]


def _perifocal_in_lvlh(anomaly: float) -> np.ndarray:
    """Perifocal axes in the leader's axes at the start, which are the inertial axes here."""
    c, s = np.cos(anomaly), np.sin(anomaly)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def draw(c: dict[str, Any], seeds: list[int]) -> tuple[np.ndarray, ...]:
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


def first_estimate(c: dict[str, Any], setup: Setup, features: np.ndarray, draw: np.ndarray) -> tuple[State, np.ndarray]:
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


def image_noise(c: dict[str, Any]) -> np.ndarray:
    """(rows,) 1-sigma of one step's image positions and velocities and disparities."""
    scale = np.repeat([c["image_sigma"], c["flow_sigma_per_s"]], 2)
    return np.concatenate([np.tile(scale, 2 * c["features"]), np.full(c["features"], c["disparity_sigma"])])


@dataclass(frozen=True)
class _Seen:
    """One step's measurements as the update takes them.

    Attributes:
        C, spin: of the cameras' axes; z (B, rows): measured.
        acceleration: (B, 3) of Euler's equations as a measurement; None without.
        wide: (B, rows) 1-sigma, of the constraint's rows too.
    """

    setup: Setup
    C: np.ndarray
    spin: np.ndarray
    z: np.ndarray
    acceleration: np.ndarray | None
    wide: np.ndarray
    flow_sigma: float

    def observe(self, s: State, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals and their Jacobian of the runs `which`."""
        layout = self.setup.layout
        value, H = images(layout, s, self.setup.cameras, self.C, self.spin)
        residual = self.z[which] - value
        if self.acceleration is not None:
            more, jacobian = euler_constraint(layout, s, self.acceleration[which])
            residual, H = np.concatenate([residual, more], axis=1), np.concatenate([H, jacobian], axis=1)
        return residual, for_layout(layout, s, H)

    def curvature(self, s: State, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and spread that the images' second order adds."""
        layout, cameras = self.setup.layout, self.setup.cameras
        mean, spread = image_curvature(layout, s, P, cameras, self.C, self.spin)
        more = ((0, 0), (0, self.wide.shape[1] - mean.shape[1]))
        return np.pad(mean, more), np.pad(spread, more)

    def spread(self, s: State, P: np.ndarray) -> np.ndarray:
        """The spread alone."""
        return self.curvature(s, P)[1]

    def suspect(self, s: State, P: np.ndarray) -> np.ndarray:
        """Runs whose images bend by more than their noise."""
        return bends(self.setup.layout, s, P, self.flow_sigma)

    def corrected(self, state: State, P: np.ndarray, second_order: str) -> Updated:
        """The update, with the images' second order from the `prior`, from the `posterior`, or without."""
        layout, rule = self.setup.layout, self.setup.rule
        if second_order == "prior":
            return update(layout, state, P, self.observe, self.wide, rule, self.curvature(state, P))
        if second_order == "posterior":
            return update_again(layout, state, P, self.observe, self.wide, rule, self.spread, self.suspect)
        return update(layout, state, P, self.observe, self.wide, rule)


def simulate(c: dict[str, Any], seeds: list[int]) -> Passage:
    """The filter over all steps, all runs at once."""
    setup = Setup(c)
    layout = setup.layout
    features, start, noise, sensor = draw(c, seeds)
    state, P = first_estimate(c, setup, features, start)
    sigma = image_noise(c)
    process = ProcessNoise(**c["process_noise"])
    rates = _Rates(c, setup)
    states, covariances, used = [], [], np.zeros(len(seeds))
    exact = [
        images(layout, setup.truth(i, features), setup.cameras, *setup.frames[i])[0] for i in range(1, c["steps"] + 1)
    ]
    measured = [value + sigma * noise[:, i] for i, value in enumerate(exact)]
    windows = c["batch_steps"]
    if windows:
        together = _together(setup, state, P, measured[: windows[-1]], sigma, windows)
        state, P, used = together.state, together.P, used + together.iterations
    for step in range(1, c["steps"] + 1):
        C, spin = setup.frames[step]
        z = measured[step - 1]
        acceleration, sigma_a = (
            setup.sensed(step, sensor[:, step - 1]) if c["pseudo"] == "sensor" else rates.take(step, z)
        )

        state, P = predict(
            layout, state, P, setup.times[step - 1], setup.times[step], setup.orbit, process, setup.largest_rate
        )
        # images of the first steps may be in the state already
        known = bool(windows) and step <= windows[-1]
        wide = np.broadcast_to(np.inf if known else sigma, z.shape)
        if acceleration is not None:
            wide = np.concatenate([wide, np.sqrt(sigma_a**2 + constraint_curvature(layout, state, P))], axis=1)

        seen = _Seen(setup, C, spin, z, acceleration, wide, c["flow_sigma_per_s"])
        done = seen.corrected(state, P, c["second_order"])
        state, P = done.state, done.P
        used += done.iterations
        states.append(state)
        covariances.append(P)
    return Passage(setup, features, states, covariances, used)


def _together(
    setup: Setup, state: State, P: np.ndarray, measured: list[np.ndarray], sigma: np.ndarray, windows: list[int]
) -> Updated:
    """State and covariance at the start, from all images of the first steps."""
    layout = setup.layout

    def ahead(i: int, s: State) -> tuple[State, np.ndarray]:
        return transition(layout, s, setup.times[i], setup.times[i + 1], setup.orbit, setup.largest_rate)

    def observed(i: int) -> Observe:
        def observe(s: State, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            value, H = images(layout, s, setup.cameras, *setup.frames[i + 1])
            return measured[i][which] - value, for_layout(layout, s, H)

        return observe

    wide = np.broadcast_to(sigma, measured[0].shape)
    return update_together(layout, state, P, ahead, [observed(i) for i in range(len(measured))], wide, windows)


class _Rates:
    """The differentiator of measured rates, with what it remembers of its window."""

    def __init__(self, c: dict[str, Any], setup: Setup) -> None:
        self.c, self.setup = c, setup
        self.window: list[tuple[float, np.ndarray, np.ndarray]] = []

    def take(self, step: int, z: np.ndarray) -> tuple[Any, Any]:
        """Acceleration and sigma (B, 3) at the end of a window, else None, from one epoch's measurements (B, rows)."""
        if self.c["pseudo"] != "differentiator":
            return None, None
        m = self.c["features"]
        C, spin = self.setup.frames[step]
        seen = z[:, : 8 * m].reshape(len(z), 2, m, 4)
        noise = np.full(2, self.c["image_sigma"])
        points, _ = triangulate(self.setup.cameras, np.moveaxis(seen[..., :2], 1, 2), noise, np.inf)
        from_flow = rates_from_flow(
            points @ C.T, seen[..., 2:], self.c["flow_sigma_per_s"], self.setup.cameras, C, spin
        )
        self.window.append((float(self.setup.times[step]), *from_flow))
        if len(self.window) < self.c["window_steps"]:
            return None, None
        times, rates, covariance = (np.array(part) for part in zip(*self.window, strict=True))
        self.window = []
        return slope(times, rates, covariance)


def relative_rate(state: State, camera_axes: np.ndarray, camera_rate: np.ndarray) -> np.ndarray:
    """The paper's omega (B, 3): target's less leader's angular velocity, in the leader's axes (eq 1) [rad/s]."""
    return _in_axes(state.W - camera_rate, camera_axes)


def relative_attitude(state: State, camera_quaternion: np.ndarray) -> np.ndarray:
    """(B, 4) body to the chaser's axes."""
    return multiply(conjugate(camera_quaternion)[None], state.q)


def relative_velocity(state: State, camera_axes: np.ndarray, camera_rate: np.ndarray) -> np.ndarray:
    """The paper's rho_dot (B, 3): velocity of the centre of mass as seen in the leader's turning axes [m/s]."""
    return _in_axes(state.velocity - cross(camera_rate, state.r), camera_axes)


def _in_axes(x: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Vectors (B, 3) in the axes (3, 3) columns; one product for each run, since BLAS takes another kernel for another
    number of rows."""
    return np.asarray((axes.T @ x[..., None])[..., 0])


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


def rows_of(passage: Passage, seeds: list[int]) -> list[dict[str, Any]]:
    """One flat row per run: mean errors, last errors, sigmas, and squared errors in units of the covariance (NEES)."""
    setup, states, covariances = passage.setup, passage.states, passage.covariances
    c = setup.c
    layout = setup.layout
    every, nees, nees_k = [], [], []
    for step, (state, P) in enumerate(zip(states, covariances, strict=True), start=1):
        truth = setup.truth(step, passage.features)
        every.append(errors(setup, step, state, truth))
        e = difference(layout, truth, state)
        nees.append(normalised_square(e, P))
        nees_k.append(normalised_square(e[:, layout.k], P[:, layout.k, layout.k]))
    # time last: a sum along the first axis is taken in another order for one run than for several
    history, times = np.ascontiguousarray(np.stack(every, axis=-1)), setup.times[1:]
    mean = history[..., times >= c["average_from_s"]].mean(axis=-1)
    steady = history[..., times >= c["steady_from_s"]].mean(axis=-1)
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
        row["iterations"] = float(passage.iterations[b] / len(states))
        if not np.isfinite(history[b]).all():
            row["error"] = "non-finite"
        rows.append(row)
    return rows
