"""Renders a body under one sun by ray casting: hard shadows, texture, ambient light, sensor noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.dynamics.quaternion import rotation_matrix
from massprops.errors import InputError
from massprops.geometry.projection import project
from massprops.geometry.vectors import unit
from massprops.simulation.scenario import Scenario

if TYPE_CHECKING:
    import trimesh

SUPER = 2
"""Rays per pixel side."""


@dataclass(frozen=True)
class Lens:
    """Pinhole K (3, 3) with radial distortion (4,) k1, k2, p1, p2; size (width, height). Pixel centres at whole numbers."""

    K: np.ndarray
    distortion: np.ndarray
    size: tuple[int, int]


def lens_of(scenario: Scenario) -> Lens:
    """The scenario's camera."""
    w, h = scenario.size
    f = scenario.focal * w
    return Lens(
        np.array([[f, 0, (w - 1) / 2], [0, f, (h - 1) / 2], [0, 0, 1.0]]),
        np.array([*scenario.distortion, 0.0, 0.0]),
        (w, h),
    )


def undistorted_radius(seen: np.ndarray, k1: float, k2: float) -> np.ndarray:
    """Solves seen = r (1 + k1 r^2 + k2 r^4), OpenCV's radial terms, for r on the lens's own branch, by bisection.

    Args:
        seen: (n,) distance from the principal point over the focal length, as the image shows it.
        k1, k2: OpenCV's.

    Raises:
        InputError: the farthest of them is beyond what such a lens shows anywhere.
    """
    # the image of r turns back where d/dr = 1 + 3 k1 r^2 + 5 k2 r^4 reaches zero
    turns = [s.real for s in np.roots([5 * k2, 3 * k1, 1.0]) if abs(s.imag) < 1e-12 and s.real > 0]
    farthest = np.sqrt(min(turns)) if turns else 1e3
    low, high = np.zeros_like(seen), np.full_like(seen, farthest)
    if not np.all(seen <= farthest * (1 + k1 * farthest**2 + k2 * farthest**4)):
        raise InputError(
            f"distortion {k1:g}, {k2:g}: such a lens shows nothing in the image's corners; "
            "give smaller values or a longer focal length"
        )
    for _ in range(60):
        r = 0.5 * (low + high)
        short = r * (1 + k1 * r**2 + k2 * r**4) < seen
        low, high = np.where(short, r, low), np.where(short, high, r)
    return 0.5 * (low + high)


class Renderer:
    """Renders frames of one scene; everything that does not change between frames is made once."""

    def __init__(self, mesh: trimesh.Trimesh, scenario: Scenario, lens: Lens) -> None:
        from massprops.native import ray_scene

        self.mesh, self.scenario, self.lens = mesh, scenario, lens
        meshes = [(np.asarray(mesh.vertices), np.asarray(mesh.faces))]
        self.floor = None
        if scenario.motion == "static":
            self.floor = float(mesh.vertices[:, 2].min())
            reach = 60.0 * mesh.extents.max()
            corners = np.array([[x, y, self.floor] for x in (-reach, reach) for y in (-reach, reach)])
            meshes.append((corners, np.array([[0, 2, 1], [1, 2, 3]])))
        self.scene = ray_scene(*meshes)
        size = scenario.texture_m if scenario.texture_m > 0 else 0.12 * float(mesh.extents.max())
        self.noise, self.ground = Noise(scenario.seed, size), Noise(scenario.seed + 7, 1.5 * size)
        self.normals = np.asarray(mesh.vertex_normals if scenario.smooth else mesh.face_normals)
        self.rays = self._rays()
        self.backdrop = self._backdrop()

    def _rays(self) -> np.ndarray:
        """(h * SUPER, w * SUPER, 3) directions in the camera, z = 1, through the lens's distortion."""
        w, h = self.lens.size
        u = (np.arange(w * SUPER) + 0.5) / SUPER - 0.5
        v = (np.arange(h * SUPER) + 0.5) / SUPER - 0.5
        grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
        xy = (grid - self.lens.K[:2, 2]) / np.diag(self.lens.K)[:2]
        if np.any(self.lens.distortion):
            seen = np.linalg.norm(xy, axis=1)
            xy = xy * (undistorted_radius(seen, *self.lens.distortion[:2]) / np.maximum(seen, 1e-12))[:, None]
        return np.column_stack([xy, np.ones(len(xy))]).reshape(h * SUPER, w * SUPER, 3).astype(np.float32)

    def _backdrop(self) -> np.ndarray:
        """(h, w) grey background, the same in every frame."""
        w, h = self.lens.size
        if self.scenario.background == "black" or self.scenario.motion == "static":
            return np.full((h, w), 2.0 if self.scenario.motion == "tumbling" else 150.0)
        x, y = np.meshgrid(np.arange(w) / w * 4.0, np.arange(h) / w * 4.0)
        flat = Noise(self.scenario.seed + 11, 1.0)(np.column_stack([x.ravel(), y.ravel(), np.zeros(w * h)]))
        return np.clip(85 + 30 * flat.reshape(h, w), 5, 200)

    def window(self, R: np.ndarray, t: np.ndarray) -> tuple[slice, slice]:
        """Rows and columns of rays that can meet the body."""
        h, w = self.rays.shape[:2]
        if self.floor is not None:
            return slice(0, h), slice(0, w)
        uv, depth = project(np.asarray(self.mesh.vertices), self.lens.K, R, t)
        if (depth <= 1e-6).any() or np.any(self.lens.distortion):
            return slice(0, h), slice(0, w)
        low, high = np.floor(uv.min(0)) - 2, np.ceil(uv.max(0)) + 3
        c0, r0 = np.clip(low * SUPER, 0, [w, h]).astype(int)
        c1, r1 = np.clip(high * SUPER, 0, [w, h]).astype(int)
        return slice(r0 // SUPER * SUPER, r1 // SUPER * SUPER), slice(c0 // SUPER * SUPER, c1 // SUPER * SUPER)

    def frame(
        self, q: np.ndarray, position: np.ndarray, sun: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """One image.

        Args:
            q: (4,) body to camera; position: (3,) body origin in the camera [m]; sun: (3,) in body axes.
            rng: of the sensor's noise.

        Returns:
            image (h, w) uint8; faces of the body seen in sunlight at less than 70 degrees from both Sun and camera.
        """
        R = rotation_matrix(q)
        rows, columns = self.window(R, position)
        part = self.rays[rows, columns]
        shape = part.shape[:2]
        light = np.full(shape, np.nan, np.float32)
        lit = np.zeros(0, int)
        if part.size:
            light, lit = self._light(part.reshape(-1, 3), R, position, sun, shape)
        h, w = self.lens.size[1], self.lens.size[0]
        fine = np.repeat(np.repeat(self.backdrop, SUPER, 0), SUPER, 1).astype(np.float32)
        inside = ~np.isnan(light)
        fine[rows, columns][inside] = light[inside] * self.scenario.exposure
        grey = fine.reshape(h, SUPER, w, SUPER).mean(axis=(1, 3))
        sigma = self.scenario.noise * np.sqrt(1.0 + np.maximum(grey, 0) / 60.0)
        return np.clip(np.round(grey + sigma * rng.standard_normal(grey.shape)), 0, 255).astype(np.uint8), lit

    def _light(
        self, rays: np.ndarray, R: np.ndarray, t: np.ndarray, sun: np.ndarray, shape: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        origin, direction = -R.T @ t, rays @ R.astype(np.float32)
        query = np.concatenate([np.broadcast_to(origin.astype(np.float32), direction.shape), direction], axis=1)
        answer = self.scene.cast_rays(np.ascontiguousarray(query))
        depth = answer["t_hit"].numpy()
        hit = np.isfinite(depth)
        face, part = answer["primitive_ids"].numpy()[hit], answer["geometry_ids"].numpy()[hit]
        point = origin + direction[hit] * depth[hit, None]
        body = part == 0
        normal = np.tile([0.0, 0.0, 1.0], (len(point), 1))
        normal[body] = self._normal(face[body], answer["primitive_uvs"].numpy()[hit][body])
        size = float(self.mesh.extents.max())
        shadow_query = np.concatenate([point + 2e-4 * size * normal, np.broadcast_to(sun, point.shape)], axis=1)
        shadow = np.isfinite(self.scene.cast_rays(shadow_query.astype(np.float32))["t_hit"].numpy())
        toward = np.clip(normal @ sun, 0, 1)
        direct = toward * ~shadow
        view = -direction[hit] / np.linalg.norm(direction[hit], axis=1, keepdims=True)
        half = view + sun
        half /= np.linalg.norm(half, axis=1, keepdims=True) + 1e-12
        albedo = np.empty(len(point), np.float32)
        albedo[body] = np.clip(self.scenario.albedo * (1 + 0.5 * self.noise(point[body])), 0.05, 1.0)
        albedo[body] *= 1.0 - 0.3 * panel_lines(point[body], self.scenario.grid_m)
        if (~body).any():
            albedo[~body] = np.clip(0.35 + 0.15 * self.ground(point[~body]), 0.05, 1.0)
        shine = self.scenario.specular * body * direct * np.clip(np.einsum("ni,ni->n", normal, half), 0, 1) ** 40
        out = np.full(shape[0] * shape[1], np.nan, np.float32)
        out[hit] = albedo * (self.scenario.ambient + (1 - self.scenario.ambient) * direct) + shine
        good = body & (direct > 0.34) & (np.einsum("ni,ni->n", normal, view) > 0.34)
        return out.reshape(shape), np.unique(face[good])

    def _normal(self, face: np.ndarray, uv: np.ndarray) -> np.ndarray:
        if not self.scenario.smooth:
            return self.normals[face]
        corner = self.normals[np.asarray(self.mesh.faces)[face]]
        weight = np.column_stack([1 - uv.sum(axis=1), uv])
        return unit(np.einsum("nk,nki->ni", weight, corner))


LATTICE = 48


class Noise:
    """Texture in body axes, the same on every frame: several octaves of smooth random values, -1 to 1 or so, periodic far
    outside any body."""

    def __init__(self, seed: int, size: float, octaves: int = 6, falloff: float = 0.8) -> None:
        """Args: seed; size of the largest texture [m]; octaves; amplitude from one octave to the next."""
        rng = np.random.default_rng([seed, 2])
        self.lattice = rng.uniform(-1, 1, (LATTICE, LATTICE, LATTICE)).astype(np.float32)
        self.shift = rng.uniform(0, LATTICE, (octaves, 3))
        self.size, self.octaves, self.falloff = size, octaves, falloff

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Values (n,) at points (n, 3)."""
        from scipy.ndimage import map_coordinates

        out, amplitude = np.zeros(len(points), np.float32), 1.0
        for k in range(self.octaves):
            where = (points * (2.0**k * 2.0 / self.size) + self.shift[k]).T
            out += amplitude * map_coordinates(self.lattice, where, order=1, mode="grid-wrap", output=np.float32)
            amplitude *= self.falloff
        return out


def panel_lines(points: np.ndarray, spacing: float) -> np.ndarray:
    """(n,) of points (n, 3): 1 on dark lines of a grid in body axes, 0 elsewhere; lines are 4 % of the spacing wide."""
    if spacing <= 0:
        return np.zeros(len(points), np.float32)
    fraction = np.abs(points / spacing - np.round(points / spacing))
    return (np.sort(fraction, axis=1)[:, 0] < 0.02).astype(np.float32)
