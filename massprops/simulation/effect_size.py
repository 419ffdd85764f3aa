"""Effects in a simulation: which were asked for, how large they are, and how a body of a rendered scenario then moves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from massprops.documents.fields import no_key
from massprops.documents.limits import excerpt
from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.rotation import trajectory
from massprops.dynamics.translation import path
from massprops.effects import changes_motion, effects
from massprops.errors import InputError
from massprops.model import Model, lacks, load_model, model_of
from massprops.model.linearise import Predicted, predict
from massprops.model.measurements import Measurements, measurements_of
from massprops.model.problem import Problem
from massprops.model.state import BatchState
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.track_view import blank_problem, pixels


def asked_for(
    s: TrackScenario, problem: Problem, environment: EnvironmentModel
) -> tuple[dict[str, np.ndarray | None], dict[str, float]]:
    """The effects asked for: parameters where they are given, pixels where they are to be drawn."""
    known = effects()
    there = available_needs(problem, environment, s.range_sigma_m > 0, s.assumed)
    sizes: dict[str, np.ndarray | None] = {}
    moves: dict[str, float] = {}
    for text in s.effects:
        name, _, size = text.partition(":")
        if name not in known:
            raise InputError(f"{no_key(name, known, 'effect')}; 'massprops effects' lists them")
        missing = lacks(known[name], there)
        if missing:
            raise InputError(
                f"effect {name} {missing}, which this scenario does not have: add it, or leave the effect out"
            )
        sizes[name], moves[name] = None, 6.0
        try:
            if "=" in size:
                given = {k.strip(): float(v) for k, v in (part.split("=") for part in size.split(","))}
                names = [q.name for q in known[name].PARAMETERS]
                if set(given) - set(names):
                    raise InputError(f"effect {excerpt(text)}: no such parameter; {name} has {', '.join(names)}")
                sizes[name] = np.array([given.get(n, 0.0) for n in names])
            elif size:
                moves[name] = float(size)
        except ValueError:
            raise InputError(f"effect {excerpt(text)}: give NAME:PIXELS or NAME:parameter=value,...") from None
        if not 0 < moves[name] <= 1000:
            raise InputError(f"effect {excerpt(text)}: give a number of pixels above 0 and at most 1000")
    return sizes, moves


def drawn_effects(
    s: TrackScenario,
    problem: Problem,
    state: BatchState,
    environment: EnvironmentModel,
    view: Measurements,
    clean: Predicted,
    rng: np.random.Generator,
) -> dict[str, np.ndarray]:
    """Parameters of the effects asked for: as given, or as large as moves the tracks so far from their clean places."""
    given, moves = asked_for(s, problem, environment)
    return {
        name: value if value is not None else sized(name, moves[name], problem, state, environment, view, clean, rng)
        for name, value in given.items()
    }


def available_needs(problem: Problem, environment: EnvironmentModel, ranged: bool, assumed: bool) -> set[str]:
    """What of an effect's needs is there."""
    there = set(environment.known)
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
    environment: EnvironmentModel,
    view: Measurements,
    clean: Predicted,
    rng: np.random.Generator,
) -> np.ndarray:
    """Parameters in a drawn direction, as large as moves the tracks by `target` px rms from their clean places."""
    base = pixels(problem, clean, view)
    parameters = effects()[name].PARAMETERS
    span = float(problem.times[-1])
    draws = np.array([0.0 if q.kind == "duration" else rng.standard_normal() for q in parameters])
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
            elif q.kind == "direction":
                values.append(v)
            elif q.kind == "duration":
                values.append(0.0)
            elif q.kind == "pace":
                # a rate, not a size: near the body's own, where friction is strongest
                values.append(float(np.linalg.norm(state.w0)) * (0.3 + v / q.size))
            else:
                values.append(0.0 if q.form else scale * v)
        return np.array(values)

    def rms(scale: float) -> float:
        try:
            moved = predict(problem, replace(state, model=model_of({name: at(scale)})), environment)
            off = pixels(problem, moved, view) - base
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


def effects_model(
    texts: tuple[str, ...],
    model_file: Any,
    times: np.ndarray,
    state: BatchState,
    focal_px: float,
    environment: EnvironmentModel,
    seed: int,
) -> Model:
    """The model of `--effects` and `--model` for rendering; sizes in pixels are of points at the body's half length.

    Raises:
        InputError: an unknown effect, one that needs surroundings, or one of the sensors (those act on tracks only).
    """
    if model_file is not None:
        model = load_model(model_file)
        _only_motion(model.names)
        return model
    scenario = TrackScenario(
        frames=len(times), features=len(state.points), baseline_m=0.0, focal_px=focal_px, effects=texts, orbit=False,
        sun=False, field=False, seed=seed,
    )  # fmt: skip
    problem = blank_problem(scenario, times)
    _only_motion([t.partition(":")[0] for t in texts])
    view = measurements_of(problem, observed=np.ones(problem.uv.shape[:3], bool))
    base = predict(problem, state, environment)
    return model_of(
        {**drawn_effects(scenario, problem, state, environment, view, base, np.random.default_rng([seed, 14]))}
    )


def _only_motion(names: Any) -> None:
    known = effects()
    for name in names:
        if name in known and not changes_motion(known[name]):
            raise InputError(
                f"effect {name} acts on the sensors: simulate it on tracks, 'massprops simulate tracks --effects {name}'"
            )


def moved_by(
    times: np.ndarray, state: BatchState, model: Model, environment: EnvironmentModel
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q (n, 4), w (n, 3) and position (n, 3) of the centre of mass under the model."""
    active, p = model.active, model.flat(True)
    moved = trajectory(times, state.q0, state.w0, state.inertia, active, p, environment)
    r, _, _, _ = path(times, state.r0, state.v0, active, p, environment)
    return moved.q, moved.w, r
