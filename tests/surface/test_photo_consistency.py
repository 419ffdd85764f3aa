"""What one placement's photographs show where the points of another would lie."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from synthetic_dense import cameras, observe

from massprops.dynamics.quaternion import rotation_matrix
from massprops.geometry.rasterise import rasterise
from massprops.surface.answers import Answer, PlacementPair
from massprops.surface.paint import overlap
from massprops.surface.photo_consistency import Photographs, photographs
from massprops.surface.placed import Placed, placed
from massprops.surface.registration import _registration

SIZE = (320, 240)
TURNED = rotation_matrix(np.array([0.05, 0.99, 0.1, 0.05]) / np.linalg.norm([0.05, 0.99, 0.1, 0.05]))
WAVES = np.array([[9.0, 4, 3], [-5, 8, 6], [3, -6, 10]])


def painted(local: np.ndarray) -> np.ndarray:
    """(n, 3) colours of places on the body, the same nowhere else."""
    return 128 + 80 * np.sin(local @ WAVES.T + [0.3, 1.1, 2.0])


def side(turn: np.ndarray, seed: int, top_only: bool = False) -> Placed:
    """A block as cameras above it see it; top_only: stereo measures its upper side alone."""
    rng = np.random.default_rng(seed)
    mesh = trimesh.creation.box((1.6, 1.0, 0.5)).subdivide().subdivide().subdivide()
    body = np.asarray(mesh.vertices)
    mesh.vertices = body @ turn.T
    a = np.arange(10) * 0.95
    views = cameras(np.column_stack([np.cos(a), np.sin(a), rng.uniform(0.2, 1.0, 10)]), 8.0, 900.0, SIZE)
    cloud, masks = observe(mesh, views, 0.002, seed)
    cloud = cloud.take(np.arange(0, len(cloud), 5))
    if top_only:
        cloud = cloud.take(np.flatnonzero(cloud.normal[:, 2] > 0.9))
    vertices, faces, images = np.asarray(mesh.vertices), np.asarray(mesh.faces), []
    for i in range(len(views)):
        K, R, t = views.K[i], views.R[i], views.t[i]
        depth, face = rasterise(vertices, faces, K, R, t, SIZE)
        v, u = np.nonzero(face >= 0)
        ray = np.column_stack([u, v, np.ones(len(u))]) @ np.linalg.inv(K).T
        image = np.zeros((*SIZE[::-1], 3), np.uint8)
        image[v, u] = painted(((ray * depth[v, u, None] - t) @ R) @ turn)
        images.append(image)
    colour = painted(cloud.xyz @ turn)
    support = np.array([0.0, 0, 1, -vertices[:, 2].min()])
    found = placed(cloud, colour, views, masks, vertices, np.zeros(3), support, seed)
    return replace(found, photographs=photographs(views, images, masks, vertices, faces))


@pytest.fixture(scope="module")
def upright() -> Placed:
    return side(np.eye(3), 1)


def test_points_have_their_own_paint_where_the_right_turn_carries_them(upright: Placed) -> None:
    other = side(TURNED, 2)
    shown = other.photographs
    assert isinstance(shown, Photographs) and upright.photographs is not None
    own = upright.photographs.vertices, upright.photographs.faces
    half = np.diag([-1.0, -1.0, 1.0])
    for turn, right in ((TURNED, True), (TURNED @ half, False)):
        colour, known = shown.paint(upright.cloud, *own, turn, np.zeros(3))
        away = np.abs(colour - upright.colour)[known].mean()
        assert known.sum() > 300 and (away < 12) == right, (right, away)
    # its upper side lies below there
    top = upright.cloud.normal[:, 2] > 0.9
    assert shown.paint(upright.cloud, *own, TURNED, np.zeros(3))[1][top].mean() < 0.02


def test_photographs_decide_where_stereo_measured_nothing_in_common(upright: Placed) -> None:
    """Of the block turned over only its upper face was measured, which the first placement does not show."""
    both = PlacementPair(upright, side(TURNED, 2, top_only=True), np.random.default_rng(0))
    half = np.diag([-1.0, -1.0, 1.0])
    answers = [Answer(turn @ TURNED.T, np.zeros(3), outside) for turn, outside in ((half, 0.4), (np.eye(3), 0.5))]
    assert not any(both.colour(a.R, a.t) for a in answers)
    found = _registration(both, [both.by_photographs(a) for a in answers])
    assert found.painted and found.colour > 0.3 and np.allclose(found.R, TURNED.T)
    assert overlap(both.first, both.second, found.R, found.t) < 0.3
