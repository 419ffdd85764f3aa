"""Dark places that may be holes: a tube whose bore was closed, and cylinders that are solid."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from massprops.geometry.rasterise import rasterise
from massprops.surface.holes import Holes, holes
from massprops.views import Views

INNER, OUTER, HEIGHT = 0.35, 1.0, 1.6
SIZE = (240, 200)


def _views() -> Views:
    K = np.array([[220.0, 0, 119.5], [0, 220.0, 99.5], [0, 0, 1]])
    R, t = [], []
    for height in (2.5, -2.5):
        for turn in np.arange(8) * np.pi / 4:
            centre = np.array([3.0 * np.cos(turn), 3.0 * np.sin(turn), height])
            forward = -centre / np.linalg.norm(centre)
            right = np.cross(forward, [0.0, 0.0, 1.0])
            right /= np.linalg.norm(right)
            turned = np.stack([right, np.cross(forward, right), forward])
            R.append(turned)
            t.append(-turned @ centre)
    n = len(R)
    names = tuple(f"cam0/{i}.png" for i in range(n))
    return Views(
        names, np.arange(n), np.tile(SIZE, (n, 1)), np.tile(K, (n, 1, 1)), np.zeros((n, 4)), np.array(R), np.array(t)
    )


def _paint(x: np.ndarray) -> np.ndarray:
    """Grey levels of the outside at points (k, 3)."""
    return np.asarray(150.0 + 25.0 * np.sin(9 * x[:, 0]) * np.sin(8 * x[:, 1] + 1) * np.cos(7 * x[:, 2]))


def _drawn(mesh: trimesh.Trimesh, views: Views, inside: str) -> list[np.ndarray]:
    """Images of a mesh; `inside`: of what is painted within the bore's radius: `bore`, `stain`, or `plain`."""
    mesh = mesh.subdivide_to_size(0.08)
    middle, face_normals = np.asarray(mesh.triangles_center), np.asarray(mesh.face_normals)
    value = _paint(middle)
    radius = np.linalg.norm(middle[:, :2], axis=1)
    if inside == "bore":
        # light comes in from one side, and less the deeper
        own = (radius < INNER + 0.02) & (np.abs(face_normals[:, 2]) < 0.5)
        lit = 0.5 * (1.0 + face_normals[own, 0]) * np.exp(-4.0 * (0.5 * HEIGHT - np.abs(middle[own, 2])))
        value[own] = 20.0 + 130.0 * lit
    else:
        value[radius < INNER] = {"stain": 25.0, "plain": 150.0}[inside]
    images = []
    for i in range(len(views)):
        _, face = rasterise(np.asarray(mesh.vertices), np.asarray(mesh.faces), views.K[i], views.R[i], views.t[i], SIZE)
        noise = np.random.default_rng(i).normal(0.0, 1.5, face.shape)
        # a little gloss: no measured surface is as bright from everywhere
        shown = value * (0.75 + 0.4 * np.abs(face_normals @ views.R[i].T[:, 2]))
        images.append(np.clip(np.where(face >= 0, shown[np.maximum(face, 0)], 90.0) + noise, 0, 255).astype(np.uint8))
    return images


def _found(inside: str) -> Holes:
    solid = trimesh.creation.cylinder(OUTER, HEIGHT, sections=48).subdivide_to_size(0.08)
    tube = trimesh.creation.annulus(INNER, OUTER, HEIGHT, sections=48)
    vertices, faces = np.asarray(solid.vertices, float), np.asarray(solid.faces)
    middle = vertices[faces].mean(axis=1)
    cap = np.abs(np.abs(middle[:, 2]) - 0.5 * HEIGHT) < 1e-6
    filled = cap & (np.linalg.norm(middle[:, :2], axis=1) < INNER)
    views = _views()
    grey = _drawn(tube if inside == "bore" else solid, views, inside)
    none = np.zeros(len(faces), bool)
    body = SimpleNamespace(vertices=vertices, faces=faces, observed=~filled, inferred=none, noise=0.01, spacing=0.05)
    return holes(body, views, grey)


def test_a_bore_that_was_closed_may_be_empty() -> None:
    found = _found("bore")
    assert found.count == 2  # both its ends
    assert found.space[0] == pytest.approx(np.pi * INNER**2 * HEIGHT, rel=0.1)
    assert np.abs(found.space[1:4]).max() < 0.02 * found.space[0]


@pytest.mark.parametrize("inside", ["stain", "plain"])
def test_a_dark_stain_and_a_plain_side_are_no_holes(inside: str) -> None:
    found = _found(inside)
    assert found.count == 0 and not found.space.any()
