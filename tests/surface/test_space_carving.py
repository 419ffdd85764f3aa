"""The largest body that darkness allows holds the body, and not what would be seen lit."""

from __future__ import annotations

import numpy as np
import trimesh
from surface.test_lit_sky import BLOCK, SUN, VIEWS, lit_pixels

from massprops.geometry.rasterise import rasterise
from massprops.surface.silhouette import make_hull
from massprops.surface.space_carving import carved

BALL = trimesh.creation.icosphere(5, 0.6)
TOWARDS = np.array([0.6, 0.0, -0.8])


def shown(mesh: trimesh.Trimesh) -> list[np.ndarray]:
    return [np.where(lit_pixels(mesh, i), 255, 0).astype(np.uint8) for i in range(len(VIEWS))]


def test_it_holds_the_body_and_no_place_that_would_be_lit() -> None:
    masks = shown(BLOCK)
    sky = [m == 0 for m in masks]
    # nothing is known of the hull: all of the box about the body is looked at
    nothing = [np.where(m == 0, 128, m).astype(np.uint8) for m in masks]
    measured = np.asarray(BLOCK.triangles_center)
    hull = make_hull(VIEWS, nothing, measured)
    vertices, faces, step = carved(VIEWS, sky, SUN, hull, measured, side=56)
    found = trimesh.Trimesh(vertices, faces, process=False)
    assert found.is_volume
    # no corner of the body is lost, and each of its sides is lit in some views
    away = trimesh.proximity.signed_distance(found, BLOCK.vertices[::7])
    assert away.min() > -1.5 * step
    # of the box that is looked at, 12 times the body, little is left: 24 views show each side lit in few
    assert BLOCK.volume < found.volume < 2 * BLOCK.volume


def test_what_no_image_shows_lit_stays() -> None:
    """A ball of which the Sun, at rest in the body, lights one half: the other may be anything that the lit half shades."""
    sun = np.array([VIEWS.R[i] @ TOWARDS for i in range(len(VIEWS))])
    lit = BALL.face_normals @ TOWARDS > 0
    measured = np.asarray(BALL.triangles_center)[lit]
    masks = []
    for i in range(len(VIEWS)):
        size = tuple(int(s) for s in VIEWS.size[i])
        face = rasterise(BALL.vertices, BALL.faces, VIEWS.K[i], VIEWS.R[i], VIEWS.t[i], size)[1]
        masks.append(np.where((face >= 0) & lit[face], 255, 0).astype(np.uint8))
    nothing = [np.where(m == 0, 128, m).astype(np.uint8) for m in masks]
    vertices, faces, step = carved(
        VIEWS, [m == 0 for m in masks], sun, make_hull(VIEWS, nothing, measured), measured, side=56
    )
    found = trimesh.Trimesh(vertices, faces, process=False)
    dark = BALL.vertices[BALL.vertices @ TOWARDS < -0.1]
    assert trimesh.proximity.signed_distance(found, dark[::5]).min() > -1.5 * step
    beside = np.cross(TOWARDS, [0.0, 1.0, 0.0])
    # beside the ball nothing shades it
    assert trimesh.proximity.signed_distance(found, 0.85 * np.array([beside, -beside])).max() < 0
