"""A gyroscope so noisy that the path integrated from it errs by more than a rate does."""

from __future__ import annotations

import numpy as np
import pytest

from massprops.diagnosis.candidate import within_noise
from massprops.diagnosis.conserved_start import Start
from massprops.diagnosis.effect_search import again, best_fit
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import fit_hypothesis
from massprops.diagnosis.record import Record, record_of_rates
from massprops.diagnosis.unnamed import without_effects
from massprops.dynamics.environment import EnvironmentModel
from massprops.dynamics.rotation import trajectory
from massprops.effects import effects
from massprops.model import Model
from massprops.sequence.data import Environment, RateSeries

INERTIA = np.diag([0.7, 1.0, 1.3])
DRAG = np.array([0.04, 0.02, 0.05])
SIGMA = 0.05


def seen(drag: np.ndarray, seed: int) -> Record:
    """Two seconds at 12 rad/s and 100 Hz."""
    times = np.arange(0.0, 2.0, 0.01)
    model = Model((effects()["drag-by-axis"],), (drag,))
    moved = trajectory(
        times, np.array([1.0, 0, 0, 0]), np.array([7.0, -6.0, 8.0]), INERTIA, model.active, drag, EnvironmentModel(Environment())
    )  # fmt: skip
    noisy = moved.w + SIGMA * np.random.default_rng(seed).standard_normal(moved.w.shape)
    return record_of_rates(RateSeries(np.round(times * 1e9).astype(np.int64), noisy, SIGMA))


@pytest.mark.parametrize("seed", range(4))
def test_drag_needs_no_unknown_torque_beside_it(seed: int) -> None:
    record = seen(DRAG, seed)
    base, unknown = without_effects(record)
    alone = best_fit(record, effects()["drag-by-axis"], base)
    assert alone is not None and within_noise(alone) and not within_noise(base)
    beside = fit_hypothesis(record, Hypothesis(terms=alone.hypothesis.terms), again(alone))
    assert alone.evidence > beside.evidence - 3.0 and alone.evidence > unknown.evidence + 3.0


@pytest.mark.parametrize("seed", range(4))
def test_a_free_body_leaves_the_noise(seed: int) -> None:
    fit = fit_hypothesis(seen(0.0 * DRAG, seed), Hypothesis(latent=False), Start(inertia=np.eye(3), left=1.0))
    assert within_noise(fit)
