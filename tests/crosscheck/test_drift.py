"""Where cameras drift, the point that the body turns about is less sure."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from crosscheck.test_jackknife import DISTANCE, FOCAL, tumbling_views

from massprops.consistency.drift import centre_drift
from massprops.consistency.motion_side import centre_of_motion
from massprops.dynamics.quaternion import from_rotation_vector, rotation_matrix


def test_the_centre_errs_by_what_a_drift_is_said_to_do() -> None:
    rng = np.random.default_rng(4)
    views, mesh = tumbling_views(rng), SimpleNamespace(factor=1.0, length=2.0)
    pixels, stamps = 2.0, views.timestamp_ns
    stated = centre_drift(views, stamps, pixels, mesh)  # type: ignore[arg-type]
    share, squares = pixels * DISTANCE / FOCAL, []
    for _ in range(20):
        # of another shape than the drifts that are drawn: a turn that grows with time, and a shift that comes and goes
        time = np.linspace(-1, 1, len(views))[:, None]
        turn = share * np.sqrt(3) * time * rng.choice([-1, 1], 3)
        shift = share * np.sqrt(2) * np.sin(np.pi * time + rng.uniform(0, 6, 3)) * [1, 1, DISTANCE]
        drifted = replace(views, R=rotation_matrix(from_rotation_vector(turn)) @ views.R, t=views.t + shift)
        found = centre_of_motion(stamps, drifted.R, drifted.t, 2.0)
        assert found is not None
        squares.append(found.place @ np.linalg.solve(stated, found.place) / 3)
    assert 0.2 < np.mean(squares) < 4
    assert np.trace(centre_drift(views, stamps, 0.5 * pixels, mesh)) < 0.5 * np.trace(stated)  # type: ignore[arg-type]
