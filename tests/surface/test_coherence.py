"""Whether the silhouettes of two placements can be those of one body."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from synthetic_dense import cameras

from massprops.dynamics.quaternion import rotation_matrix
from massprops.geometry.rasterise import silhouette
from massprops.surface.coherence import Extent, Pair, Witnesses, extent, moved, rim_rays
from massprops.surface.silhouette import make_hull

TURN = rotation_matrix(np.array([0.1, 0.9, 0.3, 0.2]) / np.linalg.norm([0.1, 0.9, 0.3, 0.2]))
SHIFT = np.array([0.05, -0.1, 0.02])


def body() -> trimesh.Trimesh:
    """A plate with a knob: no point of it is measured."""
    knob = trimesh.creation.icosphere(3, 0.35)
    knob.apply_translation([0.5, 0.2, 0.35])
    box = trimesh.creation.box((1.6, 1.0, 0.5))
    return trimesh.convex.convex_hull(np.concatenate([box.vertices, knob.vertices]))


def outlined(mesh: trimesh.Trimesh, seed: int, first: np.ndarray | None = None) -> tuple[Extent, Witnesses]:
    """What the silhouettes from above and the table below say of a body; first (n, 3): its first shape, if not all of it."""
    rng = np.random.default_rng(seed)
    a = np.arange(12) * 0.95
    up = np.column_stack([np.cos(a), np.sin(a), rng.uniform(0.3, 1.5, 12)])
    views = cameras(up, 8.0, 900.0, (320, 240))
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    masks = [
        np.where(silhouette(vertices, faces, views.K[i], views.R[i], views.t[i], (320, 240)), 255, 0).astype(np.uint8)
        for i in range(12)
    ]
    support = np.array([0.0, 0, 1, -vertices[:, 2].min()])
    own = extent(make_hull(views, masks, vertices, support=support), vertices if first is None else first)
    return own, rim_rays(views, masks, own, 300, rng)


@pytest.fixture(scope="module")
def pair() -> Pair:
    """The body, and the same turned over: R x + t carries the second back."""
    second = body()
    second.vertices = (np.asarray(second.vertices) - SHIFT) @ TURN
    (a, rims_a), (b, rims_b) = outlined(body(), 0), outlined(second, 1)
    return Pair(a, b, rims_a, rims_b)


def test_only_the_true_turn_makes_one_body(pair: Pair) -> None:
    half = rotation_matrix(np.array([0.0, 0, 0, 1.0]))
    true, other = pair.scores(np.stack([TURN, half @ TURN]), np.stack([SHIFT, half @ SHIFT]))
    assert true < 0.1 < 1.0 < other, (true, other)
    assert pair.of_first.rim_error(pair.first) < 0.1


def test_a_fit_comes_back_to_the_true_turn(pair: Pair) -> None:
    R, t = moved(TURN, SHIFT, np.zeros(3), np.array([0.15, -0.1, 0.1, 0.05, 0.02, -0.03]))
    before = pair.score(R, t)
    R, t = pair.fitted(R, t, np.zeros(3))
    angle = np.degrees(np.arccos(np.clip((np.trace(R.T @ TURN) - 1) / 2, -1, 1)))
    assert pair.score(R, t) < 0.1 * before and angle < 2.5


def test_the_derivatives_are_those_of_the_distances(pair: Pair) -> None:
    R, t = moved(TURN, SHIFT, np.zeros(3), np.array([0.2, -0.1, 0.1, 0.05, 0.0, 0.0]))
    about, step = np.array([0.1, 0.0, -0.1]), np.array([2.0, -1, 1, 1, 2, -1]) * 1e-5
    value, slope = pair.rows(R, t, about)
    after = pair.rows(*moved(R, t, about, step), about)[0]
    before = pair.rows(*moved(R, t, about, -step), about)[0]
    far = (value > 0.5) & (value < 20)
    assert far.sum() > 50
    # the grid is linear between its nodes: at some of them the slope breaks
    assert np.median(np.abs((after - before) / 2 - slope @ step)[far]) < 0.05 * np.abs(slope @ step)[far].mean()


def test_what_stereo_did_not_measure_has_room(pair: Pair) -> None:
    whole = body()
    part = np.asarray(whole.vertices)[:, None] * [0.3, 1.0, 1.0] - [0.4, 0.0, 0.0]
    own, rims = outlined(whole, 0, part.reshape(-1, 3))
    inner = 0.9 * np.asarray(whole.vertices)
    assert (own.at(inner) < 0).all()
    assert rims.rim_error(own) < 0.2
    assert own.step < 1.5 * pair.first.step
