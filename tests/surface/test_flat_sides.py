"""Flat sides go on where nothing was measured, as far as they meet others; bodies without any stay as they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from surface.synthetic_dense import asteroid, boxes, cameras, observe, sphere_directions

from massprops.mass.integrals import mesh_integrals
from massprops.surface.cloud import Cloud, Thinned, thin
from massprops.surface.flat_side import FlatSide
from massprops.surface.flat_sides import _until_others, enclosed, flat_sides, in_front
from massprops.surface.reconstruct import CONTINUED, FILLED, Surface, reconstruct_surface
from massprops.surface.silhouette import Hull, make_hull
from massprops.views import Views

pytestmark = pytest.mark.usefixtures("scatter_once")

PIXEL = 3.0 / 400.0
BUS, PANEL = ((0.3, 0.3, 0.9), (0.0, 0.0, 0.0)), ((0.5, 0.015, 0.6), (0.4, -0.1, 0.0))
SATELLITE = boxes(BUS, PANEL)
AWAY = (0.7, 0.7, 0.0)
"""Towards the corner between bus and panel, where no camera is."""


def filmed(
    mesh: trimesh.Trimesh, away: tuple[float, float, float] = AWAY, seed: int = 0
) -> tuple[Views, list[np.ndarray], Cloud]:
    """Views from one side of a body, their silhouettes and what stereo measures of that side."""
    directions = sphere_directions(60)
    views = cameras(directions[directions @ np.array(away) < 0.15], 3.0, 400.0)
    cloud, masks = observe(mesh, views, 0.3 * PIXEL, seed, most=60_000)
    return views, masks, cloud


def volume(surface: Surface) -> float:
    return float(mesh_integrals(surface.vertices, surface.faces)[0])


def given(mesh: trimesh.Trimesh) -> tuple[Views, Thinned, Hull]:
    views, masks, cloud = filmed(mesh)
    hull = make_hull(views, masks, cloud.xyz)
    thinned = thin(cloud, 8000, 0)
    return views, thinned, hull.sparing(thinned.xyz)


def test_the_corner_behind_a_panel_stays_empty() -> None:
    """Seen from its other side alone, the hull fills the corner between the panel and the bus, and so does the smallest surface."""
    views, masks, cloud = filmed(SATELLITE)
    true = SATELLITE.volume
    web = volume(reconstruct_surface(views, masks, cloud, 8000, fill=FILLED)) / true - 1
    straight = volume(reconstruct_surface(views, masks, cloud, 8000, fill=CONTINUED)) / true - 1
    assert web > 0.1
    assert abs(straight) < 0.4 * web


def test_a_body_without_flat_sides_is_the_same() -> None:
    views, masks, cloud = filmed(asteroid(), (1.0, 0.0, 0.0))
    with_, without = (reconstruct_surface(views, masks, cloud, 4000, fill=fill) for fill in (CONTINUED, FILLED))
    assert np.array_equal(with_.vertices, without.vertices)


def test_sides_end_at_each_other() -> None:
    views, thinned, hull = given(SATELLITE)
    sides = flat_sides(thinned, hull, views)
    for side in sides:
        beyond = side.places(side.goes_on)
        assert not (np.abs(beyond) < np.array([0.06, 0.06, 0.3])).all(1).any(), "no side goes on within the bus"
    back = [s for s in sides if s.normal[1] > 0.99 and s.offset < 0.0]
    assert len(back) == 1, "the back of the panel"
    assert back[0].offset == pytest.approx(-0.0925, abs=0.5 * PIXEL)
    assert back[0].goes_on.sum() > back[0].measured.sum(), "most of it lies in the corner"


def test_a_plate_has_a_back_that_nothing_was_measured_on() -> None:
    """Silhouettes end next to most of a panel's rim; next to none of a bus's."""
    plate = boxes(((0.8, 0.03, 0.6), (0.0, 0.0, 0.0)))
    views, masks, cloud = filmed(plate)
    front = cloud.take(np.flatnonzero(cloud.normal[:, 1] < -0.5))
    hull, thinned = make_hull(views, masks, front.xyz), thin(front, 5000, 0)
    sides = flat_sides(thinned, hull, views)
    assert [round(float(s.normal[1])) for s in sides] == [-1, 1]
    assert -sides[1].offset == pytest.approx(-0.015, abs=0.03)
    views, masks, cloud = filmed(boxes(BUS))
    front = cloud.take(np.flatnonzero(cloud.normal[:, 1] < -0.5))
    sides = flat_sides(thin(front, 5000, 0), make_hull(views, masks, front.xyz), views)
    assert all(side.normal[1] < 0 for side in sides)


def square(normal: tuple[float, float, float], offset: float) -> FlatSide:
    """A side that was measured at 21 by 21 places, from -1 to 1 along both axes."""
    n = np.array(normal, float)
    first = np.linalg.svd(n[None])[2][1]
    base = np.stack([first, np.cross(n, first)])
    whole = np.ones((21, 21), bool)
    return FlatSide(n, offset, base, np.full(2, -1.0), 0.1, whole, np.zeros_like(whole))


def test_a_panel_does_not_go_on_into_the_side_that_it_shades() -> None:
    """The gap in the shaded side is as wide as the panel and open to one edge."""
    near, far = square((1, 0, 0), 0.5), square((-1, 0, 0), 0.5)
    gap = (np.abs(near.places(near.measured)[:, 1]) < 0.65) & (near.places(near.measured)[:, 2] > -0.75)
    near = replace(near, measured=~gap.reshape(21, 21))
    panel = square((0, 1, 0), 0.0)
    beyond = panel.places(panel.measured)[:, 0] > 0.55
    panel = replace(panel, measured=beyond.reshape(21, 21), goes_on=~beyond.reshape(21, 21))
    reached = _until_others(panel, [near, far, panel])
    places = reached.places(reached.goes_on)
    within = (np.abs(places[:, 0]) < 0.4) & (np.abs(places[:, 2]) < 0.15)
    assert not within.any()


def test_what_lies_before_and_between_sides() -> None:
    box = [square(n, 1.0) for n in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))]
    inside, above, past = np.array([[0.2, 0.3, 0.9]]), np.array([[1.4, 0.0, 0.0]]), np.array([[0.0, 0.0, 2.0]])
    assert enclosed(box, inside)[0]
    assert not enclosed(box, above)[0]
    assert not enclosed(box, past)[0]
    assert not enclosed(box[:2], inside)[0], "between two sides of one direction a slot may be open"
    assert in_front(box, above)[0]
    assert not in_front(box, inside)[0]
    assert not in_front(box, past)[0]
    assert not in_front([], inside)[0]
