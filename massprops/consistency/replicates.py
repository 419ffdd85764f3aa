"""The mesh's replicates, as the surface stage drew them (`massprops.surface.spread`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from massprops.documents.arrays import open_arrays
from massprops.errors import InputError
from massprops.surface.length import model_length

LARGEST = 1e12
"""Of any number of a mesh: its fifth power is still a float."""


@dataclass(frozen=True)
class Replicates:
    """rows: (r, 10) integrals and lengths: (r,) greatest lengths of bodies that the data allow; length: of the mesh; all
    in units of the structure from motion."""

    rows: np.ndarray
    lengths: np.ndarray
    length: float


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
    return Replicates(rows[good], lengths[good], length) if good.sum() >= 20 else None


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
