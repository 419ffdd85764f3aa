"""The mesh's replicates, with unmeasured parts that lie farther out here and less far there.

A replicate of the surface stage (`massprops.surface.spread`) moves each unmeasured part as a whole, which says how far
its volume may be off. What the motion sees is the body's centre and shape, and those answer to where within a part the
fill is wrong. So each replicate is given a smooth random field of offsets besides: Gaussian bumps `REACH` of the body's
length wide, in proportion to the distance from measured surface, since next to it nothing can lie far off.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from massprops.mass.integrals import model_length, offset_response

REACH = 0.15
"""Width of the bumps and distance between them, over the body's length."""
SHARE = 0.45
"""1-sigma of an unmeasured face's offset over its distance from measured surface. Of simulated bodies a third of which was
not seen, 0.3 to 0.6 serve alike."""
COPIES = 3
"""Fields drawn for each replicate."""
MOST_BUMPS = 60


@dataclass(frozen=True)
class Replicates:
    """rows: (r, 10) integrals and lengths: (r,) greatest lengths of bodies that the data allow; length: of the mesh; all
    in units of the structure from motion."""

    rows: np.ndarray
    lengths: np.ndarray
    length: float


def read_replicates(run: Path, seed: int = 0) -> Replicates | None:
    """Those of a run's surface stage; None when the run keeps none."""
    try:
        with np.load(run / "work" / "surface" / "surface.npz", allow_pickle=False) as z:
            vertices, faces, observed = z["vertices"], z["faces"], z["observed"].astype(bool)
            rows, lengths = z["replicate_integrals"], z["replicate_length"]
    except (OSError, ValueError, KeyError):
        return None
    length = model_length(vertices, faces, observed)[0]
    rows, lengths = np.tile(rows, (COPIES, 1)), np.tile(lengths, COPIES)
    rng = np.random.default_rng([seed, 21])
    rows = rows + local_fills(vertices, faces, observed, length, len(rows), rng)
    good = np.isfinite(rows).all(axis=1) & (rows[:, 0] > 0)
    return Replicates(rows[good], lengths[good], length) if good.sum() >= 20 else None


def local_fills(
    vertices: np.ndarray,
    faces: np.ndarray,
    observed: np.ndarray,
    length: float,
    count: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """(count, 10) changes of the integrals by random offsets of the unmeasured faces.

    Args:
        vertices: (v, 3); faces: (f, 3); observed: (f,) bool; length: greatest length of the body.
    """
    from scipy.spatial import cKDTree

    hidden = np.flatnonzero(~observed)
    if not 0 < len(hidden) < len(faces):
        return np.zeros((count, 10))
    middle = vertices[faces].mean(axis=1)
    away = cKDTree(middle[observed]).query(middle[hidden])[0]
    bump = _bumps(middle[hidden], int(np.argmax(away)), REACH * length)
    response = offset_response(vertices, faces[hidden]) * (SHARE * away)[:, None]
    out: np.ndarray = rng.standard_normal((count, bump.shape[1])) @ (bump.T @ response)
    return out


def _bumps(x: np.ndarray, first: int, reach: float) -> np.ndarray:
    """(n, m) bumps about points chosen farthest from one another, their squares adding up to 1 everywhere."""
    chosen = [first]
    away = np.linalg.norm(x - x[first], axis=1)
    while away.max() > reach and len(chosen) < MOST_BUMPS:
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(x - x[chosen[-1]], axis=1))
    square = np.stack([np.sum((x - x[k]) ** 2, axis=1) for k in chosen], axis=1)
    # the nearest counts one: far from all of them nothing underflows
    bump = np.exp(-0.5 * (square - square.min(axis=1, keepdims=True)) / reach**2)
    out: np.ndarray = bump / np.linalg.norm(bump, axis=1, keepdims=True)
    return out
