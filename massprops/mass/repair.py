"""Closing a user's mesh: small holes, turned faces, inside-out bodies. Every change is told."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from massprops.errors import InputError

if TYPE_CHECKING:
    import trimesh

LARGEST_HOLE = 0.05
"""Greatest share of the mesh's area that filled holes may have: beyond it the shape would be our invention."""


def repair(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, tuple[str, ...]]:
    """A closed, outward mesh, and one warning for each thing that was done.

    Args:
        mesh: any triangle mesh; it is not changed.

    Returns:
        mesh with `is_volume`, warnings.

    Raises:
        InputError: no faces, coordinates that are not finite, or holes too large to be closed honestly.
    """
    if len(mesh.faces) == 0:
        raise InputError("mesh has no faces: give a surface, not a point cloud")
    if not np.isfinite(mesh.vertices).all():
        raise InputError("mesh has coordinates that are not finite: export it again")
    if mesh.is_volume:
        return mesh, ()
    import trimesh

    fixed = mesh.copy()
    notes = []
    before = len(fixed.faces)
    fixed.merge_vertices(merge_norm=True, merge_tex=True)
    fixed.update_faces(fixed.nondegenerate_faces() & fixed.unique_faces())
    if len(fixed.faces) < before:
        notes.append(f"mesh: {before - len(fixed.faces)} double or degenerate faces left out")
    if not fixed.is_watertight:
        fixed = _fill(fixed, notes)
    if not fixed.is_winding_consistent:
        trimesh.repair.fix_winding(fixed)
        notes.append("mesh: faces turned so that neighbours agree")
    if fixed.is_watertight and fixed.is_winding_consistent:
        bodies = fixed.body_count
        trimesh.repair.fix_inversion(fixed, multibody=bodies > 1)
        if mesh.is_watertight and mesh.is_winding_consistent:
            notes.append("mesh: was inside out, turned")
    if not fixed.is_volume:
        raise InputError("mesh is not closed and could not be closed: export it as a solid, or close it in MeshLab")
    return fixed, tuple(notes)


def _fill(mesh: trimesh.Trimesh, notes: list[str]) -> trimesh.Trimesh:
    """Every boundary loop closed by a fan about its middle."""
    import trimesh

    if not mesh.is_winding_consistent:
        trimesh.repair.fix_winding(mesh)
        notes.append("mesh: faces turned so that neighbours agree")
    edges = mesh.edges
    ordered = np.sort(edges, axis=1)
    _, inverse, count = np.unique(ordered, axis=0, return_inverse=True, return_counts=True)
    if (count > 2).any():
        raise InputError("mesh has edges shared by more than two faces: export it as a solid, or repair it in MeshLab")
    following: dict[int, list[int]] = {}
    for a, b in edges[count[inverse] == 1].tolist():
        following.setdefault(b, []).append(a)
    vertices, faces, added = [mesh.vertices], [mesh.faces], 0.0
    size, loops = len(mesh.vertices), 0
    while following:
        start = next(iter(following))
        loop = [start]
        while len(loop) == 1 or loop[-1] != start:
            after = following.get(loop[-1])
            if after is None:
                raise InputError("mesh has a hole whose border is not one loop: close it in MeshLab")
            here = loop[-1]
            loop.append(after.pop())
            if not after:
                del following[here]
        ring = np.array(loop[:-1])
        middle = mesh.vertices[ring].mean(0)
        fan = np.column_stack([ring, np.roll(ring, -1), np.full(len(ring), size)])
        corners = mesh.vertices[ring]
        added += 0.5 * np.linalg.norm(np.cross(corners - middle, np.roll(corners, -1, 0) - middle), axis=1).sum()
        vertices.append(middle[None])
        faces.append(fan)
        size, loops = size + 1, loops + 1
    share = added / (added + mesh.area)
    if share > LARGEST_HOLE:
        raise InputError(
            f"mesh has {loops} holes, {100 * share:.0f} % of its area: too much to be closed; close it in a mesh editor"
        )
    notes.append(f"mesh: {loops} holes filled, {100 * share:.2g} % of the area")
    return trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=False)
