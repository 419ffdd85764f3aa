"""Sides that nothing measured lie where the measured ones beside them end."""

from __future__ import annotations

import numpy as np
import pytest
from surface.synthetic_dense import asteroid, boxes
from surface.test_flat_sides import filmed

from massprops.surface.closing_sides import closing_sides
from massprops.surface.cloud import Thinned, thin
from massprops.surface.flat_side import FlatSide
from massprops.surface.flat_sides import flat_sides, measured_sides
from massprops.surface.silhouette import make_hull

pytestmark = pytest.mark.usefixtures("scatter_once")

BUS = ((0.3, 0.4, 0.9), (0.0, 0.0, 0.0))
NEVER_LIT = (1.0, 1.0, 0.0)
"""Sum of the normals of the two sides of the bus that were not measured."""


def measured() -> Thinned:
    """Points on all sides of a bus but two that meet."""
    cloud = filmed(boxes(BUS))[2]
    lit = (cloud.normal @ np.diag(NEVER_LIT) < 0.5).all(axis=1)
    return thin(cloud.take(np.flatnonzero(lit)), 8000, 0)


def nowhere(places: np.ndarray) -> np.ndarray:
    return np.zeros(len(places), bool)


def closing(thinned: Thinned) -> list[FlatSide]:
    return closing_sides(measured_sides(thinned, 0), thinned, nowhere)


def test_a_box_is_closed_where_its_sides_end() -> None:
    thinned = measured()
    sides = closing(thinned)
    assert sorted(tuple(np.rint(side.normal)) for side in sides) == [(0, 1, 0), (1, 0, 0)]
    for side in sides:
        places = side.places(side.goes_on)
        axis = int(np.argmax(side.normal))
        half = 0.5 * np.array(BUS[0])
        assert places[:, axis] == pytest.approx(half[axis], abs=thinned.spacing)
        assert (np.abs(places) < half + thinned.spacing).all(), "no farther than the ends"
        area = side.goes_on.sum() * side.step**2
        assert area == pytest.approx(BUS[0][1 - axis] * BUS[0][2], rel=0.15)


def test_nothing_closes_what_is_seen_to_be_empty() -> None:
    thinned = measured()
    assert closing_sides(measured_sides(thinned, 0), thinned, lambda places: np.ones(len(places), bool)) == []


def test_sides_that_end_apart_close_nothing() -> None:
    """As those of a body that is cut off at a slant."""
    thinned = measured()
    kept = thinned.xyz @ np.array([3.0, 0.0, 1.0]) < 0.0
    parts = (thinned.xyz[kept], thinned.normal[kept], thinned.sigma[kept], thinned.views[kept])
    sides = closing(Thinned(*parts, thinned.spacing))
    assert not [side for side in sides if side.normal[0] > 0.9]


def test_a_body_without_flat_sides_has_none_that_close_it() -> None:
    assert closing(thin(filmed(asteroid(), (1.0, 0.0, 0.0))[2], 8000, 0)) == []


def test_sides_end_at_one_that_closes_them() -> None:
    """The silhouettes leave room beyond the unlit sides: they are not asked there."""
    thinned = measured()
    views, masks, _ = filmed(boxes(BUS))
    wide = [np.where(mask == 0, np.uint8(128), mask) for mask in masks]
    hull = make_hull(views, wide, thinned.xyz)
    half = 0.5 * np.array(BUS[0])
    for side in flat_sides(thinned, hull, views):
        assert (side.places(side.goes_on)[:, :2] < half[:2] + 2 * thinned.spacing).all()
