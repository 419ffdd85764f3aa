"""Of a film in which near is taken for far from some image on, the run that one free motion explains is found."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_free_motion import tumbling

from massprops.sfm.free_motion import FreeRotation, Piece, fit_rotation
from massprops.sfm.free_run import longest_free_run
from massprops.sfm.reversed_depth import MIRROR
from massprops.sfm.steady import largest_jump

MOST = np.deg2rad(1.0)


def piece(R, noise_deg=0.1, seed=0):
    wrong = Rotation.from_rotvec(np.deg2rad(noise_deg) * np.random.default_rng(seed).standard_normal((len(R), 3)))
    return Piece(np.arange(len(R), dtype=float), wrong.as_matrix() @ R, np.tile([0.0, 0.0, 12.0], (len(R), 1)))


def turned_back(R, at, smooth=8):
    """Attitudes whose first `at` are those of the body mirrored in depth; it slows down to them over some images."""
    out = R.copy()
    S = R[at].T @ MIRROR @ R[at]
    out[:at] = MIRROR @ R[:at] @ S
    # the adjustment spreads the change of the rate over several images
    steps = Rotation.from_matrix(out[1:] @ out[:-1].transpose(0, 2, 1)).as_rotvec()
    kernel = np.ones(smooth) / smooth
    wide = np.pad(steps, ((smooth, smooth), (0, 0)), mode="edge")
    steps = np.stack([np.convolve(wide[:, a], kernel, "same")[smooth:-smooth] for a in range(3)], axis=1)
    steps[at + smooth :] = Rotation.from_matrix(
        R[at + smooth + 1 :] @ R[at + smooth : -1].transpose(0, 2, 1)
    ).as_rotvec()
    for i in range(at + smooth, -1, -1):
        out[i] = Rotation.from_rotvec(-steps[i]).as_matrix() @ out[i + 1]
    return out


def test_a_film_that_turns_back_is_followed_on_its_longer_side():
    own = piece(turned_back(tumbling(80, 5.0), 25))
    assert largest_jump(own.R, own.times) < 1.0
    assert not fit_rotation([own], robust=True).rms < MOST
    run = longest_free_run(own, MOST)
    assert np.array_equal(run, np.arange(run[0], 80))
    assert 20 <= run[0] <= 35


@pytest.mark.parametrize("lost", [(), (3, 30, 31)])
def test_all_of_a_free_motion_is_one_run(lost):
    own = piece(tumbling(60, 5.0))
    kept = np.setdiff1d(np.arange(60), lost)
    run = longest_free_run(Piece(own.times[kept], own.R[kept], own.t[kept]), MOST)
    assert np.array_equal(run, np.arange(len(kept)))


def test_few_images_and_noise_are_no_run():
    assert not len(longest_free_run(piece(tumbling(7, 5.0)), MOST))
    assert not len(longest_free_run(piece(Rotation.random(40, random_state=1).as_matrix()), MOST))


def test_images_to_which_no_motion_can_be_followed_are_no_part_of_a_run(monkeypatch):
    """An inertia far from all that bodies have takes no integration step."""
    own, attitudes = piece(tumbling(40, 5.0)), FreeRotation.attitudes

    def up_to_30(self, times, change=None):
        out = attitudes(self, times, change)
        if change is None:  # as asked of a motion that was found
            out[:, np.asarray(times) > 30] = np.nan
        return out

    monkeypatch.setattr(FreeRotation, "attitudes", up_to_30)
    run = longest_free_run(own, MOST)
    assert len(run) >= 8
    assert run.max() <= 30
