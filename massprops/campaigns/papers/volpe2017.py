"""volpe2017, tables 1-2: pose, velocity, shape and inertia ratios from one camera and ranges over one orbit.

The paper's formulas, noise levels, time step and initial values are lost from its text. Kept from the paper:

- a circular orbit of 7000 km, a closed and inclined relative orbit, one orbital period;
- 12 points that are always seen, by a camera that points at the target, in pixels rounded to whole numbers;
- body axes parallel to the camera at the start, so that the attitude there is known;
- an initial velocity of zero, and all points at the depth of the initial position.

One second lies between images, because in the paper the velocity converges in a few seconds. There is no process noise except a
millionth of the rate over the orbit: the period of the tumbling is known that well, and the error of an update is of that size.
Everything else in `configuration` is chosen here. The inertia is estimated up to its scale: the paper's sixth element is the
scale, which nothing shows, and which hides that the other five are observable.

Body axes are the camera's at the first epoch, exactly; how far images can carry that on limits the rate in body axes
(Cramer-Rao gain 1345 with 1 s between images, 602 with 5 s), not the one in inertial axes (3610, 1616).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.campaigns.consistency import consistency
from massprops.campaigns.papers._references import Reference
from massprops.campaigns.papers._seeds import MU, each_seed, on_circular_orbit, percentiles
from massprops.core.linalg import normalised_square
from massprops.dynamics import runge_kutta
from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.inertia import cholesky_inertia, cholesky_parameters, cholesky_ratio_derivatives, ratios
from massprops.dynamics.quaternion import (
    angle_between,
    from_rotation_matrix,
    from_rotation_vector,
    multiply,
    normalise,
    rotate,
    rotation_matrix,
)
from massprops.estimators.filters.gravity import slope_under_gravity
from massprops.estimators.ranging.batch_start import fit_first
from massprops.estimators.ranging.inertial import BASE, RangeData, RangeMotion, RangeStart, range_filtered, to_camera

PAPER = "volpe2017"
REFERENCE = Reference(
    "R. Volpe, M. Sabatini, G. B. Palmerini",
    "Pose and Shape Reconstruction of a Noncooperative Spacecraft Using Camera and Range Measurements",
    "International Journal of Aerospace Engineering, 4535316",
    2017,
    "10.1155/2017/4535316",
)
CASES = {
    "orbit": "tables 1-2: errors at the start and after one orbit; the first frames are fitted as a batch",
    "plain": "the same with the filter alone from the first frame on, as the paper has it",
}
RUNS = {"orbit": 100, "plain": 100}
CHUNK = 10
SEED = 2017
LONGEST_STEP_S = 1.25
"""Of the truth's integration: 0.03 rad of turning, 1e-9 rad of error."""


def configuration(case: str) -> dict[str, Any]:
    """The whole set-up as plain data."""
    x, y, z = 1.0, 0.8, 1.2
    box = [[a * x, b * y, c * z] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
    return {
        "case": case,
        "orbit_radius_m": 7.0e6,
        "step_s": 1.0,
        "relative_orbit_m": [30.0, 60.0, 40.0],
        "points_m": [*box, [0.2, 2.4, 0.3], [-0.2, 2.4, -0.3], [0.1, -2.4, 0.4], [0.0, 0.3, 1.9]],
        "inertia_kg_m2": [30.0, 45.0, 55.0],
        "w0_deg_s": [0.6, -0.9, 0.5],
        "focal_px": 1000.0,
        "sigma_px": 0.5,
        "sigma_range_m": 0.01,
        "start_sigma_position_m": 5.0,
        "start_sigma_rate_deg_s": 0.3,
        "start_sigma_inertia_kg_m2": 3.0,
        "start_sigma_depth_m": 1.5,
        "turn_noise_rad2_s3": 1e-19,
        "batch_windows": [4, 7, 12, 20, 35, 60, 100, 200, 300, 450, 700, 1000] if case == "orbit" else [],
    }


def runs(configuration: dict[str, Any], seeds: list[int]) -> list[dict[str, Any]]:
    """One row per seed."""
    truth = _truth(configuration)
    return each_seed(lambda seed: _run(configuration, truth, seed), seeds)


def _truth(c: dict[str, Any]) -> dict[str, np.ndarray]:
    """Motion over one orbit by small Runge-Kutta steps; inertial axes: chaser's radial, along-track, normal at first."""
    n_mean = np.sqrt(MU / c["orbit_radius_m"] ** 3)
    count = int(np.floor(2 * np.pi / n_mean / c["step_s"]))
    times = np.arange(count + 1) * c["step_s"]
    environment = EnvironmentModel(on_circular_orbit(c["orbit_radius_m"]))
    a, b, normal = c["relative_orbit_m"]
    # a closed relative orbit in the local frame: x = a cos, y = -2 a sin (b gives its amplitude), z = normal sin
    r = np.array([a, 0.0, normal * 0.6])
    local = np.array([0.0, -b * n_mean, normal * 0.8 * n_mean])
    v = local + np.cross([0.0, 0.0, n_mean], r)
    camera = _pointing(r)
    # body axes parallel to the camera's at the first epoch, and principal
    y = np.concatenate([camera, np.radians(c["w0_deg_s"]), r, v])
    ixx, iyy, izz = c["inertia_kg_m2"]
    six = (ixx, iyy, izz, 0.0, 0.0, 0.0)

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        out = np.empty(13)
        slope_under_gravity(y, six, np.array(environment.position(t)), MU, out)
        return out

    out, inner = [y], int(np.ceil(c["step_s"] / LONGEST_STEP_S))
    h = c["step_s"] / inner
    for t in times[:-1]:
        for i in range(inner):
            y = runge_kutta.step(slope, float(t + i * h), y, h)
            y[:4] = normalise(y[:4])
        out.append(y)
    path = np.array(out)
    # the camera follows the target with the least turn from one epoch to the next
    cameras = [camera]
    for r in path[1:, 7:10]:
        cameras.append(_pointing(r, cameras[-1]))
    return {
        "times": times,
        "q": path[:, :4],
        "w": path[:, 4:7],
        "r": path[:, 7:10],
        "v": path[:, 10:],
        "camera": np.array(cameras),
    }


def _pointing(r: np.ndarray, before: np.ndarray | None = None) -> np.ndarray:
    """Attitude (4,), camera to inertial, with the optical axis along r."""
    z = r / np.linalg.norm(r)
    if before is None:
        x = np.cross([0.0, 1.0, 0.0], z)
        x /= np.linalg.norm(x)
        return from_rotation_matrix(np.stack([x, np.cross(z, x), z], axis=-1))
    old = rotate(before, np.array([0.0, 0.0, 1.0]))
    axis = np.cross(old, z)
    sine = min(1.0, float(np.linalg.norm(axis)))
    turn = axis * (np.arcsin(sine) / max(sine, 1e-15))
    return normalise(multiply(from_rotation_vector(turn), before))


def _run(c: dict[str, Any], truth: dict[str, np.ndarray], seed: int) -> dict[str, Any]:
    rng = np.random.default_rng([SEED, seed])
    points = np.array(c["points_m"])
    C = rotation_matrix(truth["camera"])
    X = truth["r"][:, None] + np.einsum("nij,mj->nmi", rotation_matrix(truth["q"]), points)
    Y = np.einsum("nji,nmj->nmi", C, X)
    uv = c["focal_px"] * Y[..., :2] / Y[..., 2:]
    uv = np.round(uv + c["sigma_px"] * rng.standard_normal(uv.shape))
    sigma_px = float(np.sqrt(c["sigma_px"] ** 2 + 1.0 / 12.0))
    ranges = np.linalg.norm(truth["r"], axis=1) + c["sigma_range_m"] * rng.standard_normal(len(C))
    start = _start(c, truth, uv[0], rng)
    lens, orbit = np.array([c["focal_px"], c["focal_px"], 0.0, 0.0]), on_circular_orbit(c["orbit_radius_m"])
    data = RangeData(
        times=truth["times"],
        intrinsics=lens,
        uv=uv,
        sigma_px=sigma_px,
        ranges=ranges,
        sigma_range=c["sigma_range_m"],
        environment=orbit,
        camera=truth["camera"],
    )
    begin, at = start, 0
    if c["batch_windows"]:
        *windows, n = c["batch_windows"]
        begin, at = fit_first(start, data.part(slice(n)), tuple(windows), mirrored).last, n - 1
    uv[: at + 1], ranges[: at + 1] = (np.nan, np.nan) if at else (uv[: at + 1], ranges[: at + 1])
    run = range_filtered(begin, data.part(slice(at, None)), c["turn_noise_rad2_s3"], 0.0, gate=0.0)
    truth = {k: v if k == "times" else v[[0, *range(at, len(v))]] for k, v in truth.items()}
    return _scores(c, truth, points, start, run)


def mirrored(x: RangeMotion) -> RangeMotion:
    """The state that one camera hardly tells from this one (Necker's reversal): depths mirrored about the points'
    middle, the turn across the sight reversed, the inertia that of the mirrored body."""
    R = rotation_matrix(x.q)
    sight = R.T @ x.r / np.linalg.norm(x.r)
    flip = np.eye(3) - 2 * np.outer(sight, sight)
    middle = x.f.mean(axis=0)
    w = -flip @ x.w
    s, v = cholesky_parameters(flip @ cholesky_inertia(x.s) @ flip), x.v + R @ np.cross(x.w - w, middle)
    return RangeMotion(x.q, w, s, x.r, v, middle + (x.f - middle) @ flip)


def _start(c: dict[str, Any], truth: dict[str, np.ndarray], uv: np.ndarray, rng: np.random.Generator) -> RangeStart:
    """The paper's initial guess, with a covariance that knows how its errors hang together."""
    sigma_r, sigma_w = c["start_sigma_position_m"], np.radians(c["start_sigma_rate_deg_s"])
    r = truth["r"][0] + sigma_r * rng.standard_normal(3)
    w = truth["w"][0] + sigma_w * rng.standard_normal(3)
    noise = c["start_sigma_inertia_kg_m2"] * rng.standard_normal((3, 3))
    tensor = np.diag(c["inertia_kg_m2"]) + np.tril(noise) + np.tril(noise, -1).T
    camera, q = truth["camera"][0], truth["q"][0]
    ray = np.concatenate([uv / c["focal_px"], np.ones((len(uv), 1))], axis=1)
    depth = float(np.linalg.norm(r))
    X = rotate(camera, ray * depth)
    R = rotation_matrix(q)
    f = (X - r) @ R
    m = len(f)
    P = np.zeros((BASE + 3 * m, BASE + 3 * m))
    P[:3, :3] = 1e-10 * np.eye(3)
    P[3:6, 3:6] = sigma_w**2 * np.eye(3)
    P[6:11, 6:11] = _inertia_spread(tensor, c["start_sigma_inertia_kg_m2"])
    n_mean = np.sqrt(MU / c["orbit_radius_m"] ** 3)
    P[14:17, 14:17] = (2 * n_mean * depth) ** 2 * np.eye(3)
    # a point lies on its ray: depth |r| + error, so f = R^T (ray depth - r) moves with the error of r
    mean_ray = r / depth
    blocks = [R.T @ (np.outer(rotate(camera, a), mean_ray) - np.eye(3)) for a in ray]
    J = np.concatenate([np.eye(3), *blocks])
    at = np.r_[11:14, BASE : BASE + 3 * m]
    P[np.ix_(at, at)] += sigma_r**2 * J @ J.T
    for i in range(m):
        along = R.T @ rotate(camera, ray[i])
        s = slice(BASE + 3 * i, BASE + 3 * i + 3)
        lateral = (depth / c["focal_px"]) ** 2
        P[s, s] += c["start_sigma_depth_m"] ** 2 * np.outer(along, along) + lateral * np.eye(3)
    return RangeStart(q, w, cholesky_parameters(tensor), r, np.zeros(3), f, P)


def _inertia_spread(tensor: np.ndarray, sigma: float) -> np.ndarray:
    """(5, 5) covariance of the parameters when each of the six elements has `sigma`."""
    base = cholesky_parameters(tensor)
    columns = []
    for i in range(3):
        for j in range(i + 1):
            e = np.zeros((3, 3))
            e[i, j] = e[j, i] = 1e-5
            columns.append((cholesky_parameters(tensor + e) - base) / 1e-5 * sigma)
    J = np.stack(columns, axis=-1)
    return J @ J.T


def _scores(
    c: dict[str, Any], truth: dict[str, np.ndarray], points: np.ndarray, start: RangeStart, run: Any
) -> dict[str, Any]:
    true = {name: truth[name][-1] for name in ("q", "w", "r", "v", "camera")}
    camera, last = true["camera"], run.last
    q, r, v = multiply(camera, last.q), rotate(camera, last.position), rotate(camera, last.velocity)
    end = RangeMotion(q, last.w, run.k[-1], r, v, last.features)
    block = to_camera(camera).T @ last.P[:BASE, :BASE] @ to_camera(camera)
    by_k = cholesky_ratio_derivatives(end.s)[0]
    row: dict[str, Any] = {
        **_errors(c, truth, points, start, 0, "start"),
        **_errors(c, truth, points, end, -1, "end"),
        "attitude end": np.degrees(angle_between(q, true["q"])),
        "innovation": run.nis.sum() / max(run.used.sum(), 1),
    }
    exact = RangeMotion(
        true["q"], true["w"], cholesky_parameters(np.diag(c["inertia_kg_m2"])), true["r"], true["v"], points
    )
    error = exact.minus(end)
    for name, part in PARTS.items():
        row[f"nees {name}"] = normalised_square(error[part], block[part, part])
    off = ratios(cholesky_inertia(end.s))[0] - ratios(np.diag(c["inertia_kg_m2"]))[0]
    row["nees k"] = normalised_square(off, by_k @ block[6:11, 6:11] @ by_k.T)
    return {name: float(value) for name, value in row.items()}


def _errors(
    c: dict[str, Any], truth: dict[str, np.ndarray], points: np.ndarray, x: RangeMotion, at: int, when: str
) -> dict[str, Any]:
    """Errors of a state against the truth of an epoch."""
    q, w, tensor = truth["q"][at], truth["w"][at], cholesky_inertia(x.s)
    k = np.abs(ratios(tensor)[0] - ratios(np.diag(c["inertia_kg_m2"]))[0])
    errors = {
        "position": np.linalg.norm(x.r - truth["r"][at]),
        "velocity": np.linalg.norm(x.v - truth["v"][at]),
        "rate": np.degrees(np.linalg.norm(rotate(x.q, x.w) - rotate(q, w))),
        "body rate": np.degrees(np.linalg.norm(x.w - w)),
        "points": np.sqrt(np.mean(np.sum((x.f - points) ** 2, axis=1))),
        "k1": k[0],
        "k2": k[1],
        # largest angle of the principal axes from the true ones, the body's
        "axes": np.degrees(np.arccos(np.clip(np.abs(np.diag(np.linalg.eigh(tensor)[1])), 0, 1)).max()),
    }
    return {f"{name} {when}": value for name, value in errors.items()}


PARTS = {
    "attitude": slice(0, 3),
    "rate": slice(3, 6),
    "inertia": slice(6, 11),
    "position": slice(11, 14),
    "velocity": slice(14, 17),
    "all of them": slice(0, 17),
}
QUANTITIES = (
    ("points", "feature points, rms [m]", "one order"),
    ("rate", "angular velocity, inertial axes [deg/s]", "three orders"),
    ("body rate", "angular velocity, body axes [deg/s]", "three orders"),
    ("position", "position [m]", "two orders"),
    ("velocity", "velocity [m/s]", "three orders"),
    ("k1", "k1", "did not improve"),
    ("k2", "k2", "did not improve"),
    ("axes", "principal axes [deg]", "did not improve"),
)


def table(case: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Start, end and their ratio, ours beside what the paper says of its own."""
    good = [r for r in rows if "error" not in r]
    columns = ["quantity", "paper", "start 50 %", "end 50 %", "end 90 %", "end 100 %", "ours, start rms / end rms"]
    out = []
    for key, text, paper in QUANTITIES:
        start = np.array([r[f"{key} start"] for r in good])
        end = np.array([r[f"{key} end"] for r in good])
        gain = np.sqrt(np.mean(start**2)) / np.sqrt(np.mean(end**2))
        out.append([text, paper, f"{np.median(start):.3g}", *percentiles(end), f"{gain:.3g}"])
    attitude = percentiles([r["attitude end"] for r in good])
    out.append(["attitude [deg]", "known at the start", "0", *attitude, "-"])
    notes = [f"{len(rows)} runs, {len(rows) - len(good)} failed", *(__doc__ or "").split("\n\n")[1:]]
    for name, part in {**PARTS, "k": slice(0, 2)}.items():
        values = np.array([r[f"nees {name}"] for r in good])
        notes.append(consistency(f"{name} at the end", values, part.stop - part.start))
    notes.append(f"mean squared normalised innovation {np.mean([r['innovation'] for r in good]):.3f}")
    return {
        "title": "volpe2017 tables 1-2: one camera and ranges over one orbit",
        "columns": columns,
        "rows": out,
        "notes": notes,
    }
