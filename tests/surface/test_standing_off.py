"""Pieces off the body that silhouettes of a few images take in."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from synthetic_dense import cameras

from massprops.surface.standing_off import standing_off


@pytest.mark.parametrize(
    ("below", "away", "from_above", "dropped"),
    [(-0.99, 0.3, 6, True), (-0.99, 0.3, 2, False), (-0.8, 0.3, 6, False), (-0.99, -1.2, 6, False)],
)
def test_what_few_images_show_beside_the_body_is_none_of_it(
    below: float, away: float, from_above: int, dropped: bool
) -> None:
    """A ball of which all but the lower side was measured, and of that a spot below it; a foot, where most images show it beside the ball;
    a hollow, where it lies within."""
    ball = trimesh.creation.icosphere(4)
    vertices, faces = np.array(ball.vertices), np.asarray(ball.faces)
    spot = vertices[:, 2] < below
    fixed = (vertices[:, 2] > -0.6) | spot
    vertices[spot, 2] -= away
    above = [[0.02 * k, 0.0, 1.0] for k in range(from_above)]
    round_about = [[np.cos(a), np.sin(a), 0.1] for a in np.arange(8 - from_above)]
    views = cameras(np.array(above + round_about), 5.0, 300.0)
    found = standing_off(vertices, faces, fixed, views)
    np.testing.assert_array_equal(found, spot & dropped)
    assert not standing_off(vertices, faces, fixed & ~spot, views).any()
