"""The noise of tracks that state none."""

from __future__ import annotations

import numpy as np
import pytest

from massprops.diagnosis.search.noise import track_noise


@pytest.mark.parametrize("turn_deg", [1.0, 6.0])
@pytest.mark.parametrize("sigma", [0.1, 0.5])
def test_the_noise_of_circling_points_is_found(turn_deg: float, sigma: float) -> None:
    rng = np.random.default_rng(1)
    angle = np.radians(turn_deg) * np.arange(300)[:, None] + rng.uniform(0, 6, 12)
    uv = 150.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1) + sigma * rng.standard_normal((300, 12, 2))
    uv[rng.random((300, 12)) < 0.05] = np.nan
    uv[rng.random((300, 12)) < 0.005] += 40.0
    assert track_noise(uv) == pytest.approx(sigma, rel=0.12)


def test_motion_too_fast_for_its_frames_hides_the_noise() -> None:
    angle = 1.5 * np.arange(300)[:, None] + np.arange(5)
    uv = 150.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    assert track_noise(uv + 0.3 * np.random.default_rng(0).standard_normal(uv.shape)) is None
