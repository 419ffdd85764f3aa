"""Signed distances between two closed surfaces, exact on one side and sampled by area on the other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import trimesh

SAMPLES = 40_000
"""Points on a surface whose distances are taken."""
MOST_VERTICES = 200_000


def surface_samples(mesh: trimesh.Trimesh, count: int, seed: int, faces: np.ndarray | None = None) -> np.ndarray:
    """(count, 3) points spread over the surface by area; `faces` (f,) bool keeps to some of them."""
    rng = np.random.default_rng(seed)
    triangles = np.asarray(mesh.triangles)
    total = np.cumsum(np.asarray(mesh.area_faces) * (1.0 if faces is None else faces))
    pick = np.minimum(np.searchsorted(total, rng.random(count) * total[-1], side="right"), len(total) - 1)
    a, b = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    p: np.ndarray = triangles[pick]
    return (1 - a) * p[:, 0] + a * (1 - b) * p[:, 1] + a * b * p[:, 2]


class Surface:
    """One mesh made ready for closest-point queries; coordinates are centred, since open3d keeps them as float32."""

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        from massprops.native import ray_scene

        vertices = np.asarray(mesh.vertices, float)
        self._middle = 0.5 * (vertices.min(0) + vertices.max(0))
        self._scene = ray_scene((vertices - self._middle, mesh.faces))

    def _centred(self, points: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(points - self._middle, dtype=np.float32)

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Closest points (n, 3) on the surface, and the normals (n, 3) of their faces."""
        hit = self._scene.compute_closest_points(self._centred(points))
        normals = hit["primitive_normals"].numpy().astype(float)
        size = np.linalg.norm(normals, axis=1, keepdims=True)
        return hit["points"].numpy().astype(float) + self._middle, normals / np.where(size > 0, size, 1.0)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """(n,) unsigned distance of points (n, 3)."""
        return np.asarray(self._scene.compute_distance(self._centred(points)).numpy(), float)

    def signed(self, points: np.ndarray) -> np.ndarray:
        """(n,) distance, positive outside the closed surface; three rays vote on the side."""
        return np.asarray(self._scene.compute_signed_distance(self._centred(points), nsamples=3).numpy(), float)


def surface_distances(ours: trimesh.Trimesh, cad: trimesh.Trimesh, length: float, seed: int = 0) -> dict[str, Any]:
    """How far two surfaces in one frame are apart.

    Args:
        ours, cad: closed meshes, lengths in metres.
        length: greatest length of the CAD [m], kept beside the distances.
        seed: of the samples.

    Returns:
        `length`, `hausdorff`, and for `ours` (from our surface to the CAD) and `cad` (from the CAD to ours) each
        `median` of the absolute distance, `mean_signed`, `rms`, `p95` and `hausdorff` [m]. Signed distances are
        positive where our surface lies outside the CAD's, in both directions. Vertices join the samples for the
        Hausdorff distances, whose extremes lie there.
    """
    out: dict[str, Any] = {"length": length, "unit": "m"}
    for name, mesh, other, sign in (("ours", ours, cad, 1.0), ("cad", cad, ours, -1.0)):
        surface = Surface(other)
        signed = sign * surface.signed(surface_samples(mesh, SAMPLES, seed))
        corners = surface.distance(np.asarray(mesh.vertices)[:MOST_VERTICES])
        size = np.abs(signed)
        out[name] = {
            "median": float(np.median(size)),
            "mean_signed": float(signed.mean()),
            "rms": float(np.sqrt(np.mean(signed**2))),
            "p95": float(np.percentile(size, 95)),
            "hausdorff": float(max(size.max(), corners.max())),
        }
    out["hausdorff"] = max(out["ours"]["hausdorff"], out["cad"]["hausdorff"])
    return out
