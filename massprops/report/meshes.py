"""Meshes for the page: read from a run folder, and reduced to what a browser turns with ease."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from massprops.documents.arrays import open_arrays
from massprops.native import mesh_set

MOST_FACES = 50_000
INFERRED = 2
"""`origin` in mesh.ply of a face that was closed at the plane of support."""


@dataclass(frozen=True)
class Shape:
    """Mesh for the page.

    Attributes:
        vertices: (v, 3) final units.
        faces: (f, 3).
        observed: (f,) bool, measured rather than filled in.
        distance: (v,) signed distance to a CAD [m], or None.
        inferred: (f,) bool, closed at the plane of support, or None.
        rgb: (v, 3) uint8, the photographs' colours, or None.
    """

    vertices: np.ndarray
    faces: np.ndarray
    observed: np.ndarray
    distance: np.ndarray | None = None
    inferred: np.ndarray | None = None
    rgb: np.ndarray | None = None


def read_shape(folder: Path, factor: float, compared: Shape | None = None) -> Shape | None:
    """The run's mesh with its measured faces; of a run that stopped before publishing, the surface stage's.

    Args:
        folder: the run; factor: final units per unit of the structure from motion.
        compared: of `read_compared`, whose distances are taken where it is the same mesh.
    """
    path = folder / "mesh.ply"
    if path.is_file():
        shape = _read_ply(path)
        if shape is not None:
            same = compared is not None and np.array_equal(compared.faces, shape.faces)
            return decimated(replace(shape, distance=compared.distance) if same and compared is not None else shape)
    path = folder / "work" / "surface" / "surface.npz"
    if path.is_file():
        try:
            with open_arrays(path) as z:
                return decimated(Shape(z["vertices"] * factor, z["faces"], z["observed"].astype(bool)))
        except (OSError, ValueError, KeyError, IndexError, TypeError):  # a report is made of what can be read
            return None
    return None


def read_compared(folder: Path) -> Shape | None:
    """The mesh of `compare.ply` with its signed distances, whole, or None."""
    path = folder / "compare.ply"
    shape = _read_ply(path) if path.is_file() else None
    return None if shape is None or shape.distance is None else shape


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
    origin = column("face", "origin", len(faces))
    paint = [column("vertex", name, len(mesh.vertices)) for name in ("red", "green", "blue")]
    painted = [p for p in paint if p is not None]
    return Shape(
        np.asarray(mesh.vertices, float),
        faces,
        np.ones(len(faces), bool) if observed is None else observed.astype(bool),
        None if distance is None else distance.astype(float),
        None if origin is None else origin == INFERRED,
        np.stack(painted, axis=1).astype(np.uint8) if len(painted) == 3 else None,
    )


def decimated(shape: Shape, most: int = MOST_FACES) -> Shape:
    """The shape with at most `most` faces; flags, distances and colours are those of the nearest face and vertex."""
    if len(shape.faces) <= most:
        return shape
    from scipy.spatial import cKDTree

    work = mesh_set(shape.vertices, shape.faces)
    work.meshing_decimation_quadric_edge_collapse(targetfacenum=most, preservenormal=True)
    mesh = work.current_mesh()
    vertices, faces = np.array(mesh.vertex_matrix()), np.array(mesh.face_matrix())
    face = cKDTree(shape.vertices[shape.faces].mean(1)).query(vertices[faces].mean(1))[1]
    vertex = cKDTree(shape.vertices).query(vertices)[1]

    def of(values: np.ndarray | None, nearest: np.ndarray) -> np.ndarray | None:
        return None if values is None else values[nearest]

    return Shape(
        vertices,
        faces,
        shape.observed[face],
        of(shape.distance, vertex),
        of(shape.inferred, face),
        of(shape.rgb, vertex),
    )
