"""Lays one closed body on another: every plausible start, then iterative closest points to the planes of the target."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True)
class Similarity:
    """x -> scale * R x + t, from the source's frame to the target's."""

    scale: float
    R: np.ndarray
    t: np.ndarray

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) in the target's frame."""
        return self.scale * points @ self.R.T + self.t

    @property
    def matrix(self) -> np.ndarray:
        """(4, 4)."""
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = self.scale * self.R, self.t
        return out


def surface_samples(mesh: trimesh.Trimesh, count: int, seed: int, faces: np.ndarray | None = None) -> np.ndarray:
    """(count, 3) points spread over the surface by area; `faces` (f,) bool keeps to some of them."""
    rng = np.random.default_rng(seed)
    triangles = np.asarray(mesh.triangles)
    area = np.asarray(mesh.area_faces) * (1.0 if faces is None else faces)
    pick = np.searchsorted(np.cumsum(area), rng.random(count) * area.sum())
    pick = np.minimum(pick, len(area) - 1)
    a, b = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    p = triangles[pick]
    return (1 - a) * p[:, 0] + a * (1 - b) * p[:, 1] + a * b * p[:, 2]


def starts(source_axes: np.ndarray, target_axes: np.ndarray) -> np.ndarray:
    """Rotations to try: (n, 3, 3).

    Principal frames on each other in their 24 ways; turns about each principal axis by 15 degrees, for bodies with two
    like moments; and an even net over all rotations, for bodies whose moments say little.
    """
    cube = []
    for order in permutations(range(3)):
        for sign in product((1, -1), repeat=3):
            m = np.zeros((3, 3))
            m[np.arange(3), order] = sign
            if np.linalg.det(m) > 0:
                cube.append(m)
    out = [target_axes @ m @ source_axes.T for m in cube]
    flips = [m for m in cube if np.count_nonzero(np.diag(m)) == 3]
    for axis in range(3):
        for step in range(1, 24):
            turn = _turn(np.eye(3)[axis], np.radians(15 * step))
            out += [target_axes @ turn @ m @ source_axes.T for m in flips]
    # super-Fibonacci spiral over the quaternions (Alexa 2022)
    n, phi, psi = 400, np.sqrt(2.0), 1.533751168755204288118041
    s = np.arange(n) + 0.5
    r, R = np.sqrt(s / n), np.sqrt(1 - s / n)
    a, b = 2 * np.pi * s / phi, 2 * np.pi * s / psi
    from massprops.dynamics.quaternion import rotation_matrix

    net = rotation_matrix(np.column_stack([r * np.sin(a), r * np.cos(a), R * np.sin(b), R * np.cos(b)]))
    return np.concatenate([np.stack(out), net])


def _turn(axis: np.ndarray, angle: float) -> np.ndarray:
    from massprops.dynamics.quaternion import from_rotation_vector, rotation_matrix

    return rotation_matrix(from_rotation_vector(axis * angle))


def closest(scene: Any, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Closest points (n, 3) on the scene's mesh and the normals (n, 3) of their faces."""
    from massprops.native import load_open3d

    o3d = load_open3d()
    hit = scene.compute_closest_points(o3d.core.Tensor(np.ascontiguousarray(points, dtype=np.float32)))
    return hit["points"].numpy().astype(float), hit["primitive_normals"].numpy().astype(float)


def scene_of(mesh: trimesh.Trimesh) -> Any:
    """An open3d ray-casting scene of one mesh."""
    from massprops.native import load_open3d

    o3d = load_open3d()
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(np.asarray(mesh.vertices, np.float32)), o3d.core.Tensor(np.asarray(mesh.faces, np.uint32))
    )
    return scene


def align(
    source: trimesh.Trimesh,
    target: trimesh.Trimesh,
    free_scale: bool,
    measured: np.ndarray | None = None,
    seed: int = 0,
) -> Similarity:
    """The similarity that lays `source` on `target`.

    Args:
        source, target: closed meshes.
        free_scale: whether the scale is found too; 1 otherwise.
        measured: (f,) bool faces of the source that were measured; the fit uses them alone.
        seed: of the samples.
    """
    from scipy.spatial import cKDTree

    from massprops.mass.properties import mass_properties

    a, b = mass_properties(source, 1.0), mass_properties(target, 1.0)
    scale = (b.volume / a.volume) ** (1 / 3) if free_scale else 1.0
    few = scale * (surface_samples(source, 250, seed, measured) - a.center_of_mass)
    goal = surface_samples(target, 6000, seed + 1)
    tree = cKDTree(goal)
    normals = closest_normals(target, goal)
    rotations = starts(a.principal_axes, b.principal_axes)
    moved = np.einsum("rij,nj->rni", rotations, few) + b.center_of_mass
    distance = tree.query(moved.reshape(-1, 3))[0].reshape(len(rotations), -1)
    score = np.sort(distance, axis=1)[:, : int(0.9 * distance.shape[1])].mean(axis=1)
    best: tuple[float, Similarity] | None = None
    own = surface_samples(source, 1500, seed + 2, measured)
    for k in np.argsort(score, kind="stable")[:24]:
        start = Similarity(scale, rotations[k], b.center_of_mass - scale * rotations[k] @ a.center_of_mass)

        def nearest(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            at = tree.query(points)[1]
            return goal[at], normals[at]

        rough = _iterate(start, own, nearest, free_scale, steps=12)
        left = np.sort(np.linalg.norm(nearest(rough.apply(own))[0] - rough.apply(own), axis=1))
        value = float(left[: int(0.9 * len(left))].mean())
        if best is None or value < best[0] - 1e-12:
            best = (value, rough)
    assert best is not None
    scene = scene_of(target)
    many = surface_samples(source, 8000, seed + 3, measured)
    return _iterate(best[1], many, lambda p: closest(scene, p), free_scale, steps=40)


def closest_normals(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Face normals (n, 3) at the closest points of a mesh."""
    return closest(scene_of(mesh), points)[1]


def _iterate(start: Similarity, points: np.ndarray, nearest: Any, free_scale: bool, steps: int) -> Similarity:
    """Point-to-plane iterations with weights that fade beyond the usual residual."""
    from massprops.dynamics.quaternion import from_rotation_vector, rotation_matrix

    now = start
    for _ in range(steps):
        p = now.apply(points)
        q, n = nearest(p)
        residual = np.einsum("ni,ni->n", p - q, n)
        width = 2.5 * max(1.4826 * float(np.median(np.abs(residual))), 1e-12)
        weight = 1.0 / (1.0 + (residual / width) ** 2)
        weight *= np.linalg.norm(p - q, axis=1) < 6.0 * width + 3.0 * float(np.median(np.linalg.norm(p - q, axis=1)))
        middle = p.mean(axis=0)
        arm = p - middle
        columns = [np.cross(arm, n), n]
        if free_scale:
            columns.append(np.einsum("ni,ni->n", arm, n)[:, None])
        J = np.concatenate(columns, axis=1)
        normal = J.T @ (weight[:, None] * J)
        # a body of revolution leaves a direction open: do not move along it
        step = -np.linalg.lstsq(normal, J.T @ (weight * residual), rcond=1e-9)[0]
        turn = rotation_matrix(from_rotation_vector(step[:3]))
        grow = 1.0 + (float(step[6]) if free_scale else 0.0)
        now = Similarity(now.scale * grow, turn @ now.R, grow * turn @ (now.t - middle) + middle + step[3:6])
        if np.linalg.norm(step[:3]) < 1e-9 and np.linalg.norm(step[3:6]) < 1e-9 * max(1.0, float(np.abs(p).max())):
            break
    return now
