"""Pieces off the body that silhouettes of a few images take in."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from massprops.geometry import vectors
from massprops.geometry.rasterise import silhouette
from massprops.surface.standing_off import standing_off
from massprops.views import Views

K = np.array([[300.0, 0, 160], [0, 300.0, 120], [0, 0, 1]])


def looking(from_: list[list[float]]) -> Views:
    """Cameras at places (n, 3) that look at the origin."""
    turns = []
    for place in np.array(from_):
        z = -vectors.unit(place)
        x = vectors.unit(np.cross(z, np.eye(3)[np.argmin(np.abs(z))]))
        turns.append(np.stack([x, np.cross(z, x), z]))
    R = np.array(turns)
    n = len(R)
    return Views(
        tuple(f"{i}.png" for i in range(n)), np.full(n, -1), np.tile([320, 240], (n, 1)), np.tile(K, (n, 1, 1)),
        np.zeros((n, 4)), R, -np.einsum("nij,nj->ni", R, np.array(from_)),
    )  # fmt: skip


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
    above = [[0.1 * k, 0.0, 5.0] for k in range(from_above)]
    views = looking(above + [[5.0 * np.cos(a), 5.0 * np.sin(a), 0.5] for a in np.arange(8 - from_above)])
    masks = [
        np.uint8(255) * silhouette(vertices, faces, K, views.R[i], views.t[i], (320, 240)) for i in range(len(views))
    ]
    found = standing_off(vertices, faces, fixed, views, masks)
    np.testing.assert_array_equal(found, spot & dropped)
    assert not standing_off(vertices, faces, fixed & ~spot, views, masks).any()
