"""Bodies known by their outlines alone: the hull, how many views must agree, and what outlines cannot show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from surface.synthetic_dense import cameras, sphere_directions

from massprops.geometry.rasterise import silhouette
from massprops.mass.integrals import central_inertia, mesh_integrals
from massprops.surface.error_modes import hidden_depth
from massprops.surface.outer import outer_integrals
from massprops.surface.outline_cloud import ball_of_outlines, consistent, surface_of_outlines, with_margins
from massprops.surface.silhouette import make_hull
from massprops.surface.spread import FOOT_PIXELS, ErrorSources, replicates
from massprops.views import Views

SIZE = (160, 120)


def outlines(mesh: trimesh.Trimesh, n: int = 24) -> tuple[Views, list[np.ndarray]]:
    views = cameras(sphere_directions(n), 8.0, 300.0, SIZE)
    v, f = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    drawn = [silhouette(v, f, views.K[i], views.R[i], views.t[i], SIZE) for i in range(n)]
    return views, [np.where(d, 255, 0).astype(np.uint8) for d in drawn]


def ball() -> trimesh.Trimesh:
    """A little longer than wide: of a ball, every two points may be the farthest apart."""
    out = trimesh.creation.icosphere(3, 1.0)
    out.apply_scale([1.0, 0.85, 0.75])
    return out


def bowl() -> trimesh.Trimesh:
    """A ball with a pit that no outline shows."""
    pit = trimesh.creation.icosphere(3, 0.6)
    pit.apply_translation([0.0, 0.0, 0.85])
    return trimesh.boolean.difference([ball(), pit], engine="manifold")


@pytest.mark.parametrize(("make", "least"), [(ball, 0.75), (bowl, 0.0)])
def test_the_interval_holds_what_outlines_cannot_show(make, least: float) -> None:  # type: ignore[no-untyped-def]
    mesh = make()
    views, masks = outlines(mesh)
    middle, radius = ball_of_outlines(views, masks)
    surface = surface_of_outlines(views, masks, middle, 1.4 * radius)
    assert not surface.observed.any()
    rows, _ = replicates(surface, len(views), ErrorSources())
    hull = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    low, high = np.quantile(rows[:, 0], [0.05, 0.95]) / mesh.volume
    assert hull.is_volume and low < 1.0 < max(high, hull.volume / mesh.volume)
    assert low > least * hull.volume / mesh.volume
    # a hull holds its body: the other end is the outlines' own error
    assert high < 1.1 * hull.volume / mesh.volume


def test_where_a_hull_bends_away_on_all_sides_little_is_hidden() -> None:
    mesh = ball()
    round_, flat = hidden_depth(mesh.vertices, mesh.faces), trimesh.creation.box((2.0, 2.0, 0.2)).subdivide_loop(0)
    for _ in range(4):
        flat = flat.subdivide()
    plate = hidden_depth(flat.vertices, flat.faces)
    assert np.median(round_) < 0.04 and np.median(plate) > 0.1
    # half the plate's thickness is hidden at twice the deviation, and no more
    assert 2 * 0.3 * plate.max() < 0.3


def test_one_view_carves_where_all_agree_and_several_where_some_are_dark() -> None:
    mesh = ball()
    views, masks = outlines(mesh)
    views, masks = with_margins(views, masks)
    middle, radius = ball_of_outlines(views, masks)
    hull = make_hull(views, masks, middle[None])
    assert consistent(hull, views, masks, middle, 1.4 * radius).need == 1
    dark = [m.copy() for m in masks]
    for i in (3, 11):
        dark[i][:, dark[i].shape[1] // 2 :] = 0
    found = consistent(replace(make_hull(views, dark, middle[None])), views, dark, middle, 1.4 * radius)
    assert 1 < found.need <= 4


def test_a_body_near_the_edge_of_the_image_is_bounded() -> None:
    mesh = ball()
    views = cameras(sphere_directions(24), 5.3, 300.0, SIZE)  # fills the image's height
    v, f = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    masks = [
        np.where(silhouette(v, f, views.K[i], views.R[i], views.t[i], SIZE), 255, 0).astype(np.uint8) for i in range(24)
    ]
    wide, padded = with_margins(views, masks)
    assert np.allclose(wide.K[:, :2, 2] - views.K[:, :2, 2], (padded[0].shape[0] - SIZE[1]) / 2)
    assert padded[0][0, 0] == 0
    cut = masks[0].copy()
    cut[0, 10] = 255
    assert with_margins(views, [cut, *masks[1:]])[1][0][0, 0] == 128


def test_no_body_is_larger_than_what_its_outlines_leave_room_for() -> None:
    mesh = trimesh.creation.box((1.6, 1.0, 0.5))
    mesh.apply_translation([0.2, -0.1, 0.1])
    for n, most in ((6, 4.0), (60, 1.6)):
        views, masks = outlines(mesh, n)
        room = outer_integrals(make_hull(views, masks, np.zeros((1, 3))), np.asarray(mesh.vertices))
        volume, _, inertia = central_inertia(room, 1.0)
        own = central_inertia(mesh_integrals(np.asarray(mesh.vertices), np.asarray(mesh.faces)), 1.0)
        assert own[0] <= volume < most * own[0]
        assert np.all(np.linalg.eigvalsh(own[2]) <= np.linalg.eigvalsh(inertia))


def test_a_hull_tells_how_many_views_contradict_what_was_measured() -> None:
    mesh = trimesh.creation.box((2.2, 1.0, 0.5)).subdivide().subdivide().subdivide()
    views, masks = outlines(mesh, 20)
    points = np.asarray(mesh.vertices, float)
    assert make_hull(views, masks, points).sparing(points).outside_share == 0.0
    # a third of the cameras are 20 degrees off
    R, t = views.R.copy(), views.t.copy()
    turn = trimesh.transformations.rotation_matrix(np.radians(20), [0.3, 1.0, 0.2])[:3, :3]
    R[::3] = R[::3] @ turn
    moved = replace(views, R=R, t=t)
    assert 0.2 < make_hull(moved, masks, points).sparing(points).outside_share <= 0.35


def test_an_end_on_the_support_may_reach_beyond_the_body() -> None:
    views, masks = outlines(ball())
    middle, radius = ball_of_outlines(views, masks)
    surface = surface_of_outlines(views, masks, middle, 1.4 * radius)
    low = surface.vertices[surface.faces][:, :, 0].min(axis=1) < surface.vertices[:, 0].min() + 0.1
    closed = replace(surface, inferred=low)
    plane = np.array([1.0, 0, 0, -surface.vertices[:, 0].min()])
    measured = replace(surface, hull=replace(surface.hull, support=plane))
    free, *standing = (replicates(s, len(views), ErrorSources())[1].mean() for s in (surface, closed, measured))
    for foot in standing:
        assert 0.7 * FOOT_PIXELS < (free - foot) / surface.hull.pixel < 0.9 * FOOT_PIXELS


def test_the_cameras_of_a_pair_are_one_witness_of_what_is_dark() -> None:
    mesh = ball()
    views, masks = outlines(mesh, 20)
    pairs = replace(views, timestamp_ns=np.repeat(np.arange(10), 2))
    middle = mesh.vertices.mean(axis=0)
    dark = [np.zeros_like(m) if i < 4 else m for i, m in enumerate(masks)]
    for i in range(4):
        dark[i][0, 0] = 255
    alone = make_hull(replace(views, timestamp_ns=np.arange(20)), dark, middle[None])
    of_pairs = make_hull(pairs, dark, middle[None])
    assert alone.at_once == 1 and of_pairs.at_once == 2
    assert replace(alone, need=3).value(middle[None])[0] > 0
    assert replace(of_pairs, need=3 * of_pairs.at_once).value(middle[None])[0] < 0
    assert of_pairs.need >= 6 and of_pairs.outside_share == (of_pairs.need - 4) / 20


def test_what_lies_beyond_an_image_that_shows_all_of_a_body_is_empty() -> None:
    views, masks = outlines(ball(), 20)
    beyond = views.centres[:1] + 0.2 * (views.centres[:1] - views.centres[10:11])
    points = np.asarray(ball().vertices, float)
    known, unknown = (make_hull(views, masks, points, free=free) for free in (True, False))
    # most images do not show the place, as it lies beside or behind their cameras
    most = len(views) // 2
    assert replace(known, need=most).value(beyond)[0] > 0 > replace(unknown, need=most).value(beyond)[0]
    cut = [m.copy() for m in masks]
    for m in cut:
        m[0, 0] = 255
    assert replace(make_hull(views, cut, points, free=True), need=most).value(beyond)[0] < 0
    assert np.all(known.value(points) < 1.0)
