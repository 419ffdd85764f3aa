"""Repairs a user's mesh: small holes, inverted faces, inside-out bodies. Every change becomes a warning."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from massprops.errors import InputError
from massprops.mass.bodies import one_solid

if TYPE_CHECKING:
    import trimesh

LARGEST_COORDINATE = 1e12
"""Its fifth power, times a density, is still a float."""
SMALLEST_SIZE = 1e-6
"""Equal corners are joined to 1e-8 when a file is read: a body of a hundred such steps keeps its shape."""
FARTHEST = 1e5
"""Distance over length at which single precision, which STL has, leaves a hundredth of the length."""
FLAT = 1e-9
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
    _refuse_shapeless(mesh)
    if mesh.is_watertight and mesh.is_winding_consistent:
        return _checked(*one_solid(mesh))
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
    if not (fixed.is_watertight and fixed.is_winding_consistent):
        raise InputError("mesh is not watertight and could not be closed: export it as a solid, or close it in MeshLab")
    fixed, more = one_solid(fixed)
    return _checked(fixed, (*notes, *more))


def _checked(mesh: trimesh.Trimesh, notes: tuple[str, ...]) -> tuple[trimesh.Trimesh, tuple[str, ...]]:
    if not mesh.is_volume:
        raise InputError(
            "mesh is closed but encloses no volume: its faces fold back on themselves; export it as a solid"
        )
    return mesh, notes


def _refuse_shapeless(mesh: trimesh.Trimesh) -> None:
    """A mesh that cannot be a solid for another reason than holes gets that reason.

    Raises:
        InputError: flat, too small or too large for its numbers, or too far from its origin.
    """
    vertices = np.asarray(mesh.vertices, float)
    if not len(vertices):
        raise InputError("mesh is flat: it encloses no volume; give a solid")
    largest = float(np.abs(vertices).max())
    if largest > LARGEST_COORDINATE:
        raise InputError(f"mesh has coordinates up to {largest:.3g}: give them in metres")
    middle = vertices.mean(0)
    size = float(np.ptp(vertices, axis=0).max())
    if mesh.is_watertight and size > SMALLEST_SIZE:
        return
    far = float(np.linalg.norm(middle))
    if far > max(FARTHEST * size, SMALLEST_SIZE):
        raise InputError(
            f"mesh of length {size:.3g} lies {far:.3g} from its origin, too far to keep its corners apart: move it to the origin"
        )
    if size <= SMALLEST_SIZE:
        raise InputError(
            f"mesh is less than {SMALLEST_SIZE:.0e} long: corners closer than 1e-8 are taken for one: export it in a "
            "smaller unit and give --scale"
        )
    spread = np.linalg.svd(vertices - middle, compute_uv=False)
    if len(vertices) < 4 or spread[2] <= FLAT * spread[0]:
        raise InputError("mesh is flat: it encloses no volume; give a solid")


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
        raise InputError(
            "mesh is not watertight: edges shared by more than two faces: export it as a solid, or repair it in MeshLab"
        )
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
                raise InputError("mesh is not watertight: a hole whose border is not one loop: close it in MeshLab")
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
            f"mesh is not watertight: {loops} holes, {100 * share:.0f} % of its area: too much to be closed; close it in a mesh editor"
        )
    notes.append(f"mesh: {loops} holes filled, {100 * share:.2g} % of the area")
    return trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=False)
