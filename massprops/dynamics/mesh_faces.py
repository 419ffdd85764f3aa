"""The faces of a mesh as what comes from one direction meets them: a few faces, each for all triangles that look its way.

A face takes part while it looks toward the direction; no face shades another, as none does on a convex body.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from massprops.geometry.vectors import sphere

MOST_FACES = 300
"""Of a mesh: of more triangles, those that look the same way within some ten degrees are one face."""

LARGEST_TURN = 0.2
"""[rad] in a step of the derivatives, as of sunlight on twenty faces."""


@dataclass(frozen=True)
class Faces:
    """f faces: normals (f, 3) outward, areas (f,) over the whole surface's, centres (f, 3) from the centre of mass over the root of
    the whole area."""

    normals: np.ndarray
    areas: np.ndarray
    centres: np.ndarray

    @cached_property
    def levers(self) -> np.ndarray:
        """(f, 3) centre times normal."""
        return np.cross(self.centres, self.normals)

    def pushed(self, toward: tuple[Any, Any, Any]) -> tuple[np.ndarray, np.ndarray]:
        """Forces (3, ..., 3) and torques (3, ..., 3) of unit pressure from a direction, body axes: of what is absorbed, sent back
        as by a mirror, and sent back evenly (Wertz 1978, eq. 17-46; Basilisk's facets).

        Args:
            toward: components (...) of the unit vector toward where it comes from.
        """
        d = np.stack(np.broadcast_arrays(*toward), axis=-1)
        cosine = d @ self.normals.T
        met = np.where(cosine.real > 0.0, cosine, 0.0) * self.areas
        along = -np.sum(met, axis=-1, keepdims=True) * d
        torque = -np.cross(met @ self.centres, d)
        thrown = met * cosine
        forces = [along, -2.0 * thrown @ self.normals, along - 2.0 / 3.0 * met @ self.normals]
        torques = [torque, -2.0 * thrown @ self.levers, torque - 2.0 / 3.0 * met @ self.levers]
        return np.stack(forces), np.stack(torques)


def faces_of(given: dict[str, Any]) -> Faces:
    """The faces that `model.yaml` holds: rows of normal, area and centre.

    Raises:
        KeyError, ValueError: `given` has no such rows.
    """
    rows = np.asarray(given["faces"], float)
    if rows.ndim != 2 or rows.shape[1] != 7 or not np.isfinite(rows).all():
        raise ValueError("must have faces of seven numbers each: normal, area, centre")
    return Faces(rows[:, :3], rows[:, 3], rows[:, 4:])


def rows_of_mesh(corners: np.ndarray) -> list[list[float]]:
    """What `faces_of` reads, of triangles (t, 3, 3) from the centre of mass, wound so that their normals look outward."""
    oriented = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(oriented, axis=1)
    kept = areas > 1e-12 * areas.sum()
    oriented, areas, centres = oriented[kept], areas[kept], corners[kept].mean(axis=1)
    normals = oriented / areas[:, None]
    _, one = np.unique(np.round(normals, 6), axis=0, return_inverse=True)
    if one.max() >= MOST_FACES:
        one = np.argmax(normals @ sphere(MOST_FACES).T, axis=1)
    count = int(one.max()) + 1
    area, middle = np.bincount(one, areas, count), np.zeros((count, 3))
    normal = np.zeros((count, 3))
    np.add.at(middle, one, areas[:, None] * centres)
    np.add.at(normal, one, oriented)
    used = area > 0.0
    area, middle, normal = area[used], middle[used] / area[used, None], normal[used]
    # what looks a little aside is met by less
    size = np.linalg.norm(normal, axis=1)
    whole = areas.sum()
    return np.column_stack([normal / size[:, None], size / whole, middle / np.sqrt(whole)]).tolist()


def functions_of(faces: Faces, toward: Callable[[Any, Any], tuple[Any, Any, Any]], kinds: int = 3) -> dict[str, Any]:
    """The functions of an effect (`massprops.effects`) that pushes on the faces. Its parameters are the pressures of each kind
    (`Faces.pushed`), and then of each kind those times a lever along each axis.

    Args:
        toward: where it comes from, body axes, by attitude and surroundings; kinds: how many, from the first.
    """

    def unit_torques(t: Any, q: Any, w: Any, environment: Any) -> list[tuple[Any, ...]]:
        forces, torques = faces.pushed(toward(q, environment))
        out: list[tuple[Any, ...]] = [tuple(torques[k][..., i] for i in range(3)) for k in range(kinds)]
        for k in range(kinds):
            x, y, z = (forces[k][..., i] for i in range(3))
            out += [(0.0 * x, -z, y), (z, 0.0 * y, -x), (-y, x, 0.0 * z)]
        return out

    def torque(t: Any, q: Any, w: Any, p: Any, inertia: Any, environment: Any) -> tuple[Any, ...]:
        units = unit_torques(t, q, w, environment)
        return tuple(sum(v * u[i] for v, u in zip(p, units, strict=True)) for i in range(3))

    return {"torque": torque, "unit_torques": unit_torques, "LARGEST_TURN": LARGEST_TURN}
