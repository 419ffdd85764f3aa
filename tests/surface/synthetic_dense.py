"""Dense points and silhouettes of a known body, made by casting rays: what the stages before would hand over."""

from __future__ import annotations

import numpy as np
import trimesh

from massprops.surface.cloud import Cloud
from massprops.views import Views

SIZE = (320, 240)


def cameras(directions: np.ndarray, distance: float, focal: float, size: tuple[int, int] = SIZE) -> Views:
    """Cameras that look at the origin from `directions` (n, 3)."""
    n = len(directions)
    z = -directions / np.linalg.norm(directions, axis=1, keepdims=True)
    helper = np.where(np.abs(z[:, 2:]) < 0.9, [[0, 0, 1.0]], [[0, 1.0, 0]])
    x = np.cross(helper, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    R = np.stack([x, np.cross(z, x), z], axis=1)
    K = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]])
    return Views(
        tuple(f"cam0/{i:06d}.png" for i in range(n)),
        np.arange(n) * 10**9,
        np.tile(size, (n, 1)),
        np.tile(K, (n, 1, 1)),
        np.zeros((n, 4)),
        R,
        np.tile([0, 0, distance], (n, 1)).astype(float),
    )


def sphere_directions(n: int) -> np.ndarray:
    """(n, 3) evenly spread directions."""
    i = np.arange(n) + 0.5
    z, a = 1 - 2 * i / n, np.pi * (1 + 5**0.5) * i
    r = np.sqrt(1 - z * z)
    return np.column_stack([r * np.cos(a), r * np.sin(a), z])


def observe(
    mesh: trimesh.Trimesh,
    views: Views,
    noise: float,
    seed: int,
    outliers: float = 0.01,
    grazing: float = 0.25,
    most: int = 150_000,
) -> tuple[Cloud, list[np.ndarray]]:
    """What ideal stereo would measure of a body: points where a pixel's ray meets it, `most` of them, with noise, and silhouettes."""
    rng = np.random.default_rng(seed)
    w, h = (int(k) for k in views.size[0])
    u, v = np.meshgrid(np.arange(w), np.arange(h))
    pixels = np.column_stack([u.ravel(), v.ravel(), np.ones(w * h)])
    masks, depths, hits = [], [], []
    caster, normals, corner = mesh.ray, np.asarray(mesh.face_normals), np.asarray(mesh.triangles)[:, 0]
    for i in range(len(views)):
        rays = pixels @ np.linalg.inv(views.K[i]).T @ views.R[i]
        face = caster.intersects_first(np.tile(views.centres[i], (len(rays), 1)), rays)
        hit = np.flatnonzero(face >= 0)
        rays, n = rays[hit], normals[face[hit]]
        s = np.einsum("ij,ij->i", corner[face[hit]] - views.centres[i], n) / np.einsum("ij,ij->i", rays, n)
        depth = np.full(w * h, np.inf)
        depth[hit] = s
        masks.append(np.where(face >= 0, 255, 0).astype(np.uint8).reshape(h, w))
        depths.append(depth.reshape(h, w))
        good = -np.einsum("ij,ij->i", rays / np.linalg.norm(rays, axis=1, keepdims=True), n) > grazing
        hits.append((views.centres[i] + s[good, None] * rays[good], n[good]))
    xyz = np.concatenate([a for a, _ in hits])
    normal = np.concatenate([b for _, b in hits])
    pick = np.sort(rng.permutation(len(xyz))[:most])
    xyz, normal = xyz[pick], normal[pick]
    seen = np.zeros((len(xyz), len(views)), bool)
    for i in range(len(views)):
        back = views.centres[i] - xyz
        along = np.einsum("ij,ij->i", back, normal)
        # few of all face a view
        own = np.flatnonzero(along > 0)
        own = own[along[own] / np.sqrt(np.einsum("ij,ij->i", back[own], back[own])) > grazing]
        c = xyz[own] @ views.R[i].T + views.t[i]
        p = np.rint((c / c[:, 2:]) @ views.K[i].T).astype(int)
        ok = (p[:, 0] >= 0) & (p[:, 1] >= 0) & (p[:, 0] < w) & (p[:, 1] < h)
        d = depths[i][np.clip(p[:, 1], 0, h - 1), np.clip(p[:, 0], 0, w - 1)]
        seen[own, i] = ok & (np.abs(d - c[:, 2]) < 0.01 * c[:, 2])
    some = seen.sum(1) >= 2
    xyz, normal, seen = xyz[some], normal[some], seen[some]
    xyz = xyz + noise * rng.standard_normal((len(xyz), 1)) * normal
    wild = rng.random(len(xyz)) < outliers
    xyz[wild] += 20 * noise * rng.standard_normal((wild.sum(), 1)) * normal[wild]
    turned = normal + 0.08 * rng.standard_normal(normal.shape)
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    start = np.concatenate([[0], np.cumsum(seen.sum(1))])
    return Cloud(xyz, turned, np.full(len(xyz), noise), start, np.nonzero(seen)[1]), masks


def boxes(*parts: tuple[tuple[float, float, float], tuple[float, float, float]]) -> trimesh.Trimesh:
    """Boxes of given (size, centre) that touch but do not overlap: one body whose integrals are the sum."""
    return trimesh.util.concatenate(
        [trimesh.creation.box(s, trimesh.transformations.translation_matrix(c)) for s, c in parts]
    )


def spacecraft() -> trimesh.Trimesh:
    """A bus with two arrays whose thickness is 1 % of the span (1.0)."""
    return boxes(
        ((0.25, 0.22, 0.3), (0, 0, 0)),
        ((0.075, 0.03, 0.03), (0.1625, 0, 0)),
        ((0.075, 0.03, 0.03), (-0.1625, 0, 0)),
        ((0.3, 0.24, 0.01), (0.35, 0, 0)),
        ((0.3, 0.24, 0.01), (-0.35, 0, 0)),
    )


def asteroid() -> trimesh.Trimesh:
    """A smooth two-lobed body about 1 long."""
    mesh = trimesh.creation.icosphere(6)
    d = mesh.vertices
    r = 0.33 + 0.17 * d[:, 0] ** 2 + 0.04 * d[:, 0] + 0.015 * np.sin(5 * d[:, 1] + 1) * np.cos(4 * d[:, 2])
    mesh.vertices = d * r[:, None] * [1, 0.85, 0.75]
    return mesh
