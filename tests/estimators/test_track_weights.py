"""Tracks that slide as a whole lose their weight; noise, and errors that all share, take none."""

from __future__ import annotations

import numpy as np

from massprops.estimators.batch.track_weights import track_weights


def tracks(sliding: int, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (o, 2) and features (o,) of 60 tracks of 4 to 20 observations, the first of which slide by 4 sigma."""
    rng = np.random.default_rng(4)
    feature = np.repeat(np.arange(60) * 7, rng.integers(4, 21, 60))
    residual = rng.standard_normal((len(feature), 2))
    slides = feature < 7 * sliding
    phase = np.arange(len(feature))[:, None] * [0.7, 0.5]
    residual[slides] += 4.0 * np.sin(phase)[slides]
    return scale * residual, feature


def test_tracks_that_slide_do_not_count():
    residual, feature = tracks(12)
    weight = track_weights(residual, feature)
    assert (weight[feature < 7 * 12] == 0).mean() > 0.7
    assert (weight[feature >= 7 * 12] == 1).mean() > 0.95


def test_noise_takes_no_weight_however_large():
    for scale in (0.5, 1.0, 5.0):
        assert (track_weights(*tracks(0, scale)) == 1).mean() > 0.98


def test_all_observations_of_a_track_have_one_weight():
    residual, feature = tracks(12)
    weight = track_weights(residual, feature)
    assert all(len(set(weight[feature == f])) == 1 for f in np.unique(feature))
    assert len(track_weights(np.zeros((0, 2)), np.zeros(0, int))) == 0
