"""What all images say of the support, and what a silhouette makes of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh
from test_silhouettes_again import SIZE, views

from massprops.capture.from_shape import beyond_band, overlap
from massprops.geometry.rasterise import silhouette
from massprops.run.drawn_silhouettes import Visible, drawn_silhouette

HERE = views(1)


class Said:
    """Evidence that is known."""

    def __init__(self, odds: np.ndarray) -> None:
        self.odds = odds

    def log_odds(self, views: Any, i: int, image: np.ndarray) -> np.ndarray:
        return self.odds


@pytest.fixture
def scene() -> tuple[np.ndarray, np.ndarray, Visible]:
    """A grey cube before a table of nearly its colour, whose shape has a foot that is none: the true silhouette, image, shape."""
    cube = trimesh.creation.box((2, 2, 2)).subdivide_to_size(0.2)
    foot = trimesh.creation.box(bounds=[[-1.25, -1.25, -1.0], [1.25, 1.25, -0.9]]).subdivide_to_size(0.2)
    solid = silhouette(np.asarray(cube.vertices), np.asarray(cube.faces), HERE.K[0], HERE.R[0], HERE.t[0], SIZE)
    noise = np.random.default_rng(0).normal(0.0, 4.0, (*solid.shape, 1))
    image = np.clip(np.where(solid[..., None], 112, 118) + noise, 0, 255).astype(np.uint8).repeat(3, axis=2)
    shape, none = trimesh.util.concatenate([cube, foot]), np.zeros((0, 3))
    points = np.asarray(cube.vertices)
    colour = np.full((len(points), 3), 112)
    return solid, image, Visible(np.asarray(shape.vertices), np.asarray(shape.faces), None, points, colour, none, none)


def test_the_support_is_no_part_of_a_silhouette(scene: tuple[np.ndarray, np.ndarray, Visible]) -> None:
    solid, image, shown = scene
    told: Any = Said(np.where(solid, 2.0, -2.0).astype(np.float32))
    before, after = (
        overlap(drawn_silhouette(image, HERE, 0, replace(shown, support=s))[0] == 255, solid) for s in (None, told)
    )
    assert after > 0.97
    assert before < after - 0.01


def test_a_table_that_shines_is_no_object(scene: tuple[np.ndarray, np.ndarray, Visible]) -> None:
    solid, image, shown = scene
    told: Any = Said(np.full(solid.shape, 3.0, np.float32))
    mask, known, _ = drawn_silhouette(image, HERE, 0, replace(shown, support=told))
    # an image without texture is cut as smooth as it goes
    assert (mask == 255)[beyond_band(known.drawn)].sum() < 0.01 * solid.sum()
