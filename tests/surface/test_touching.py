"""Parts of a surface that only touch do not share vertices once a file is read."""

from __future__ import annotations

import io

import numpy as np
import pytest
import trimesh

from massprops.surface.touching import parted


def touching() -> trimesh.Trimesh:
    """Two boxes that touch along an edge of several vertices, each with its own."""
    one = trimesh.creation.box(extents=(1, 1, 1)).subdivide().subdivide()
    other = one.copy()
    other.apply_translation((1.0, 1.0, 0.0))
    return trimesh.util.concatenate([one, other])


def read_again(vertices: np.ndarray, faces: np.ndarray) -> trimesh.Trimesh:
    file = trimesh.Trimesh(vertices, faces, process=False).export(file_type="ply")
    return trimesh.load(io.BytesIO(file), file_type="ply", force="mesh")


def test_a_file_is_a_volume_although_parts_touch() -> None:
    mesh = touching()
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    assert not read_again(vertices, faces).is_volume
    apart = read_again(parted(vertices, faces), faces)
    assert apart.is_volume
    assert apart.volume == pytest.approx(mesh.volume, rel=1e-3)


def test_what_does_not_touch_stays() -> None:
    mesh = trimesh.creation.icosphere(2)
    vertices = np.asarray(mesh.vertices)
    assert parted(vertices, np.asarray(mesh.faces)) is vertices
