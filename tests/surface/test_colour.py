"""The photographs' colours on a mesh."""

from __future__ import annotations

import numpy as np
import trimesh
from synthetic_dense import cameras, sphere_directions

from massprops.geometry.rasterise import rasterise
from massprops.surface.colour import vertex_colours


def test_each_side_gets_its_own_colour_and_hidden_ones_their_neighbours() -> None:
    ball = trimesh.creation.icosphere(4, 1.0)
    views = cameras(sphere_directions(24), 6.0, 300.0)
    up = views.centres[:, 2] > 1.0
    views = views.take(up)
    paint = np.where(ball.triangles_center[:, :1] > 0, [40, 40, 200], [40, 180, 40]).astype(np.uint8)

    def image(i: int) -> np.ndarray:
        face = rasterise(ball.vertices, ball.faces, views.K[i], views.R[i], views.t[i], (320, 240))[1]
        return np.where((face >= 0)[..., None], paint[face], 0).astype(np.uint8)

    rgb, seen = vertex_colours(np.asarray(ball.vertices), np.asarray(ball.faces), views, image)
    x, z = ball.vertices[:, 0], ball.vertices[:, 2]
    assert seen[z > 0.2].all() and not seen[z < -0.9].any()
    for side, wanted in ((x > 0.2, [200, 40, 40]), (x < -0.2, [40, 180, 40])):
        assert np.abs(rgb[side & seen].astype(int) - wanted).max(1).mean() < 12
        assert np.abs(rgb[side & ~seen].astype(int) - wanted).max(1).mean() < 40
