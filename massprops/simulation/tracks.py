"""Tracks of feature points on a tumbling body, with any effects at work, and the truth: no images are rendered."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.inertia import ratios_of_moments
from massprops.dynamics.quaternion import (
    from_rotation_matrix,
    from_rotation_vector,
    multiply,
    normalise,
    rotation_matrix,
)
from massprops.dynamics.rotation import inertia_at_start
from massprops.errors import InputError
from massprops.memory import refuse_beyond
from massprops.model import Model, load_model, model_of
from massprops.model.linearise import predict
from massprops.model.measurements import Measurements
from massprops.model.problem import BYTES_A_PIXEL, Problem
from massprops.model.state import BatchState, inertia_of
from massprops.sensing.predict import camera_turn
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
from massprops.simulation.effect_size import drawn_effects
from massprops.simulation.track_scenario import RANGES, TrackScenario
from massprops.simulation.track_view import blank_problem, cameras_of, pixels, visible


@dataclass(frozen=True)
class Simulated:
    """A sequence, its truth (as `write_sequence` takes it), the effects that acted, and the true state at the start."""

    sequence: Sequence
    truth: dict[str, Any]
    model: Model
    state: BatchState
    pixels: dict[str, float] = field(default_factory=dict)


def simulate_tracks(scenario: TrackScenario, outside: tuple[ModuleType, ...] = ()) -> Simulated:
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
    refuse_beyond(
        BYTES_A_PIXEL * s.frames * s.features * (1 + (s.baseline_m > 0)),
        f"{s.frames} frames of {s.features} features",
        "ask for fewer frames or features",
    )
    rng = np.random.default_rng([s.seed, 11])
    times = np.arange(s.frames) / s.rate_hz
    given_environment = _environment(s, rng)
    # the size of an effect is looked for in 50 motions
    environment = EnvironmentModel(given_environment, compiled=bool(s.effects))
    inertia, axes = _inertia(s, rng)
    state = _start(s, rng, inertia, axes)
    cameras = cameras_of(s)
    problem = blank_problem(s, times, cameras, given_environment)
    clean = predict(problem, state, environment)
    seen = visible(s, problem, clean)
    drawn = drawn_effects(s, problem, state, environment, seen, clean, rng)
    given = None if s.model is None else load_model(s.model)
    if given is not None:
        drawn.update({name: given.value(name) for name in given.names})
    model = model_of(dict(drawn), own=() if given is None else given.modules)
    if outside:
        motion = [m for m in model.modules if m in model.active.effects]
        values = [model.value(m.NAME) for m in motion]
        sensing = [m for m in model.modules if m not in motion]
        model = Model(
            (*motion, *outside, *sensing),
            (*values, *(np.asarray(m.SIMULATED, float) for m in outside), *(model.value(m.NAME) for m in sensing)),
        )
    whole = replace(state, model=model)
    acted = predict(problem, whole, environment)
    seen = visible(s, problem, acted)
    exact = pixels(problem, acted, seen)
    sequence = _measure(s, problem, cameras, acted, seen, exact, given_environment, inertia)
    square = np.sum((exact - pixels(problem, clean, seen)) ** 2, axis=1)
    moved = {"rms": float(np.sqrt(square.mean())) if len(square) else float("nan")}
    return Simulated(sequence, _truth(s, times, acted, whole, model), model, whole, moved)


def write_tracks(scenario: TrackScenario, out: Any, inputs: Iterable[Path] = (), force: bool = False) -> Path:
    """`simulate_tracks` into a sequence folder with its truth; the folder's path.

    Raises:
        InputError: as `simulate_tracks`, or the folder holds something else or cannot be written.
    """
    from massprops.sequence.write import write_sequence
    from massprops.simulation.folder import new_sequence

    with new_sequence(Path(out), scenario, inputs, force) as folder:
        made = simulate_tracks(scenario)
        write_sequence(folder, made.sequence, made.truth)
    return Path(out)


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
            raise InputError(
                f"moments {s.moments} break the triangle inequality: give three above 0 of which any two exceed the third"
            )
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
    for effect, place in sensed.hooks("range_offset"):
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


def _truth(s: TrackScenario, times: np.ndarray, at: Any, state: BatchState, model: Model) -> dict[str, Any]:
    whole = inertia_at_start(state.inertia, model.active, model.flat(True))
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
        **dict(zip(("k1", "k2"), ratios_of_moments(moments).tolist(), strict=True)),
        "features_m": state.points.tolist(),
        "effects": {
            name: {q.name: float(v) for q, v in zip(m.PARAMETERS, values, strict=True)}
            for name, m, values in zip(model.names, model.modules, model.values, strict=True)
        },
        "seed": s.seed,
        "motion": "tumbling",
    }
