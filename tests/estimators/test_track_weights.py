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
    weight, _ = track_weights(residual, feature)
    assert (weight[feature < 7 * 12] == 0).mean() > 0.7
    assert (weight[feature >= 7 * 12] == 1).mean() > 0.95


def test_noise_takes_no_weight_however_large():
    for scale in (0.5, 1.0, 5.0):
        assert (track_weights(*tracks(0, scale))[0] == 1).mean() > 0.98


def test_all_observations_of_a_track_have_one_weight():
    residual, feature = tracks(12)
    weight, _ = track_weights(residual, feature)
    assert all(len(set(weight[feature == f])) == 1 for f in np.unique(feature))
    assert all(len(x) == 0 for x in track_weights(np.zeros((0, 2)), np.zeros(0, int)))


def test_at_the_gate_a_track_has_the_squares_that_are_said() -> None:
    residual, feature = tracks(1)
    own = feature == 0
    _, most = track_weights(residual, feature)
    size = np.sqrt(most[own][0] / np.sum(residual[own] ** 2))
    for factor, kept in ((0.99, True), (1.01, False)):
        residual, _ = tracks(1)
        residual[own] *= factor * size
        assert (track_weights(residual, feature)[0][own] > 0).all() == kept
