"""Outlines that end farther out than the surface, and what the intervals make of it."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from surface.synthetic_dense import cameras, sphere_directions

from massprops.geometry.rasterise import silhouette
from massprops.surface.outline_cloud import ball_of_outlines, surface_of_outlines
from massprops.surface.outline_gap import outline_gaps
from massprops.surface.refine import face_normals
from massprops.surface.spread import replicates
from massprops.views import Views

SIZE, FOCAL, AWAY = (320, 240), 400.0, 4.0
PIXEL = AWAY / FOCAL


def ball(radius: float = 0.8) -> tuple[np.ndarray, np.ndarray]:
    mesh = trimesh.creation.icosphere(4, radius)
    return np.array(mesh.vertices), np.array(mesh.faces)


def round_about(n: int = 24) -> Views:
    return cameras(sphere_directions(n), AWAY, FOCAL, SIZE)


def outlines(views: Views, vertices: np.ndarray, faces: np.ndarray) -> list[np.ndarray]:
    return [
        np.where(silhouette(vertices, faces, views.K[i], views.R[i], views.t[i], SIZE), 255, 0).astype(np.uint8)
        for i in range(len(views))
    ]


@pytest.mark.parametrize("off", [-3.0, 0.0, 4.0])
def test_a_gap_all_about_is_found_in_its_size_and_sign(off: float) -> None:
    views, (vertices, faces) = round_about(), ball()
    gaps = outline_gaps(vertices, faces, views, outlines(views, *ball(0.8 + off * PIXEL)))
    assert np.abs(gaps / PIXEL - off).max() < 1.0


def test_a_gap_on_one_side_stays_there() -> None:
    views, (vertices, faces) = round_about(), ball()
    longer = vertices + np.outer(np.clip(vertices[:, 2] - 0.3, 0, None) * 0.1, [0, 0, 1.0])
    gaps = outline_gaps(vertices, faces, views, outlines(views, longer, faces)) / PIXEL
    up = face_normals(vertices, faces)[:, 2]
    assert np.median(gaps[up > 0.9]) > 3 and np.abs(gaps[up < 0]).max() < 1


def test_no_evidence_and_other_things_are_no_gap() -> None:
    """A shadow far off, an outline that borders on doubt, and no silhouette at all."""
    views, (vertices, faces) = round_about(), ball()
    masks = outlines(views, vertices, faces)
    for mask in masks:
        mask[:, :40] = 255
    assert np.abs(outline_gaps(vertices, faces, views, masks)).max() < PIXEL
    vague = [np.where(mask == 0, 128, mask).astype(np.uint8) for mask in masks]
    assert not outline_gaps(vertices, faces, views, vague).any()


def test_a_gap_is_in_the_interval() -> None:
    """A surface 2 px within its silhouettes is as uncertain as the space between."""
    views, (vertices, faces) = round_about(), ball()
    masks = outlines(views, vertices * [1.1, 1.0, 0.9], faces)
    middle, radius = ball_of_outlines(views, masks)
    surface = surface_of_outlines(views, masks, middle, 1.4 * radius)
    gaps = np.full(len(surface.faces), 2 * PIXEL)
    rows = [replicates(surface, len(views), 0.0, gaps=g)[0][:, 0] for g in (None, gaps)]
    area = trimesh.Trimesh(surface.vertices, surface.faces, process=False).area
    assert rows[1].std() == pytest.approx(np.hypot(rows[0].std(), 2 * PIXEL * area), rel=0.25)
