"""Principal axes matched wrongly with those of `body.yaml`, as what the model lacks can do, are matched otherwise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprops.diagnosis.search.axes import OTHERWISE, otherwise
from massprops.diagnosis.search.case import case_of
from massprops.diagnosis.search.refit import refit
from massprops.dynamics.quaternion import from_rotation_vector, rotation_matrix
from massprops.model.linearise import predict, residuals
from massprops.model.problem import problem_of
from massprops.model.state import in_axes
from massprops.simulation.track_scenario import TrackScenario
from massprops.simulation.tracks import simulate_tracks


@pytest.fixture(scope="module")
def free():
    """A free body's record, and its base model."""
    case = case_of(problem_of(simulate_tracks(TrackScenario(frames=120, features=8, seed=4, rate_deg=4.0)).sequence))
    return case, refit(case, case.first.state, (), most=40)


def test_other_body_axes_leave_the_motion_as_it_is(free) -> None:
    case, base = free
    T = rotation_matrix(from_rotation_vector(np.array([0.4, -1.1, 0.7])))
    turned = in_axes(base.fit.state, T)
    left = residuals(case.problem, case.fitted, predict(case.problem, turned, case.environment))
    assert np.abs(turned.w0 - base.fit.state.w0).max() > 0.01
    assert np.allclose(left.tracks, base.fit.residuals.tracks, atol=1e-6)


@pytest.mark.parametrize("which", range(len(OTHERWISE)))
def test_axes_in_a_wrong_order_are_put_right(free, which: int) -> None:
    case, base = free
    assert case.first.body_frame == "body.yaml"
    _, own = np.linalg.eigh(base.fit.state.inertia)
    begun = in_axes(base.fit.state, own @ np.array(OTHERWISE[which], float) @ own.T)
    firm = replace(case, inertia_prior=replace(case.inertia_prior, sigma=1e-3 * case.inertia_prior.sigma))
    wrong = refit(firm, replace(begun, inertia=case.inertia_prior.inertia), (), most=0)
    assert wrong.fitted > 2.0
    assert otherwise(case, wrong).bic < base.bic + 0.1
