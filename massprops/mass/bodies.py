"""A surface of several closed parts: which are bodies, which are cavities, and where bodies overlap.

Volume and moments of a closed surface are sums over its parts. A part that is wound the wrong way, or lies in another
body, is then counted with the wrong sign or twice. manifold3d's exact set operations say which solid is meant.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import trimesh

MOST_PARTS = 300
"""Beyond it the parts are not held against each other: assemblies of screws take minutes."""
TWICE = 1e-6
"""Share of the volume counted twice that is reported: parts that only touch overlap by rounding."""


def one_solid(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, tuple[str, ...]]:
    """The solid that a closed, consistently wound mesh of any number of parts describes.

    - A part that is turned inward and lies in no body is a body inside out; it is turned.
    - A part turned inward that lies in a body is a cavity.
    - When all parts together enclose a negative volume, all are turned first.
    - Bodies that overlap are joined, so that what they share counts once.

    Args:
        mesh: watertight, neighbours wound alike; it is not changed.

    Returns:
        mesh with `is_volume` and a warning for each thing done.
    """
    import trimesh
    from trimesh.graph import connected_component_labels

    notes: list[str] = []
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
    if _volume(vertices, faces) < 0:
        faces = faces[:, ::-1]
        notes.append("mesh: was inside out, turned")
    label = connected_component_labels(mesh.face_adjacency, node_count=len(faces))
    count = int(label.max()) + 1
    if count > MOST_PARTS:
        notes.append(f"mesh: {count} separate parts: whether they overlap was not looked for")
    elif count > 1:
        parts = [faces[label == i] for i in range(count)]
        volumes = np.array([_volume(vertices, part) for part in parts])
        solids = [solid(vertices, p if v > 0 else p[:, ::-1]) for p, v in zip(parts, volumes, strict=True)]
        if all(s is not None for s in solids):
            joined, turned = _joined(solids, volumes, notes)
            if joined is not None:
                return joined, tuple(notes)
            if turned:
                faces = np.concatenate([p[:, ::-1] if i in turned else p for i, p in enumerate(parts)])
    if not notes:
        return mesh, ()
    return trimesh.Trimesh(vertices, faces, process=False), tuple(notes)


def _joined(solids: list[Any], volumes: np.ndarray, notes: list[str]) -> tuple[trimesh.Trimesh | None, set[int]]:
    """The union of the bodies less their cavities where bodies overlap, else None; and which parts are inside out."""
    import trimesh
    from manifold3d import Manifold

    whole, turned = Manifold(), set()
    # the larger first: what lies in a part comes after it
    for i in np.argsort(-np.abs(volumes), kind="stable"):
        if volumes[i] > 0:
            whole = whole + solids[i]
        elif (whole ^ solids[i]).volume() > 0.5 * abs(volumes[i]):
            whole = whole - solids[i]
        else:
            whole = whole + solids[i]
            turned.add(int(i))
    if turned:
        notes.append(f"mesh: {len(turned)} of {len(solids)} parts were inside out, turned")
    counted = float(volumes.sum()) + 2 * float(sum(abs(volumes[i]) for i in turned))
    excess = counted - whole.volume()
    if abs(excess) <= TWICE * whole.volume():
        return None, turned
    made = whole.to_mesh64()
    notes.append(
        f"mesh: its {len(solids)} parts overlap: joined, so that {100 * abs(excess) / whole.volume():.3g} % of the volume "
        "is not counted twice; a cavity must be wound inward"
    )
    return trimesh.Trimesh(made.vert_properties[:, :3], made.tri_verts, process=False), turned


def solid(vertices: np.ndarray, faces: np.ndarray) -> Any:
    """Vertices (v, 3) and faces (f, 3) as manifold3d's solid, or None where they are none (they cross or touch each other)."""
    from manifold3d import Error, Manifold, Mesh64

    used, index = np.unique(faces, return_inverse=True)
    solid = Manifold(Mesh64(np.ascontiguousarray(vertices[used]), index.reshape(faces.shape).astype(np.uint64)))
    return solid if solid.status() == Error.NoError and solid.volume() > 0 else None


def _volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Signed volume of a closed part."""
    a, b, c = (vertices[faces[:, i]] - vertices[faces[0, 0]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)
