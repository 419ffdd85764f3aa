"""hu2024, figures 5-11: the unique principal frame at four noise levels, and the filter with and without it.

The paper does not give the following, so it is chosen here: a baseline of 1 m; the camera points at the first position
of the target and keeps its inertial attitude; the initial velocity is read in cm/s (in m/s the target would pass behind the camera after 20 s and
be 170 m away at the end); the orbital rate follows from the radius of 6800 km; two more occlusions of 20 s after the
first, so that the filter meets several. The true target is free of torque and force, as the method assumes; the
paper's process noise is in the filters only.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from massprops.campaigns.consistency import consistency
from massprops.campaigns.papers._hu2024_frames import (
    Growth,
    attitude_of_points,
    determined_frames,
    growing_inertia,
    local_rates,
)
from massprops.campaigns.papers._hu2024_scores import SYMMETRIES, rms, scores
from massprops.campaigns.papers._references import Reference
from massprops.campaigns.papers._seeds import MU, column, on_circular_orbit, percentiles, stereo_pair
from massprops.core.linalg import inverse_of
from massprops.dynamics.chaser_path import chaser_path
from massprops.dynamics.kernels import differential_gravity
from massprops.dynamics.quaternion import (
    conjugate,
    from_rotation_matrix,
    mean_quaternion,
    multiply,
    rotation_matrix,
    rotation_vector,
)
from massprops.dynamics.rigid_body import propagate
from massprops.errors import MasspropsError
from massprops.estimators.filters import Noise, Run, State
from massprops.estimators.filters.features import run_through
from massprops.estimators.filters.principal_axes import in_principal_axes
from massprops.estimators.filters.setup import Setup, setup
from massprops.estimators.filters.state import ITERATED
from massprops.estimators.result import Prior
from massprops.estimators.start import first_guess
from massprops.estimators.unique_frame import SignRule, sign_rule, unique_frame
from massprops.model.problem import Problem
from massprops.sensing.pinhole import Pinhole, project
from massprops.sensing.stereo import triangulate

PAPER = "hu2024"
REFERENCE = Reference(
    "Q. Hu, S. Wu, F. Meng, Z. Wu",
    "Relative Motion Estimation Algorithm for Noncooperative Targets Considering Multiple Solutions of "
    "Rotational Parameters",
    "Sensors 24, 1811",
    2024,
    "10.3390/s24061811",
)
CASES = {
    "frame": "figure 5: the attitude of the unique principal frame at four noise levels; how often each rule flips",
    "motion": "figures 6-11: the filter through occlusions of 20 s, with the unique frame and without it",
}
RUNS = {"frame": 500, "motion": 500}
CHUNK = 10
LEVELS = [1e-6, 5e-6, 2e-5, 5e-5]
"""1-sigma of the images [rad]."""
FOCAL = 1000.0
"""Of both cameras [px]; the paper states noise as an angle."""
SEED = 2024


def configuration(case: str) -> dict[str, Any]:
    """The whole set-up of a case as plain data."""
    return {
        "case": case,
        "levels_rad": LEVELS,
        "inertia_kg_m2": [8.0, 5.0, 4.0],
        "w0_rad_s": [0.1, 0.1, 0.1],
        "features": 6,
        "half_side_m": 1.5,
        "distance_m": float(np.sqrt(300.0)),
        "velocity_m_s": [-0.003889, -0.004932, -0.008264],
        "baseline_m": 1.0,
        "orbit_radius_m": 6.8e6,
        "rate_hz": 10.0,
        "duration_s": 100.0 if case == "frame" else 200.0,
        "occlusions_s": [[50.0, 70.0]] if case == "frame" else [[50.0, 70.0], [110.0, 130.0], [160.0, 180.0]],
        "start_s": 20.0,
        "torque_noise": 2.5e-5,
        "force_noise": 2e-6,
        "shape_s": [5.0, 15.0, 30.0],
        "rate_window_s": 3.0,
        "rate_every_s": 0.5,
        "steady_s": 10.0,
    }


def runs(configuration: dict[str, Any], seeds: list[int]) -> list[dict[str, Any]]:
    """One row per seed; a seed's data do not depend on the others."""
    truth = _truth(configuration)
    if configuration["case"] == "motion":
        return [_motion(configuration, truth, seed) for seed in seeds]
    rows: list[dict[str, Any]] = [{"seed": seed} for seed in seeds]
    for level in configuration["levels_rad"]:
        # in small groups: memory, and the result of a run is the same in any group
        for i in range(0, len(seeds), 25):
            group = _frames(configuration, truth, level, seeds[i : i + 25])
            for row, scored in zip(rows[i : i + 25], group, strict=True):
                row.update({f"{level:.0e} {name}": value for name, value in scored.items()})
    return rows


def _truth(c: dict[str, Any]) -> dict[str, np.ndarray]:
    """The one trajectory of the paper: body axes are the principal ones, in the order of the paper."""
    times = np.arange(round(c["duration_s"] * c["rate_hz"]) + 1) / c["rate_hz"]
    inertia = np.diag(c["inertia_kg_m2"])
    q, w = propagate(np.array([1.0, 0, 0, 0]), np.array(c["w0_rad_s"]), inertia, times)
    place = chaser_path(on_circular_orbit(c["orbit_radius_m"]), times).place
    r, v = np.array([0.0, 0.0, c["distance_m"]]), np.array(c["velocity_m_s"])
    out_r, out_v = [r], [v]
    h = 1.0 / c["rate_hz"]
    for l0, l1 in zip(place[:-1], place[1:], strict=True):

        def pull(x: np.ndarray, l: np.ndarray) -> np.ndarray:
            return np.array(differential_gravity(MU, *l, *x))

        # Nystroem's method for second-order equations: three accelerations a step, where `runge_kutta.step` takes four
        a1 = pull(r, l0)
        a2 = pull(r + h / 2 * v, (l0 + l1) / 2)
        a4 = pull(r + h * v + h * h / 2 * a2, l1)
        r, v = r + h * v + h * h / 6 * (a1 + 2 * a2), v + h / 6 * (a1 + 4 * a2 + a4)
        out_r.append(r)
        out_v.append(v)
    return {"times": times, "q": q, "w": w, "r": np.array(out_r), "v": np.array(out_v)}


def _cameras(c: dict[str, Any]) -> tuple[Pinhole, Pinhole]:
    return stereo_pair(FOCAL, c["baseline_m"])


def _measured(
    c: dict[str, Any], truth: dict[str, np.ndarray], level: float, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (n, 2, m, 2) with noise, NaN while occluded, and the features (m, 3)."""
    rng = np.random.default_rng([SEED, seed])
    f = rng.uniform(-c["half_side_m"], c["half_side_m"], (c["features"], 3))
    X = truth["r"][:, None] + np.einsum("nij,mj->nmi", rotation_matrix(truth["q"]), f)
    uv = np.stack([project(camera, X) for camera in _cameras(c)], axis=1)
    uv += FOCAL * level * rng.standard_normal(uv.shape)
    uv[_hidden(c, truth["times"])] = np.nan
    return uv, f


def _hidden(c: dict[str, Any], times: np.ndarray) -> np.ndarray:
    return np.any([(times > a) & (times < b) for a, b in c["occlusions_s"]], axis=0)


def _frames(c: dict[str, Any], truth: dict[str, np.ndarray], level: float, seeds: list[int]) -> list[dict[str, Any]]:
    times = truth["times"]
    measured = [_measured(c, truth, level, seed)[0] for seed in seeds]
    sigma = np.full(2, FOCAL * level)
    triangulated = [triangulate(_cameras(c), np.moveaxis(uv, 1, 2), sigma) for uv in measured]
    points = np.stack([p for p, _ in triangulated])
    there = np.asarray(np.isfinite(points).all(axis=(0, 2, 3)))
    information = np.zeros((*points.shape, 3))
    for point_information, (_, covariance) in zip(information, triangulated, strict=True):
        point_information[there] = inverse_of(covariance[there])
    half, every = round(c["rate_window_s"] * c["rate_hz"] / 2), round(c["rate_every_s"] * c["rate_hz"])
    parts = []
    for seconds, end in zip(c["shape_s"], [*c["shape_s"][1:], np.inf], strict=True):
        sight = np.flatnonzero(there & (times <= end + c["rate_window_s"]))
        early = np.flatnonzero(there)[: round(seconds * c["rate_hz"])]
        q = np.full((*points.shape[:2], 4), np.nan)
        for b, (p, point_information) in enumerate(zip(points, information, strict=True)):
            q[b, sight] = attitude_of_points(p[sight], point_information[sight], len(early))
        place, w = local_rates(times, q, half, every)
        growth = growing_inertia(q[:, place], w, (2 * half + 1) / every)
        # nothing is taken from before the shape's own time: every row rests on the past alone
        parts.append((times[place] >= seconds, q, growth))
    q, growth = parts[0][1].copy(), parts[0][2]
    for later, other, grown in parts[1:]:
        if not later.any():
            continue
        q[:, place[later][0] :] = other[:, place[later][0] :]
        growth = Growth(
            np.where(later[:, None, None], grown.inertia, growth.inertia),
            np.where(later[:, None, None], grown.covariance, growth.covariance),
            np.where(later, grown.count, growth.count),
        )
    frames = determined_frames(growth, round(c["steady_s"] / c["rate_every_s"]))
    # at the end of a window the frame is known for its last epoch
    now: np.ndarray = np.minimum(place + half, len(times) - 1)
    seen: np.ndarray = np.all(np.isfinite(q[:, now]), axis=-1)
    estimate = multiply(q[:, now], from_rotation_matrix(frames.unique))
    true = _true_frame(truth["q"], q, early, frames.rule)
    rows = []
    for b in range(len(seeds)):
        error = rotation_vector(multiply(conjugate(true[b][now]), np.where(seen[b][:, None], estimate[b], 1.0)))
        angle = np.where(seen[b], np.linalg.norm(error, axis=-1), np.nan)
        after = np.arange(len(now)) >= frames.adopted[b]
        row: dict[str, Any] = {
            "adopted_s": float(times[now[frames.adopted[b]]]) if after.any() else float("nan"),
            "flips": int(np.sum(after & (angle > np.pi / 3))),
            "flips memoryless": _changes(frames.memoryless[b][after]),
            "flips paper": _changes(frames.paper[b][after]),
        }
        for t in (5, 10, 20, 40, 50, 75, 100):
            k = int(np.argmin(np.abs(times[now] - t) + 1e9 * ~seen[b]))
            row[f"angle_deg {t}"] = float(np.degrees(angle[k]))
        rows.append(row)
    return rows


def _true_frame(q_true: np.ndarray, q: np.ndarray, early: np.ndarray, rule: SignRule) -> list[np.ndarray]:
    """The true attitude (n, 4) of the unique frame of each run: the published rule on the true axes in frame G."""
    frames = [_unique_axes(q[b, early], q_true[early], SignRule(rule.x[b], rule.z[b])) for b in range(len(q))]
    return [multiply(q_true, from_rotation_matrix(axes)) for axes in frames]


def _unique_axes(q: np.ndarray, q_true: np.ndarray, rule: SignRule) -> np.ndarray:
    """(3, 3) axes of the true unique frame in the true body axes, by a rule in the body axes of attitudes q (n, 4)."""
    R = rotation_matrix(mean_quaternion(multiply(conjugate(q), q_true)))
    return np.asarray(R.T @ unique_frame(R @ np.diag([8.0, 5.0, 4.0]) @ R.T, rule)[1])


def _changes(axes: np.ndarray) -> int:
    """How often the frame (p, 3, 3) jumps to another of the 24 from one time to the next."""
    if len(axes) < 2:
        return 0
    turn = np.einsum("pji,pji->p", axes[1:], axes[:-1])
    return int(np.sum(turn < 2.0))


def _motion(c: dict[str, Any], truth: dict[str, np.ndarray], seed: int) -> dict[str, Any]:
    row: dict[str, Any] = {"seed": seed}
    turn = SYMMETRIES[np.random.default_rng([SEED, seed, len(SYMMETRIES)]).integers(1, len(SYMMETRIES))]
    for level in c["levels_rad"]:
        uv, f = _measured(c, truth, level, seed)
        orbit = on_circular_orbit(c["orbit_radius_m"])
        problem = Problem.of_tracks(truth["times"], _cameras(c), uv, FOCAL * level, orbit)
        try:
            start = first_guess(problem, until_s=c["start_s"])
            filter_runs = {
                "with": followed(c, problem, start),
                "without": followed(c, problem, start, turn),
                "unstarted": _unstarted(c, problem),
            }
        except (MasspropsError, np.linalg.LinAlgError, FloatingPointError) as error:
            return {"seed": seed, "error": f"{level:.0e}: {error}"}
        unique, hidden = _unique(truth, start), _hidden(c, truth["times"])
        for name, run in filter_runs.items():
            run_scores = scores(c, truth, f, run, unique, hidden)
            row.update({f"{level:.0e} {name} {k}": v for k, v in run_scores.items()})
    return row


def _unique(truth: dict[str, np.ndarray], start: Any) -> int:
    """Which of the `SYMMETRIES` takes the true axes to the true unique frame, by the start's rule in its body axes."""
    axes = _unique_axes(start.q, truth["q"][start.index], sign_rule(start.inertia))
    return int(np.argmax(np.einsum("sij,ij->s", SYMMETRIES, axes)))


def followed(c: dict[str, Any], problem: Problem, start: Any, turn: np.ndarray | None = None) -> Run:
    """The filter in the unique principal frame of the start's inertia, or in another of the 24, to which `turn` leads."""
    ready = in_principal_axes(setup(problem, Prior(), start, c["features"]), unique_frame)
    ready = replace(ready, noise=_noise(c), state=ready.state if turn is None else in_other_axes(ready.state, turn))
    return run_through(problem, ready, ITERATED).run


def _noise(c: dict[str, Any]) -> Noise:
    turn = c["torque_noise"]
    return Noise(w=turn, attitude=turn / c["rate_hz"] ** 2 / 3.0, k=0.0, velocity=c["force_noise"])


def in_other_axes(state: State, turn: np.ndarray) -> State:
    """The same state in another of the 24 principal frames: turn (3, 3) takes its axes to the present ones."""
    order = np.argmax(np.abs(turn), axis=0)
    # logarithms of the moments over the middle one by k, and k by those
    log = np.array([[1.0, 0.0], [0.0, 0.0], [0.0, -1.0]])[order]
    ratios = log[:2] - log[1:]
    T = np.eye(len(state.P))
    at = state.places()
    for first in (at["w"].start, at["attitude"].start, *range(at["features"].start, at["features"].stop, 3)):
        T[first : first + 3, first : first + 3] = turn.T
    T[at["k"], at["k"]] = ratios
    other = multiply(state.q, from_rotation_matrix(turn))
    return replace(
        state, w=turn.T @ state.w, q=other, k=ratios @ state.k, features=state.features @ turn, P=T @ state.P @ T.T
    )


def _unstarted(c: dict[str, Any], problem: Problem) -> Run:
    """The same filter without a least-squares start: the first frame's axes taken as principal ones, nothing known of k."""
    points = triangulate(problem.cameras, np.moveaxis(problem.uv[:1], 1, 2), problem.sigma_px)[0][0]
    centre, m = points.mean(axis=0), len(points)
    sigma = np.concatenate([np.full(3, 0.2), np.ones(3), np.full(2, 0.3), np.ones(3), np.full(3, 0.1), np.ones(3 * m)])
    state = State(
        np.zeros(3), np.array([1.0, 0, 0, 0]), np.full(2, 0.1), points - centre, np.diag(sigma**2), position=centre,
        moving=True,
    )  # fmt: skip
    ready = Setup(state, np.arange(m), _noise(c), 0, True, (False, False, False), sigma[6:8])
    return run_through(problem, ready, ITERATED).run


def table(case: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Ours by noise level; the paper prints curves only, so its side is what its text says of them."""
    good = [r for r in rows if "error" not in r]
    notes = [f"{len(rows)} runs, {len(rows) - len(good)} failed", *(__doc__ or "").split("\n\n")[1:]]
    return (_frame_table if case == "frame" else _motion_table)(good, notes)


FLIPS = ("flips", "flips memoryless", "flips paper")


def _frame_table(rows: list[dict[str, Any]], notes: list[str]) -> dict[str, Any]:
    times = (5, 10, 20, 40, 50, 75, 100)
    columns = ["noise rad", "paper", "adopted at s (50, 100 %)", "never adopted", *[f"RMSE deg {t} s" for t in times]]
    columns += ["runs that flip: mended rule, kept", "mended rule, without memory", "paper's rule"]
    out = []
    for level in LEVELS:
        get = {name: column(rows, f"{level:.0e} {name}") for name in ("adopted_s", *FLIPS)}
        adopted = get["adopted_s"]
        ok = np.isfinite(adopted)
        line: list[Any] = [f"{level:.0e}", "converges in a few seconds"]
        line += [f"{np.median(adopted[ok]):.1f} {adopted[ok].max():.1f}" if ok.any() else "-", int((~ok).sum())]
        for t in times:
            use = ok & (adopted <= t)
            angle = column(rows, f"{level:.0e} angle_deg {t}")
            line.append(f"{rms(angle[use]):.3g} ({int(use.sum())})" if use.any() else "-")
        line += [int((get[name] > 0).sum()) for name in FLIPS]
        out.append(line)
    notes.append("RMSE over the runs that had adopted a frame by then (their number in brackets); flips after adoption")
    return {
        "title": "hu2024 figure 5: attitude of the unique principal frame",
        "columns": columns,
        "rows": out,
        "notes": notes,
    }


FILTERS = {
    "with": "with the unique frame",
    "without": "without: any of the 24, else the same",
    "unstarted": "without it and without a start",
}
SHOWN = (
    ("attitude_deg before", "attitude deg, before"),
    ("attitude_deg hidden", "worst while occluded"),
    ("attitude_deg end", "last 10 s"),
    ("nearest_deg hidden", "worst while occluded, nearest of 24"),
    ("unique_deg before", "against the unique frame, before"),
    ("unique_deg end", "last 10 s"),
    ("rate hidden", "rate rad/s, worst while occluded"),
    ("rate end", "rate, last 10 s"),
    ("k end", "k, last 10 s"),
    ("features end", "features m, end"),
    ("position hidden", "position m, worst while occluded"),
    ("position end", "position, last 10 s"),
    ("velocity end", "velocity m/s, last 10 s"),
    ("nees", "NEES w, r, v"),
)


def _motion_table(rows: list[dict[str, Any]], notes: list[str]) -> dict[str, Any]:
    columns = ["noise rad", "filter", "percentile", *[text for _, text in SHOWN], "runs that left their frame"]
    out = []
    for level in LEVELS:
        for name, label in FILTERS.items():
            frame_losses = int(sum(r[f"{level:.0e} {name} left_frame"] for r in rows))
            for percent in (50, 90, 100):
                line: list[Any] = [f"{level:.0e}", label, percent]
                for key, _ in SHOWN:
                    line += percentiles(column(rows, f"{level:.0e} {name} {key}"), (percent,))
                out.append([*line, frame_losses if percent == 50 else ""])
    notes.append(
        "the first two share start, noise and filter and differ in the frame alone; the third, as filters are usually "
        "begun, lacks the least-squares start as well: what it loses is the start's doing, not the frame's"
    )
    notes.append("the paper (figures 6-11): with the frame errors stay near zero, without it they are offset and drift")
    for level in LEVELS:
        for name, label in FILTERS.items():
            squares = column(rows, f"{level:.0e} {name} nees") * 9
            notes.append(consistency(f"{label} at {level:.0e} (rates, place, velocity, each alone)", squares, 9))
    notes.append("the filters' process noise is the paper's, the truth has none")
    return {"title": "hu2024 figures 6-11: through occlusions of 20 s", "columns": columns, "rows": out, "notes": notes}
