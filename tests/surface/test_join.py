"""Parts that hang by what was not measured stay on the body; specks, and pieces beside a still object, do not."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from synthetic_dense import boxes, cameras, observe, sphere_directions

from massprops.geometry.rasterise import silhouette
from massprops.surface.cut import Costs
from massprops.surface.join import joined, parts
from massprops.surface.reconstruct import Fill, reconstruct_surface
from massprops.surface.tetra import Tetrahedra, tetrahedralise

BUS, ARRAY = ((0.4, 0.4, 0.4), (-0.3, 0, 0)), ((0.3, 0.3, 0.1), (0.2, 0, 0))
"""A tenth of a metre lies between them."""


@pytest.fixture(scope="module")
def seen():
    """Two boxes whose link no image shows, neither as points nor as silhouette."""
    body = boxes(BUS, ARRAY)
    views = cameras(sphere_directions(36), 3.0, 345.0, (180, 135))
    return body, views, *observe(body, views, 0.001, 1)


def mesh_of(seen, **more) -> tuple[trimesh.Trimesh, np.ndarray]:
    _, views, cloud, masks = seen
    surface = reconstruct_surface(views, masks, cloud, points=6000, **more)
    return trimesh.Trimesh(surface.vertices, surface.faces, process=False), surface.observed


def test_what_hangs_by_an_unmeasured_link_stays(seen):
    mesh, observed = mesh_of(seen)
    assert mesh.is_volume and mesh.body_count == 1
    assert np.ptp(mesh.vertices[:, 0]) == pytest.approx(0.85, abs=0.015)
    assert mesh.volume == pytest.approx(seen[0].volume, rel=0.01)
    link = np.abs(mesh.triangles_center[:, 0] + 0.025) < 0.025
    assert link.any() and not observed[link].any()


def test_a_piece_beside_a_still_object_is_left(seen):
    mesh, _ = mesh_of(seen, moving=False)
    assert mesh.is_volume and mesh.body_count == 1
    assert np.ptp(mesh.vertices[:, 0]) == pytest.approx(0.4, abs=0.015)


@pytest.mark.parametrize(("shows", "length"), [((0, 1), 0.85), ((2,), 0.4)])
def test_a_piece_on_a_string_that_most_silhouettes_show_is_the_object(seen, shows: tuple[int, ...], length: float):
    """Of every three images these show the string, and the others show sky there, so that no hull is left of it."""
    body, views, cloud, masks = seen
    string = trimesh.creation.box((0.2, 0.02, 0.02), trimesh.transformations.translation_matrix([-0.05, 0, 0]))
    drawn = [mask.copy() for mask in masks]
    for i, mask in enumerate(drawn):
        if i % 3 in shows:
            camera = views.K[i], views.R[i], views.t[i], mask.shape[::-1]
            mask[silhouette(np.asarray(string.vertices), np.asarray(string.faces), *camera)] = 255
    mesh, _ = mesh_of((body, views, cloud, drawn), moving=False)
    assert mesh.is_volume and mesh.body_count == 1
    assert np.ptp(mesh.vertices[:, 0]) == pytest.approx(length, abs=0.015)


def test_before_there_are_silhouettes_a_piece_beside_a_still_object_is_left(seen):
    _, views, cloud, _ = seen
    surface = reconstruct_surface(views, [], cloud, points=6000, moving=False, fill=Fill(pull=0.0))
    assert np.ptp(surface.vertices[:, 0]) == pytest.approx(0.4, abs=0.015)


def blobs(*given: tuple[tuple[float, float, float], float]) -> tuple[Tetrahedra, np.ndarray]:
    """Tetrahedra of random points in a unit box, and which ball (centre, radius) each lies in, -1 for none."""
    tetra = tetrahedralise(np.random.default_rng(2).random((4000, 3)))
    middle = tetra.points[tetra.corners].mean(1)
    ball = np.full(len(middle), -1)
    for i, (centre, radius) in enumerate(given):
        ball[np.linalg.norm(middle - centre, axis=1) < radius] = i
    return tetra, ball


def costs_of(tetra: Tetrahedra, inside: np.ndarray, outside: float = 0.0) -> Costs:
    """Each tetrahedron inside has one vote for it, each other `outside` against it."""
    none = np.zeros(tetra.corners.shape)
    return Costs(np.where(inside, 0.0, outside), inside.astype(float), none, none + 0.05)


def test_parts_are_linked_each_by_the_nearest():
    centres = (0.2, 0.5, 0.5), (0.5, 0.5, 0.5), (0.8, 0.5, 0.5)
    tetra, ball = blobs(*((c, r) for c, r in zip(centres, (0.13, 0.11, 0.12), strict=True)))
    label = joined(tetra, costs_of(tetra, ball >= 0), ball >= 0)
    assert label[ball >= 0].all()
    middle = tetra.points[tetra.corners].mean(1)
    link = middle[label & (ball < 0)]
    assert 4 < len(link) < 60
    assert (np.abs(link[:, 1:] - 0.5) < 0.2).all() and (link[:, 0] > 0.2).all() and (link[:, 0] < 0.8).all()


def test_a_link_goes_round_rather_than_through_the_sky():
    """Straight through is cheaper, but silhouettes show the sky there; a way round that they leave open is taken."""
    tetra, ball = blobs(((0.25, 0.5, 0.4), 0.12), ((0.75, 0.5, 0.4), 0.12))
    middle = tetra.points[tetra.corners].mean(1)
    corners = np.array([[0.25, 0.5, 0.4], [0.25, 0.5, 0.8], [0.75, 0.5, 0.8], [0.75, 0.5, 0.4]])
    way = np.concatenate(
        [a + np.linspace(0, 1, 50)[:, None] * (b - a) for a, b in zip(corners, corners[1:], strict=False)]
    )
    open_ = np.linalg.norm(middle[:, None] - way, axis=2).min(1) < 0.1
    costs = costs_of(tetra, ball >= 0)
    costs.outside[:] = np.where(open_ | (ball >= 0), 0.0, 1e-3)
    label = joined(tetra, costs, ball >= 0)
    assert label[ball >= 0].all() and (costs.outside[label] == 0).all()
    costs.outside[:] = np.where(ball >= 0, 0.0, 1e-3)
    straight = joined(tetra, costs, ball >= 0)
    assert straight[ball >= 0].all() and straight.sum() < label.sum(), "nothing else leads there"


def test_what_is_worth_less_than_its_link_goes():
    tetra, ball = blobs(((0.25, 0.5, 0.5), 0.15), ((0.75, 0.5, 0.5), 0.1))
    assert joined(tetra, costs_of(tetra, ball >= 0, 1.0), ball >= 0)[ball == 1].all()
    label = joined(tetra, costs_of(tetra, ball >= 0, 200.0), ball >= 0)
    np.testing.assert_array_equal(label, ball == 0)


def test_specks_go():
    tetra, ball = blobs(((0.3, 0.5, 0.5), 0.2), ((0.8, 0.5, 0.5), 0.02))
    ball[np.argmin(np.linalg.norm(tetra.points[tetra.corners].mean(1) - [0.8, 0.5, 0.5], axis=1))] = 1
    assert 0 < (ball == 1).sum() < 7
    np.testing.assert_array_equal(joined(tetra, costs_of(tetra, ball >= 0), ball >= 0), ball == 0)


def test_chance_makes_no_part_and_a_part_is_none():
    rng = np.random.default_rng(0)
    taken = sum(len(parts(np.append(rng.exponential(2.0, 300), 1e5))) - 1 for _ in range(300))
    assert taken <= 3
    assert len(parts(np.append(rng.exponential(2.0, 300), [60.0, 1e5]))) == 2
    assert parts(np.array([5.0])).tolist() == [0]
