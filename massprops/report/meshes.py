"""Meshes for the page: read from a run folder, and reduced to what a browser turns with ease."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from massprops.documents.arrays import open_arrays

MOST_FACES = 50_000


@dataclass(frozen=True)
class Shape:
    """Mesh for the page.

    Attributes:
        vertices: (v, 3) final units.
        faces: (f, 3).
        observed: (f,) bool, measured rather than filled in.
        distance: (v,) signed distance to a CAD [m], or None.
    """

    vertices: np.ndarray
    faces: np.ndarray
    observed: np.ndarray
    distance: np.ndarray | None = None


def read_shape(folder: Path, factor: float) -> Shape | None:
    """The run's mesh with its measured faces; of a run that stopped before publishing, the surface stage's."""
    path = folder / "mesh.ply"
    if path.is_file():
        shape = _read_ply(path)
        if shape is not None:
            return lighten(shape)
    path = folder / "work" / "surface" / "surface.npz"
    if path.is_file():
        with open_arrays(path) as z:
            return lighten(Shape(z["vertices"] * factor, z["faces"], z["observed"].astype(bool)))
    return None


def read_compared(folder: Path) -> Shape | None:
    """The mesh of `compare.ply` with its signed distances, or None."""
    path = folder / "compare.ply"
    shape = _read_ply(path) if path.is_file() else None
    return None if shape is None or shape.distance is None else lighten(shape, MOST_FACES // 2)


def _read_ply(path: Path) -> Shape | None:
    import trimesh

    try:
        mesh = trimesh.load(path, force="mesh", process=False)
    except Exception:  # a report is made of what can be read
        return None
    faces = np.asarray(getattr(mesh, "faces", ()))
    if len(faces) == 0:
        return None
    raw = mesh.metadata.get("_ply_raw", {})

    def column(element: str, name: str, count: int) -> np.ndarray | None:
        try:
            values = np.asarray(raw[element]["data"][name]).ravel()
        except (KeyError, TypeError, ValueError, IndexError):
            return None
        return values if len(values) == count else None

    observed, distance = column("face", "observed", len(faces)), column("vertex", "distance", len(mesh.vertices))
    return Shape(
        np.asarray(mesh.vertices, float),
        faces,
        np.ones(len(faces), bool) if observed is None else observed.astype(bool),
        None if distance is None else distance.astype(float),
    )


def lighten(shape: Shape, most: int = MOST_FACES) -> Shape:
    """The shape with at most `most` faces; flags and distances are those of the nearest original face and vertex."""
    if len(shape.faces) <= most:
        return shape
    import pymeshlab
    from scipy.spatial import cKDTree

    work = pymeshlab.MeshSet(verbose=False)
    work.add_mesh(pymeshlab.Mesh(np.asarray(shape.vertices, float), np.asarray(shape.faces, np.int32)))
    work.meshing_decimation_quadric_edge_collapse(targetfacenum=most, preservenormal=True)
    mesh = work.current_mesh()
    vertices, faces = np.array(mesh.vertex_matrix()), np.array(mesh.face_matrix())
    face = cKDTree(shape.vertices[shape.faces].mean(1)).query(vertices[faces].mean(1))[1]
    distance = None if shape.distance is None else shape.distance[cKDTree(shape.vertices).query(vertices)[1]]
    return Shape(vertices, faces, shape.observed[face], distance)
