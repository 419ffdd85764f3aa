"""Effects in a rendered scenario: how the body then moves."""

from __future__ import annotations

from typing import Any

import numpy as np

from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.rotation import trajectory
from massprops.dynamics.translation import path
from massprops.effects import changes_motion, effects
from massprops.errors import InputError
from massprops.model import Model, load_model, model_of
from massprops.model.linearise import predict
from massprops.model.measurements import measurements_of
from massprops.model.state import BatchState
from massprops.simulation.effect_size import asked_for, sized
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.track_view import blank_problem


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
    values, pixels = asked_for(scenario, problem, environment)
    observed = np.ones(problem.uv.shape[:3], bool)
    view = measurements_of(problem, observed=observed)
    base = predict(problem, state, environment)
    rng = np.random.default_rng([seed, 14])
    whole = {
        name: value if value is not None else sized(name, pixels[name], problem, state, environment, view, base, rng)
        for name, value in values.items()
    }
    return model_of(dict(whole))


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
