"""A collision mesh: closed, few faces, with the mass properties of the full mesh within a stated tolerance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from massprops.errors import NotPossible
from massprops.native import mesh_set

if TYPE_CHECKING:
    import trimesh

MOST_FACES = 4800
TOLERANCE = 0.01
"""Largest difference of an element of the inertia, over the mean moment, of a mesh of fewer faces."""


def collision_mesh(mesh: trimesh.Trimesh, most_faces: int = MOST_FACES) -> trimesh.Trimesh:
    """Decimated by quadric edge collapses that keep the topology, then scaled about its centre to the same volume.

    Args:
        mesh: a closed body.
        most_faces: faces wanted.

    Returns:
        a closed mesh with at most `most_faces` faces whose volume is the same and whose inertia is within 1 %.

    Raises:
        NotPossible: no decimation keeps the inertia within 1 %.
    """
    import trimesh

    if len(mesh.faces) <= most_faces:
        return mesh
    worst = np.inf
    for target in (most_faces, int(0.9 * most_faces), int(0.75 * most_faces)):
        work = mesh_set(mesh.vertices, mesh.faces)
        work.meshing_decimation_quadric_edge_collapse(
            targetfacenum=target, preservetopology=True, preservenormal=True, optimalplacement=True, qualitythr=0.3
        )
        made = work.current_mesh()
        light = trimesh.Trimesh(made.vertex_matrix(), made.face_matrix(), process=False)
        if not light.is_volume or len(light.faces) > most_faces:
            continue
        centre = light.center_mass
        light.apply_translation(-centre)
        light.apply_scale((mesh.volume / light.volume) ** (1 / 3))
        light.apply_translation(mesh.center_mass)
        worst = float(np.abs(light.moment_inertia - mesh.moment_inertia).max() / np.trace(mesh.moment_inertia) * 3)
        if worst < TOLERANCE:
            return light
    raise NotPossible(
        f"no collision mesh of {most_faces} faces keeps the inertia within 1 % (best {100 * worst:.2g} %): export to csv or "
        "json, which have none"
    )
