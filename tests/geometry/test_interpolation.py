"""Values between samples, against the formulas they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from massprops.geometry.interpolation import bilinear, peak


@pytest.mark.parametrize("channels", [(), (3,)])
def test_a_plane_of_brightness_is_itself_between_pixels(channels):
    """40 000 places at once too: OpenCV alone takes fewer rows."""
    rng = np.random.default_rng(2)
    v, u = np.mgrid[:60, :80]
    image = (1.0 * u + 2.0 * v).astype(np.float32)
    image = np.stack([image] * 3, axis=-1) if channels else image
    uv = rng.uniform((0, 0), (79, 59), (40_000, 2))
    value = bilinear(image, uv)
    assert value.shape == (40_000, *channels)
    # OpenCV weights pixels in steps of 1/32
    np.testing.assert_allclose(value.T, np.broadcast_to(uv @ (1.0, 2.0), value.T.shape), atol=0.05)


def test_the_peak_of_a_parabola_is_found():
    at = np.array([-0.5, -0.2, 0.0, 0.37, 0.5])
    left, middle, right = (3.0 - 2.0 * (x - at) ** 2 for x in (-1.0, 0.0, 1.0))
    np.testing.assert_allclose(peak(left, middle, right), at, atol=1e-15)


def test_three_like_samples_have_their_peak_at_the_middle():
    assert peak(np.float32(0.4), np.float32(0.4), np.float32(0.4)) == 0.0
