"""Tracks of feature points on a tumbling body, with any effects at work, and the truth: no images are rendered."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import ModuleType
from typing import Any

import numpy as np

from massprops.dynamics.quaternion import (
    from_rotation_matrix,
    from_rotation_vector,
    multiply,
    normalise,
    rotation_matrix,
)
from massprops.dynamics.rotation import inertia_at_start
from massprops.dynamics.surroundings import Surroundings
from massprops.errors import InputError, NotPossible
from massprops.estimators.batch.linearise import Predicted, body_points, predict
from massprops.estimators.batch.measurements import Measurements
from massprops.estimators.batch.state import BatchState, inertia_of
from massprops.estimators.problem import Problem
from massprops.model import Model, lacks, load_model, model_of
from massprops.sensing.pinhole import pinhole_of
from massprops.sensing.predict import Seen, camera_turn, image, in_chaser
from massprops.sequence.data import (
    AttitudeSeries,
    Body,
    Camera,
    Environment,
    Orbit,
    RangeSeries,
    RateSeries,
    Sequence,
    Tracks,
)


@dataclass(frozen=True)
class TrackScenario:
    """What is simulated. SI units, degrees, pixels; None is drawn from the seed.

    Attributes:
        frames: number of epochs; rate_hz: epochs a second; rate_deg: rotation per epoch.
        features: number of points; span_m: size of the body; distance_m: from cam0.
        baseline_m: of the second camera, 0 for one camera; focal_px; size: width, height.
        sigma_px: track noise; outliers: share of tracks that are wrong; hide_back: points on the far side are unseen.
        moments: principal moments, any unit; spin: angular velocity in principal axes, any length.
        drift_m_s: speed of the centre of mass; range_sigma_m, rate_sigma, attitude_sigma: other sensors' noise, 0 for none.
        orbit, sun, field: whether the surroundings are known (and the target falls beside the chaser).
        assumed: whether `body.yaml` gives the inertia; assumed_sigma: its relative 1-sigma, drawn so.
        effects: `name`, `name:PIXELS` (rms displacement of the tracks) or `name:parameter=value,...`.
        model: a `model.yaml` whose effects act besides.
        seed: of everything drawn.
    """

    frames: int = 480
    rate_hz: float = 2.0
    rate_deg: float = 3.0
    features: int = 16
    span_m: float = 2.0
    distance_m: float = 9.0
    baseline_m: float = 1.0
    focal_px: float = 1000.0
    size: tuple[int, int] = (1280, 1024)
    sigma_px: float = 0.3
    outliers: float = 0.0
    hide_back: bool = True
    moments: tuple[float, float, float] | None = None
    spin: tuple[float, float, float] | None = None
    drift_m_s: float = 0.002
    range_sigma_m: float = 0.02
    rate_sigma: float = 0.0
    attitude_sigma: float = 0.0
    orbit: bool = True
    sun: bool = True
    field: bool = True
    assumed: bool = True
    assumed_sigma: float = 0.005
    effects: tuple[str, ...] = ()
    model: str | None = None
    seed: int = 0


ROWS_SOUGHT = 5
"""Times that the row of a point is sought where rows are taken at times of their own."""

RANGES: dict[str, tuple[float, float]] = {
    "frames": (4, 100_000),
    "rate_hz": (1e-3, 1e4),
    "rate_deg": (0.0, 60.0),
    "features": (0, 2000),
    "span_m": (1e-3, 1e4),
    "distance_m": (1e-2, 1e6),
    "baseline_m": (0.0, 1e4),
    "focal_px": (10.0, 1e5),
    "sigma_px": (0.0, 50.0),
    "outliers": (0.0, 0.5),
    "range_sigma_m": (0.0, 1e4),
    "rate_sigma": (0.0, 10.0),
    "attitude_sigma": (0.0, 3.0),
    "assumed_sigma": (0.0, 1.0),
    "seed": (0, 2**31 - 1),
}


@dataclass(frozen=True)
class Simulated:
    """A sequence, its truth (as `write_sequence` takes it), the effects that acted, and the true state at the start."""

    sequence: Sequence
    truth: dict[str, Any]
    model: Model
    state: BatchState
    pixels: dict[str, float] = field(default_factory=dict)


def simulate_tracks(scenario: TrackScenario = TrackScenario(), outside: tuple[ModuleType, ...] = ()) -> Simulated:
    """A sequence of tracks and other sensors with known truth.

    Args:
        scenario: what is simulated.
        outside: effects on the motion that are not in the catalogue, acting with their `SIMULATED` parameters.

    Raises:
        InputError: a value out of range, an unknown effect or one whose surroundings are switched off.
        NotPossible: the body leaves the cameras' view.
    """
    for key, (low, high) in RANGES.items():
        if not low <= getattr(scenario, key) <= high:
            raise InputError(f"{key} {getattr(scenario, key)}: give a value from {low:g} to {high:g}")
    s = scenario
    rng = np.random.default_rng([s.seed, 11])
    times = np.arange(s.frames) / s.rate_hz
    environment = _environment(s, rng)
    around = Surroundings(environment)
    inertia, axes = _inertia(s, rng)
    state = _start(s, rng, inertia, axes)
    cameras = _cameras(s)
    problem = blank_problem(s, times, cameras, environment)
    clean = predict(problem, state, around)
    view = _view(s, problem, clean, rng)
    sizes, asked = asked_for(s, problem, around)
    drawn: dict[str, np.ndarray] = {}
    for name, value in sizes.items():
        drawn[name] = value if value is not None else sized(name, asked[name], problem, state, around, view, clean, rng)
    if s.model is not None:
        given = load_model(s.model)
        drawn.update({name: given.value(name) for name in given.names})
    model = model_of(dict(drawn))
    if outside:
        motion = [m for m in model.modules if m in model.acting.effects]
        values = [model.value(m.NAME) for m in motion]
        sensing = [m for m in model.modules if m not in motion]
        model = Model(
            (*motion, *outside, *sensing),
            (*values, *(np.asarray(m.SIMULATED, float) for m in outside), *(model.value(m.NAME) for m in sensing)),
        )
    whole = _with_model(state, model)
    acted = predict(problem, whole, around)
    view = _view(s, problem, acted, np.random.default_rng([s.seed, 12]))
    exact = _pixels(problem, acted, view)
    sequence = _measure(s, problem, cameras, acted, view, exact, environment, inertia)
    pixels = {"rms": float(np.sqrt(np.mean(np.sum((exact - _pixels(problem, clean, view)) ** 2, axis=1))))}
    return Simulated(sequence, _truth(s, times, acted, whole, axes, model), model, whole, pixels)


def write_tracks(scenario: TrackScenario, out: Any) -> Any:
    """`simulate_tracks` into a sequence folder with its truth; the folder's path.

    Raises:
        InputError: as `simulate_tracks`, or the folder holds something else or cannot be written.
    """
    from pathlib import Path

    from massprops.sequence.write import write_sequence
    from massprops.simulate.simulate import refuse_others

    folder = Path(out)
    refuse_others(folder)
    made = simulate_tracks(scenario)
    try:
        return write_sequence(folder, made.sequence, made.truth)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}): choose another place with -o") from None


def track_scenario(given: dict[str, Any], where: str) -> TrackScenario:
    """A scenario of names with values, as a YAML file of `kind: tracks` gives them.

    Raises:
        InputError: an unknown name or a value of the wrong kind.
    """
    from dataclasses import fields

    names = {f.name for f in fields(TrackScenario)}
    chosen = {k: v for k, v in given.items() if k != "kind" and v is not None}
    for key in chosen:
        if key not in names:
            raise InputError(f"{where}: scenario key {key!r} is not known; there are {', '.join(sorted(names))}")
    for key in ("moments", "spin", "size", "effects"):
        if key in chosen:
            chosen[key] = tuple(chosen[key])
    scenario = TrackScenario(**chosen)
    for key, (low, high) in RANGES.items():
        value = getattr(scenario, key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise InputError(f"{where}: {key} {value!r}: give a value from {low:g} to {high:g}")
    return scenario


def _environment(s: TrackScenario, rng: np.random.Generator) -> Environment:
    turn = rotation_matrix(normalise(rng.standard_normal(4)))
    sun = rng.standard_normal(3)
    magnetic = rng.standard_normal(3)
    orbit = Orbit(3.986004418e14, 6.9e6 + 4e5 * rng.random(), 0.01 * rng.random(), 6.28 * rng.random(), turn)
    return Environment(
        "inertial",
        orbit if s.orbit else None,
        sun / np.linalg.norm(sun) if s.sun else None,
        3e-5 * magnetic / np.linalg.norm(magnetic) if s.field else None,
    )


def _inertia(s: TrackScenario, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    if s.moments is None:
        spread = np.sort(rng.uniform(0.25, 1.0, 3)) ** 2
        while min(np.diff(np.sort(spread.sum() - spread))) < 0.08 * spread.sum():
            spread = np.sort(rng.uniform(0.25, 1.0, 3)) ** 2
        moments = np.sort(spread.sum() - spread)
    else:
        moments = np.sort(np.array(s.moments, float))
        if not (moments[0] > 0 and moments[0] + moments[1] > moments[2]):
            raise InputError(f"moments {s.moments}: break the triangle inequality")
    axes = rotation_matrix(normalise(rng.standard_normal(4)))
    inertia = (axes * (3.0 * moments / moments.sum())) @ axes.T
    return inertia_of(0.5 * np.trace(inertia) * np.eye(3) - inertia), axes


def _start(s: TrackScenario, rng: np.random.Generator, inertia: np.ndarray, axes: np.ndarray) -> BatchState:
    direction = np.array(s.spin, float) if s.spin is not None else rng.standard_normal(3) + [0.3, 0.6, 0.3]
    w0 = axes @ direction / np.linalg.norm(direction) * np.radians(s.rate_deg) * s.rate_hz
    points = rng.standard_normal((s.features, 3))
    points *= 0.5 * s.span_m * rng.uniform(0.6, 1.0, (s.features, 1)) / np.linalg.norm(points, axis=1, keepdims=True)
    velocity = rng.standard_normal(3)
    velocity *= s.drift_m_s / np.linalg.norm(velocity)
    r0 = np.array([*rng.uniform(-0.05, 0.05, 2) * s.distance_m, s.distance_m])
    return BatchState(normalise(rng.standard_normal(4)), w0, r0, velocity, inertia, Model(), points)


def _cameras(s: TrackScenario) -> dict[int, Camera]:
    if not s.features:
        return {}
    intrinsics = np.array([s.focal_px, s.focal_px, s.size[0] / 2, s.size[1] / 2])
    first = Camera(s.size, intrinsics, sigma_px=max(s.sigma_px, 1e-6), rate_hz=s.rate_hz)
    if s.baseline_m <= 0:
        return {0: first}
    pose = np.eye(4)
    pose[0, 3] = s.baseline_m
    return {0: first, 1: Camera(s.size, intrinsics, T_BS=pose, sigma_px=first.sigma_px, rate_hz=s.rate_hz)}


def blank_problem(
    s: TrackScenario,
    times: np.ndarray,
    cameras: dict[int, Camera] | None = None,
    environment: Environment | None = None,
) -> Problem:
    """A problem of the scenario's shape without measurements."""
    cameras = _cameras(s) if cameras is None else cameras
    environment = Environment() if environment is None else environment
    n, c = len(times), len(cameras)
    return Problem(
        np.round(times * 1e9).astype(np.int64),
        times,
        tuple(pinhole_of(cameras[k], cameras[0]) for k in cameras),
        np.full((n, c, s.features, 2), np.nan),
        np.full(c, max(s.sigma_px, 1e-6)),
        np.arange(s.features),
        np.full(n, np.nan),
        1.0,
        np.full((n, 3), np.nan),
        1.0,
        np.full((n, 4), np.nan),
        np.full(n, np.nan),
        None,
        environment,
    )


def _view(s: TrackScenario, problem: Problem, at: Any, rng: np.random.Generator) -> Measurements:
    """Which features are seen when: those that face the camera, and stay inside the picture."""
    n, c, m = problem.uv.shape[:3]
    i, k, j = (a.reshape(-1) for a in np.meshgrid(np.arange(n), np.arange(c), np.arange(m), indexing="ij"))
    every = Measurements(
        Seen(i, k, j, np.zeros(len(i))), np.zeros((len(i), 2)), np.ones(len(i)), *(np.zeros(0, int) for _ in range(3))
    )
    if not len(i):
        return every
    points, sensed, p = body_points(at, every), at.state.model.sensed, at.state.model.flat(False)
    for _ in range(ROWS_SOUGHT if sensed.having("delay") else 1):
        X, body, _ = in_chaser(every.seen, at.motion, points, sensed, p)
        uv = image(problem.cameras, k, X, sensed, p)
        # a row is taken at the time of the row in which the point appears
        every = replace(every, seen=replace(every.seen, row=np.clip(uv[:, 1] / s.size[1] - 0.5, -1.0, 1.0)))
    keep = (uv >= 0).all(axis=1) & (uv[:, 0] < s.size[0]) & (uv[:, 1] < s.size[1]) & (X[:, 2] > 0.1)
    if s.hide_back:
        outward = X - at.motion.r[i]
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        sight = X / np.linalg.norm(X, axis=1, keepdims=True)
        keep &= np.sum(outward * sight, axis=1) < 0.15
    if keep.sum() < 0.02 * len(keep):
        raise NotPossible("the body is hardly ever in view: bring it nearer, or slow its drift")
    return Measurements(
        Seen(i[keep], k[keep], j[keep], every.seen.row[keep]),
        uv[keep],
        np.ones(int(keep.sum())),
        *(np.zeros(0, int) for _ in range(3)),
    )


def _pixels(problem: Problem, at: Any, view: Measurements) -> np.ndarray:
    if not len(view.uv):
        return view.uv
    sensed, p = at.state.model.sensed, at.state.model.flat(False)
    return image(
        problem.cameras,
        view.seen.camera,
        in_chaser(view.seen, at.motion, body_points(at, view), sensed, p)[0],
        sensed,
        p,
    )


def _with_model(state: BatchState, model: Model) -> BatchState:
    return BatchState(state.q0, state.w0, state.r0, state.v0, state.inertia, model, state.points)


def asked_for(
    s: TrackScenario, problem: Problem, around: Surroundings
) -> tuple[dict[str, np.ndarray | None], dict[str, float]]:
    """The effects asked for: parameters where they are given, pixels where they are to be drawn."""
    from massprops.effects import effects

    known = effects()
    there = there_of(problem, around, s.range_sigma_m > 0, s.assumed)
    sizes: dict[str, np.ndarray | None] = {}
    pixels: dict[str, float] = {}
    for text in s.effects:
        name, _, size = text.partition(":")
        if name not in known:
            raise InputError(f"effect {name!r} is not known; there are {', '.join(known)}")
        missing = lacks(known[name], there)
        if missing:
            raise InputError(f"effect {name} {missing}, which this scenario has not")
        sizes[name], pixels[name] = None, 6.0
        try:
            if "=" in size:
                given = {k.strip(): float(v) for k, v in (part.split("=") for part in size.split(","))}
                names = [q.name for q in known[name].PARAMETERS]
                if set(given) - set(names):
                    raise InputError(f"effect {text}: parameters of {name} are {', '.join(names)}")
                sizes[name] = np.array([given.get(n, 0.0) for n in names])
            elif size:
                pixels[name] = float(size)
        except ValueError:
            raise InputError(f"effect {text}: give NAME:PIXELS or NAME:parameter=value,...") from None
        if not 0 < pixels[name] <= 1000:
            raise InputError(f"effect {text}: give pixels above 0, at most 1000")
    return sizes, pixels


def there_of(problem: Problem, around: Surroundings, ranged: bool, assumed: bool) -> set[str]:
    """What of an effect's needs is there."""
    there = set(around.known)
    tracks = problem.uv.shape[2] > 0
    there |= {"tracks"} if tracks else set()
    there |= {"camera"} if tracks or problem.has_attitude else set()
    there |= {"stereo"} if tracks and len(problem.cameras) == 2 else set()
    there |= {"range"} if ranged else set()
    there |= {"assumed inertia"} if assumed else set()
    return there


def sized(
    name: str,
    target: float,
    problem: Problem,
    state: BatchState,
    around: Surroundings,
    view: Measurements,
    clean: Predicted,
    rng: np.random.Generator,
) -> np.ndarray:
    """Parameters in a drawn direction, as large as moves the tracks by `target` px rms from their clean places."""
    from massprops.effects import effects

    base = _pixels(problem, clean, view)

    parameters = effects()[name].PARAMETERS
    span = float(problem.times[-1])
    draws = rng.standard_normal(len(parameters))
    draws = np.where([q.least is not None for q in parameters], 0.5 + np.abs(draws), draws)
    way = np.array([q.size for q in parameters]) * draws
    when = span * rng.uniform(0.3, 0.7)

    def at(scale: float) -> np.ndarray:
        values = []
        for q, v in zip(parameters, way, strict=True):
            if q.kind == "time":
                values.append(when)
            elif q.kind == "span":
                values.append(span)
            else:
                values.append(0.0 if q.form else scale * v)
        if name == "energy-dissipation":
            # the coupling is a rate, not a size: near the body's own, where friction is strongest
            values[1] = float(np.linalg.norm(state.w0)) * (0.3 + draws[1])
        return np.array(values)

    def rms(scale: float) -> float:
        try:
            moved = predict(problem, _with_model(state, model_of({name: at(scale)})), around)
            off = _pixels(problem, moved, view) - base
            return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
        except (OverflowError, ZeroDivisionError, ValueError):
            return np.inf

    if not len(base) or rms(10.0) < 1e-6 * target:
        # nothing of it shows in the tracks: three times what is common, whichever sign was drawn
        return at(3.0 / max(float(np.max(np.abs(draws))), 1e-9))
    low, high = 0.0, 1e-3
    while rms(high) < target and high < 1e7:
        low, high = high, high * 4
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rms(middle) < target else (low, middle)
    return at(high)


def _measure(
    s: TrackScenario,
    problem: Problem,
    cameras: dict[int, Camera],
    at: Any,
    view: Measurements,
    exact: np.ndarray,
    environment: Environment,
    inertia: np.ndarray,
) -> Sequence:
    rng = np.random.default_rng([s.seed, 13])
    stamp = problem.stamp_ns
    uv = exact + s.sigma_px * rng.standard_normal(exact.shape)
    wrong = rng.random(len(uv)) < s.outliers
    uv[wrong] += rng.uniform(-40, 40, (int(wrong.sum()), 2))
    seen = view.seen
    order = np.lexsort((seen.feature, seen.camera, seen.epoch))
    tracks = Tracks(stamp[seen.epoch][order], seen.camera[order], seen.feature[order], uv[order]) if len(uv) else None
    sensed, p = at.state.model.sensed, at.state.model.flat(False)
    distance = np.linalg.norm(at.motion.r, axis=1)
    for effect, place in sensed.having("range_offset"):
        distance = distance + effect.range_offset(problem.times, p[place])
    ranges = rates = attitude = None
    if s.range_sigma_m > 0:
        ranges = RangeSeries(stamp, distance + s.range_sigma_m * rng.standard_normal(len(stamp)), s.range_sigma_m)
    if s.rate_sigma > 0:
        rates = RateSeries(stamp, at.motion.w + s.rate_sigma * rng.standard_normal(at.motion.w.shape), s.rate_sigma)
    if s.attitude_sigma > 0:
        q = multiply(from_rotation_matrix(camera_turn(at.motion, sensed, p)), at.q)
        q = multiply(q, from_rotation_vector(s.attitude_sigma * rng.standard_normal((len(q), 3))))
        attitude = AttitudeSeries(stamp, q, np.full(len(q), s.attitude_sigma))
    body = None
    if s.assumed:
        # what is assumed errs by what it claims to
        noise = rng.standard_normal((3, 3)) * s.assumed_sigma
        body = Body(
            inertia + 0.5 * (noise + noise.T), "ratio", source="simulated", inertia_sigma=s.assumed_sigma or None
        )
    return Sequence(cameras, tracks, ranges, rates, attitude, body, environment)


def _truth(
    s: TrackScenario, times: np.ndarray, at: Any, state: BatchState, axes: np.ndarray, model: Model
) -> dict[str, Any]:
    whole = inertia_at_start(state.inertia, model.acting, model.flat(True))
    moments, principal = np.linalg.eigh(whole)
    cam = camera_turn(at.motion, model.sensed, model.flat(False))
    return {
        "timestamp_ns": np.round(times * 1e9).astype(np.int64),
        "position": np.einsum("nij,nj->ni", cam, at.motion.r),
        "q": multiply(from_rotation_matrix(cam), at.q),
        "w": at.motion.w,
        "inertia": whole.tolist(),
        "principal_moments": moments.tolist(),
        "principal_axes": principal.tolist(),
        "k1": float(np.log(moments[0] / moments[1])),
        "k2": float(np.log(moments[1] / moments[2])),
        "features_m": state.points.tolist(),
        "effects": {
            name: {q.name: float(v) for q, v in zip(m.PARAMETERS, values, strict=True)}
            for name, m, values in zip(model.names, model.modules, model.values, strict=True)
        },
        "seed": s.seed,
        "motion": "tumbling",
    }
