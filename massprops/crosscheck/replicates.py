"""The mesh's replicates, as the surface stage drew them (`massprops.surface.spread`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from massprops.documents.arrays import open_arrays
from massprops.surface.length import model_length


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
            rows, lengths = z["replicate_integrals"], z["replicate_length"]
    except (OSError, ValueError, KeyError):
        return None
    length = model_length(vertices, faces, observed)[0]
    good = np.isfinite(rows).all(axis=1) & (rows[:, 0] > 0)
    return Replicates(rows[good], lengths[good], length) if good.sum() >= 20 else None
