"""A plain body's surface by its brightness: nearer to the truth than its hull, and refused where brightness tells nothing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
import trimesh
from surface.synthetic_dense import cameras, sphere_directions

from massprops.geometry.rasterise import rasterise
from massprops.mass.integrals import central_inertia, mesh_integrals
from massprops.surface import shading, shadow
from massprops.surface.outline_cloud import WIDE, ball_of_outlines, surface_of_outlines
from massprops.surface.outline_gaps import outline_gaps
from massprops.surface.plain_body import surface_by_brightness
from massprops.surface.reconstruct import Surface
from massprops.surface.refine import face_normals
from massprops.surface.shading import _gradient
from massprops.surface.spread import ErrorSources, replicates
from massprops.surface.unlit import spare_behind_light
from massprops.views import Views

SIZE = (160, 120)
SUN = np.array([0.65, -0.35, -0.67]) / np.linalg.norm([0.65, -0.35, -0.67])
"""In the camera."""


class Footage(NamedTuple):
    mesh: trimesh.Trimesh
    views: Views
    masks: list[np.ndarray]
    grey: list[np.ndarray]
    hull: Surface
    ball: tuple[np.ndarray, float]


def body() -> trimesh.Trimesh:
    """Two lumps with a waist that no outline shows all round."""
    parts = [trimesh.creation.icosphere(3, r) for r in (0.7, 0.6)]
    parts[0].apply_scale([1.0, 0.8, 0.9])
    parts[1].apply_translation([0.75, 0.1, 0.15])
    return trimesh.boolean.union(parts, engine="manifold")


def filmed(dark: float = 1.0) -> Footage:
    """Lit and dark sides of the body from all sides, with no shadow cast: brightness is a power of the cosine to the Sun.
    One lump reflects `dark` of what the other does."""
    mesh = body()
    v, f = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    views = cameras(sphere_directions(28), 6.0, 256.0, SIZE)
    views = replace(views, names=tuple(f"cam0/{i}.png" for i in range(len(views))))
    normal, rng, grey = face_normals(v, f), np.random.default_rng(0), []
    paint = np.where(v[f].mean(axis=1)[:, 0] > 0.4, dark, 1.0)
    for i in range(len(views)):
        face = rasterise(v, f, views.K[i], views.R[i], views.t[i], SIZE)[1]
        cosine = np.where(face >= 0, paint[face] * np.maximum(normal[face] @ views.R[i].T @ SUN, 0.0), 0.0)
        noise = rng.standard_normal(face.shape)
        grey.append(np.clip(np.rint(200 * cosine**0.5 + noise), 0, 255).astype(np.uint8))
    masks = spare_behind_light(views, [np.where(g > 12, 255, 0).astype(np.uint8) for g in grey], grey)
    middle, radius = ball_of_outlines(views, masks)
    hull = surface_of_outlines(views, masks, middle, WIDE * radius)
    return Footage(mesh, views, masks, grey, hull, (middle, radius))


@pytest.fixture(scope="module", autouse=True)
def coarse_shadows() -> Iterator[None]:
    """A map of shadows that is still three times as fine as these small images."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shadow, "SHADOW_SIZE", 300)
        yield


@pytest.fixture(scope="module")
def footage() -> Footage:
    return filmed()


def interval(found: Surface, footage: Footage) -> tuple[float, float]:
    """Of the volume, by 90 %."""
    gaps = outline_gaps(found.vertices, found.faces, footage.views, footage.masks, 0.3)
    gaps = replace(gaps, offset=np.zeros(len(found.faces)), drift=0.0)
    rows = replicates(found, len(footage.views), ErrorSources(0.0, gaps, never_lit=True), seed=0)[0]
    low, high = np.quantile(rows[:, 0], [0.05, 0.95])
    return float(low), float(high)


def errors(surface: Surface, mesh: trimesh.Trimesh) -> tuple[float, float]:
    """Of the volume, relative, and of k1."""
    both = [(surface.vertices, surface.faces), (np.asarray(mesh.vertices), np.asarray(mesh.faces))]
    (v, _, inertia), (v0, _, inertia0) = (central_inertia(mesh_integrals(*m), 1.0) for m in both)
    k, k0 = (np.log(m[0] / m[1]) for m in (np.linalg.eigvalsh(inertia), np.linalg.eigvalsh(inertia0)))
    return float(v / v0 - 1), float(k - k0)


def by_brightness(footage: Footage) -> Surface | None:
    return surface_by_brightness(footage.views, footage.masks, footage.grey, footage.ball)


def test_brightness_brings_the_hull_to_the_body(footage: Footage) -> None:
    found = by_brightness(footage)
    assert found is not None and found.slope is not None and found.slope < 0.06
    before, after = errors(footage.hull, footage.mesh), errors(found, footage.mesh)
    assert abs(after[0]) < 0.5 * abs(before[0]) and abs(after[1]) < 0.5 * abs(before[1])
    low, high = interval(found, footage)
    assert low < footage.mesh.volume < high


def test_the_interval_of_the_hull_reaches_down_to_the_body(footage: Footage) -> None:
    low, high = interval(footage.hull, footage)
    own = mesh_integrals(footage.hull.vertices, footage.hull.faces)[0]
    assert low < footage.mesh.volume < 0.97 * own and high < 1.05 * own


def test_two_paints_are_not_taken_for_one(monkeypatch: pytest.MonkeyPatch) -> None:
    painted = filmed(dark=0.5)
    assert by_brightness(painted) is None
    monkeypatch.setattr(shading, "ONE_PAINT", np.inf)
    found = by_brightness(painted)
    assert found is not None, "taken for one all the same, they widen the interval"
    low, high = interval(found, painted)
    assert low < painted.mesh.volume < high


def test_brightness_that_the_shape_does_not_explain_measures_nothing(footage: Footage) -> None:
    rng = np.random.default_rng(1)
    paint = [
        np.where(m == 255, np.clip(g.mean() + np.kron(rng.uniform(60, 200, (12, 16)), np.ones((10, 10))), 0, 255), 0)
        for m, g in zip(footage.masks, footage.grey, strict=True)
    ]
    assert by_brightness(footage._replace(grey=[p.astype(np.uint8) for p in paint])) is None


def test_two_cameras_are_left_to_their_outlines(footage: Footage) -> None:
    names = tuple(f"cam{i % 2}/{i}.png" for i in range(len(footage.views)))
    assert by_brightness(footage._replace(views=replace(footage.views, names=names))) is None


def test_the_gradient_along_a_surface_is_that_of_a_linear_function_less_its_normal_part() -> None:
    mesh = trimesh.creation.box((1.0, 2.0, 3.0)).subdivide().subdivide().subdivide()
    v, f = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    g = np.array([0.3, -0.7, 0.2])
    found = (_gradient(v, f) @ (v @ g)).reshape(-1, 3)
    flat = np.isclose(np.abs(v / [0.5, 1.0, 1.5]), 1.0).sum(axis=1) == 1
    normal = np.isclose(np.abs(v / [0.5, 1.0, 1.5]), 1.0)[flat]
    assert flat.sum() > 100
    np.testing.assert_allclose(found[flat], np.where(normal, 0.0, g), atol=1e-9)
