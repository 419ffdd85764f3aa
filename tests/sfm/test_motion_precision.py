"""What a film's motion is known to: the seven numbers that no film shows are taken out, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sfm.test_sound import to_model
from test_along_motion import apart, tumble
from test_free_motion import INERTIA, tumbling
from test_joined_pieces import filmed

from massprops.mass.ratio_space import log_components
from massprops.sfm.along_motion import follow_free_motion, refine_along
from massprops.sfm.free_adjustment import MotionSystem, State, fit_line
from massprops.sfm.free_motion import FreeRotation
from massprops.sfm.motion_precision import UNSEEN, inverse_but_for, tumble_precision, unseen


def test_what_no_film_shows_leaves_every_image_as_it_is():
    found, views, points = tumble()
    ways = unseen(found, 20)
    assert np.linalg.matrix_rank(ways) == UNSEEN
    for k in range(UNSEEN):
        step = 1e-5 * ways[:, k]
        R, t = found.changed(step).poses(np.arange(0, 20, 3.0))
        # the body's points follow: turned, shifted or made larger with its axes
        turn = Rotation.from_rotvec(1e-5 * np.eye(3)[k]).as_matrix() if k < 3 else np.eye(3)
        shift = 1e-5 * np.eye(3)[k - 3] if 3 <= k < 6 else np.zeros(3)
        xyz = (points.xyz @ turn.T + shift) * (1 + 1e-5 * (k == 6))
        before = np.einsum("nij,pj->npi", views.R, points.xyz) + found.poses(np.arange(0, 20, 3.0))[1][:, None]
        after = np.einsum("nij,pj->npi", R, xyz) + t[:, None]
        np.testing.assert_allclose(after[..., :2] / after[..., 2:], before[..., :2] / before[..., 2:], atol=1e-8)


def test_nothing_that_a_film_shows_faintly_is_taken_for_that():
    found, views, points = tumble()
    system = MotionSystem(views, points, np.arange(0, 20, 3.0), 1.0, True)
    linear = system.linear(State(found, 0.0, points.xyz))
    normal = linear.columns.T @ linear.system.normal @ linear.columns
    free = unseen(found, len(normal))
    inverse = inverse_but_for(normal, free, float(np.linalg.norm(found.place)))
    size = 1 / np.sqrt(np.diag(normal) + 1e-9 * np.diag(normal).max())
    assert np.linalg.matrix_rank(inverse / size[:, None] / size, tol=1e-9) == len(normal) - UNSEEN
    np.testing.assert_allclose(normal @ inverse @ normal, normal, rtol=1e-4, atol=1e-6 * np.abs(normal).max())


@pytest.mark.parametrize("wobble", [0.0, 1e-9, 1e-6, 1e-5, 1e-3])
def test_a_body_that_spins_about_one_axis_shows_no_ratio_and_no_error(wobble):
    """Of a body in foil all images were placed within 0.4 degrees, and its covariance was less than nothing by rounding."""
    times, inertia = np.arange(0, 20.0), np.array([0.5, 0.3, 0.0, 0.0, 0.0])
    turning = FreeRotation(tumbling()[3], np.array([wobble, 0.1, 0.0]), inertia, 0.0, 1.0)
    views, points = filmed(list(range(20)), turning.attitudes(times)[0])
    found = fit_line(turning, times, views.t, 0.2)
    R, t = found.poses(times)
    model, clock = to_model(replace(views, R=R, t=t), points), dict(zip(views.names, times, strict=True))
    precision = tumble_precision(model, found, clock.__getitem__, 1.0, True, views.names)
    assert np.all(precision.attitude > 0) and precision.attitude.max() < 1e-3
    spread = np.linalg.eigvalsh(precision.shown.covariance)
    assert spread[0] > -1e-12 * spread[-1] and spread[-1] > 1e3


def test_the_inertia_is_within_what_is_stated(tmp_path):
    model, given, truth = apart(tmp_path, tumbling())
    model, following = follow_free_motion(model, given)
    shown = refine_along(model, following, given.options.refine, True).precision.shown
    from massprops.sfm.convert import to_views

    views, _ = to_views(model)
    turn = Rotation.from_matrix(views.R.transpose(0, 2, 1) @ truth.R).mean().as_matrix()
    axes = turn @ np.eye(3)
    error = log_components(shown.inertia, axes)[:2] - log_components(turn @ INERTIA @ turn.T, axes)[:2]
    assert np.abs(error).max() < 0.1
    assert np.all(np.linalg.eigvalsh(shown.covariance) > 0)
    assert np.abs(error).max() < 4 * np.sqrt(np.linalg.eigvalsh(shown.covariance)[-1])
