"""A body on a table: what the cameras above cannot see below the plane is not filled in."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from massprops.surface.reconstruct import HOLLOW, _hollow
from massprops.surface.refine import without_islands
from massprops.surface.silhouette import make_hull
from massprops.views import Views


def test_hull_ends_at_the_support() -> None:
    n, size, focal = 12, 120, 150.0
    turn = np.linspace(0, 2 * np.pi, n, endpoint=False)
    centres = np.column_stack([3 * np.cos(turn), 3 * np.sin(turn), np.full(n, 2.0)])
    R = []
    for c in centres:
        z = -c / np.linalg.norm(c)
        x = np.cross(z, [0, 0, 1.0])
        x /= np.linalg.norm(x)
        R.append(np.stack([x, np.cross(z, x), z]))
    R = np.stack(R)
    K = np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1.0]])
    views = Views(
        tuple(str(i) for i in range(n)), np.full(n, -1), np.full((n, 2), size), np.tile(K, (n, 1, 1)), np.zeros((n, 4)), R,
        -np.einsum("nij,nj->ni", R, centres),
    )  # fmt: skip
    v, u = np.mgrid[0:size, 0:size]
    masks = [np.where((u - 60) ** 2 + (v - 60) ** 2 < 25**2, 255, 0).astype(np.uint8)] * n
    measured = np.random.default_rng(0).normal(size=(500, 3))
    measured *= 0.4 / np.linalg.norm(measured, axis=1, keepdims=True)
    free = make_hull(views, masks, measured)
    standing = make_hull(views, masks, measured, support=np.array([0, 0, 1.0, 0.2]))
    inside, below = np.array([[0, 0, 0.0]]), np.array([[0, 0, -0.35]])
    assert free.value(inside) < 0 and free.value(below) < 0
    assert standing.value(inside) < 0 < standing.value(below)


@pytest.mark.parametrize(("support", "depth"), [(None, 2 / 3), ((0.0, 0.0, 1.0, 2.0), 0.0)])
def test_fill_that_hangs_over_a_support_is_a_film(support: tuple[float, ...] | None, depth: float) -> None:
    """Below a seat the hull ends in a cone as steep as the cameras looked; the side walls keep theirs."""
    plate = trimesh.creation.cylinder(radius=1.0, height=0.4, sections=24).subdivide()
    vertices, faces = np.array(plate.vertices), np.array(plate.faces)
    below = np.isclose(vertices[:, 2], -0.2) & (np.hypot(vertices[:, 0], vertices[:, 1]) < 0.99)
    vertices[below, 2] -= 0.9 * (1 - np.hypot(vertices[below, 0], vertices[below, 1]))
    deepest = int(np.argmin(vertices[:, 2]))
    found = _hollow(vertices, faces, ~below, None if support is None else np.array(support), HOLLOW)
    assert found[deepest, 2] == pytest.approx(-0.2 - depth * 0.9, abs=0.02)
    assert np.array_equal(found[~below], vertices[~below])


def test_walls_below_an_overhang_go_with_the_film_that_spans_them() -> None:
    """A cut leaves a block below the middle of a seat: its walls look sideways, its film looks down."""
    seat = trimesh.creation.box((2.0, 2.0, 0.2)).subdivide().subdivide().subdivide().subdivide()
    vertices, faces = np.array(seat.vertices), np.array(seat.faces)
    below = np.isclose(vertices[:, 2], -0.1) & (np.abs(vertices[:, :2]).max(axis=1) < 0.99)
    block = below & (np.abs(vertices[:, :2]).max(axis=1) < 0.55)
    vertices[block, 2] -= 0.8
    found = _hollow(vertices, faces, ~below, np.array([0.0, 0.0, 1.0, 2.0]), HOLLOW)
    np.testing.assert_allclose(found[below, 2], -0.1, atol=0.02)


def test_a_film_that_dents_a_wall_goes_its_share_of_the_way() -> None:
    """A jug's plain wall, of which rims alone were measured: the film between them is as thin as an hourglass, and looks down where it widens."""
    side = np.column_stack([np.ones(41), np.linspace(-1, 1, 41)])
    jug = trimesh.creation.revolve(np.concatenate([[[0, -1]], side, [[0, 1]]]), sections=16)
    vertices, faces = np.array(jug.vertices), np.array(jug.faces)
    wall = np.abs(vertices[:, 2]) < 0.9
    found = _hollow(vertices, faces, ~wall, np.array([0.0, 0.0, 1.0, 2.0]), 0.5)
    film = _hollow(vertices, faces, ~wall, None, 1.0)
    np.testing.assert_allclose(found[wall], 0.5 * (vertices + film)[wall], atol=1e-9)
    assert np.hypot(*film[wall][:, :2].T).min() < 0.7


def test_groups_of_a_few_are_told() -> None:
    plate = trimesh.creation.box((2.0, 2.0, 0.2)).subdivide().subdivide().subdivide()
    vertices, faces = np.array(plate.vertices), np.array(plate.faces)
    fixed = vertices[:, 2] > -0.09
    single = int(np.argmin(np.linalg.norm(vertices - (0.0, 0.0, -0.1), axis=1)))
    fixed[single] = True
    held = without_islands(faces, fixed, 10)
    assert not held[single] and np.array_equal(np.flatnonzero(held), np.flatnonzero(vertices[:, 2] > -0.09))
    assert without_islands(faces, fixed, 1)[single]
    assert not without_islands(faces, np.zeros(len(vertices), bool), 1).any()
