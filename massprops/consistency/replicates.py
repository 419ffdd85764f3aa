"""The mesh's replicates, as the surface stage drew them (`massprops.surface.spread`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from massprops.documents.arrays import open_arrays
from massprops.errors import InputError
from massprops.mass.integrals import central_inertia, face_areas, mesh_integrals
from massprops.surface.error_modes import away_from_measured
from massprops.surface.length import model_length

LARGEST = 1e12
"""Of any number of a mesh: its fifth power is still a float."""


@dataclass(frozen=True)
class Replicates:
    """rows: (r, 10) integrals and lengths: (r,) greatest lengths of bodies that the data allow; length: of the mesh; surface: its
    vertices, faces and which were measured; all in units of the structure from motion."""

    rows: np.ndarray
    lengths: np.ndarray
    length: float
    surface: tuple[np.ndarray, np.ndarray, np.ndarray]


def read_replicates(run: Path) -> Replicates | None:
    """Those of a run's surface stage; None when the run keeps none."""
    try:
        with open_arrays(run / "work" / "surface" / "surface.npz") as z:
            vertices, faces, observed = z["vertices"], z["faces"], z["observed"].astype(bool)
            # those that know nothing of the motion, where others do
            of = "shape" if "shape_integrals" in z else "replicate"
            rows, lengths = z[f"{of}_integrals"], z[f"{of}_length"]
    except (OSError, ValueError, KeyError):
        return None
    if not _fit_together(vertices, faces, observed, rows, lengths):
        raise InputError(f"{run / 'work' / 'surface' / 'surface.npz'}: damaged: make the run again")
    length = model_length(vertices, faces, observed)[0]
    good = (np.abs(rows) < LARGEST).all(axis=1) & (rows[:, 0] > 0)
    surface = vertices, faces, observed
    return Replicates(rows[good], lengths[good], length, surface) if good.sum() >= 20 else None


def fill_pulls(vertices: np.ndarray, faces: np.ndarray, observed: np.ndarray) -> np.ndarray:
    """How far each filled face (k, 3) moves the centre of mass where it is off by its distance from the measured surface.

    Fill that spans a gap may lie as deep as the gap is wide, and nothing that was seen contradicts it.

    Args:
        vertices: (v, 3), faces: (f, 3) of a closed mesh; observed: (f,) bool, faces that were measured.
    """
    if observed.all() or not observed.any():
        return np.zeros((0, 3))
    volume, centre, _ = central_inertia(mesh_integrals(vertices, faces), 1.0)
    middle = vertices[faces].mean(axis=1)
    moved = face_areas(vertices, faces[~observed]) * away_from_measured(middle, observed)
    return np.asarray(moved[:, None] * (middle[~observed] - centre) / volume)


def _fit_together(
    vertices: np.ndarray, faces: np.ndarray, observed: np.ndarray, rows: np.ndarray, lengths: np.ndarray
) -> bool:
    """Whether the arrays are those of one mesh and its replicates."""
    shapes = (
        vertices.ndim == faces.ndim == rows.ndim == 2
        and vertices.shape[1:] == faces.shape[1:] == (3,)
        and rows.shape[1] == 10
        and observed.shape == faces.shape[:1]
        and lengths.shape == rows.shape[:1]
    )
    kinds = faces.dtype.kind in "iu" and all(a.dtype.kind == "f" for a in (vertices, rows, lengths))
    return bool(
        shapes
        and kinds
        and faces.size
        and faces.min() >= 0
        and faces.max() < len(vertices)
        and (np.abs(vertices) < LARGEST).all()
        and (np.abs(lengths) < LARGEST).all()
    )
