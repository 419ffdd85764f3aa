"""The objects: scanned ones with their pictures, and our own as closed meshes. Lengths in metres.

Our own are put together from simple solids by exact booleans, so each is one closed body.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh
from trimesh.transformations import rotation_matrix

from tabletop import textures
from tabletop.scenes import Scene


@dataclass(frozen=True, kw_only=True)
class Item:
    """An object as it is rendered.

    Attributes:
        mesh: closed and outward-wound, in its own axes [m].
        image: (n, n, 3) uint8 RGB of its surface.
        drawn: the mesh as drawn, where pictures are laid on by `uv`; `mesh` itself otherwise.
        uv: (v, 2) of the vertices of `drawn`, or None: the image is laid on along the three axes, every `span`.
        span: width of the image on the surface [m].
        look: of the renderer's surface: roughness, metallic, coat, bump.
    """

    mesh: trimesh.Trimesh
    image: np.ndarray
    drawn: trimesh.Trimesh
    uv: np.ndarray | None = None
    span: float = 0.1
    look: dict[str, Any] = field(default_factory=dict)


def make_item(scene: Scene, scans: Path) -> Item:
    """The object of a scene.

    Args:
        scene: says which.
        scans: folder of the scanned objects.

    Raises:
        ValueError: the object is not one closed body.
    """
    item = scanned(scans / scene.item, scene) if scene.item[0].isdigit() else own(scene)
    if not item.mesh.is_volume:
        raise ValueError(f"{scene.item}: not a closed body")
    return item


def scanned(folder: Path, scene: Scene) -> Item:
    """A scanned object; its texture is reduced to 2048 pixels, more than the images resolve."""
    drawn = trimesh.load(folder / "textured.obj", process=False, force="mesh")
    uv = np.asarray(drawn.visual.uv)
    mesh = trimesh.Trimesh(drawn.vertices, drawn.faces, process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    image = cv2.cvtColor(cv2.imread(str(folder / "texture_map.jpg")), cv2.COLOR_BGR2RGB)
    image = cv2.resize(image, (2048, 2048), interpolation=cv2.INTER_AREA)
    look = {"roughness": 0.18, "coat": 0.4} if scene.finish == "glossy" else {"roughness": 0.5}
    return Item(mesh=mesh, image=image, drawn=drawn, uv=uv, look=look)


def own(scene: Scene) -> Item:
    """One of `KINDS`, drawn from the scene's own seed."""
    rng = scene.generator()
    mesh, picture = KINDS[scene.item](rng)
    look: dict[str, Any] = {"roughness": 0.6, "bump": 0.1}
    if scene.finish == "plain":
        picture, look = textures.faint, {"roughness": 0.7}
    if scene.finish == "glossy":
        look = {"roughness": 0.25, "coat": 0.5}
    if picture is textures.metal:
        look["metallic"] = 0.9 if scene.finish == "glossy" else 0.4
        look["roughness"] = 0.3 if scene.finish == "glossy" else 0.5
    return Item(mesh=mesh, image=picture(rng), drawn=mesh, span=float(0.8 * mesh.extents.max()), look=look)


Made = tuple[trimesh.Trimesh, Callable[[np.random.Generator], np.ndarray]]


def _join(parts: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    return trimesh.boolean.union(parts, engine="manifold")


def _at(mesh: trimesh.Trimesh, *where: float) -> trimesh.Trimesh:
    mesh.apply_translation(where)
    return mesh


def _rod(radius: float, start: np.ndarray, end: np.ndarray) -> trimesh.Trimesh:
    return trimesh.creation.cylinder(radius, segment=np.array([start, end]), sections=32)


def _turned(profile: np.ndarray) -> trimesh.Trimesh:
    """A body of revolution: rows (radius, height) from the axis below to the axis above."""
    return trimesh.creation.revolve(profile, sections=96)


def figure(rng: np.random.Generator) -> Made:
    """A robed figure on a flat base, arms to the side, one of them raised, with a hat."""
    tall = rng.uniform(0.11, 0.2)
    h, r = tall, 0.24 * tall
    robe = _turned(
        np.array(
            [
                [0, 0],
                [r, 0],
                [r, 0.05 * h],
                [0.75 * r, 0.1 * h],
                [0.62 * r, 0.4 * h],
                [0.7 * r, 0.62 * h],
                [0.28 * r, 0.72 * h],
                [0, 0.72 * h],
            ]
        )
    )
    head = _at(trimesh.creation.icosphere(3, 0.115 * h), 0, 0.02 * h, 0.79 * h)
    nose = _at(trimesh.creation.icosphere(2, 0.03 * h), 0, 0.14 * h, 0.79 * h)
    hat = _at(
        _turned(
            np.array(
                [[0, 0], [0.15 * h, 0], [0.15 * h, 0.02 * h], [0.08 * h, 0.03 * h], [0.05 * h, 0.14 * h], [0, 0.14 * h]]
            )
        ),
        0,
        0,
        0.86 * h,
    )
    parts = [robe, head, nose, hat]
    for side, lift in ((1, rng.uniform(0.1, 0.3)), (-1, -rng.uniform(0.1, 0.25))):
        shoulder = np.array([side * 0.12 * h, 0, 0.6 * h])
        hand = np.array([side * rng.uniform(0.24, 0.3) * h, rng.uniform(0, 0.15) * h, (0.6 + lift) * h])
        parts += [_rod(0.045 * h, shoulder, hand), _at(trimesh.creation.icosphere(2, 0.055 * h), *hand)]
    pack = trimesh.creation.box((0.2 * h, 0.14 * h, 0.2 * h))
    return _join([*parts, _at(pack, 0, -0.16 * h, 0.5 * h)]), textures.painted


def chair(rng: np.random.Generator) -> Made:
    """A model chair: four thin legs, rungs and a slatted back."""
    w, deep, seat, back = (
        rng.uniform(0.07, 0.1),
        rng.uniform(0.07, 0.09),
        rng.uniform(0.08, 0.11),
        rng.uniform(0.08, 0.12),
    )
    leg = rng.uniform(0.0035, 0.005)
    parts = [_at(trimesh.creation.box((w, deep, 0.008)), 0, 0, seat)]
    for x in (-1, 1):
        for y in (-1, 1):
            foot = np.array([x * (w / 2 - leg), y * (deep / 2 - leg), 0.0])
            top = foot * [0.9, 0.9, 1] + [0, 0, seat]
            parts.append(_rod(leg, foot, top))
        post = np.array([x * (w / 2 - leg), deep / 2 - leg, seat])
        parts.append(_rod(leg, post, post + [0, 0.015, back]))
        a = np.array([x * (w / 2 - 1.2 * leg), 0, 0.4 * seat])
        parts.append(_rod(0.7 * leg, a - [0, deep / 2 - 1.2 * leg, 0], a + [0, deep / 2 - 1.2 * leg, 0]))
    for height in np.linspace(0.4, 0.95, int(rng.integers(2, 4))):
        y = deep / 2 - leg + 0.015 * height
        parts.append(_at(trimesh.creation.box((w - leg, 0.005, 0.016)), 0, y, seat + back * height))
    return _join(parts), textures.wood if rng.random() < 0.5 else textures.painted


def rock(rng: np.random.Generator) -> Made:
    """A boulder with broken faces and waves of every size."""
    sphere = trimesh.creation.icosphere(5)
    d = sphere.vertices
    radius = np.full(len(d), 1.3)
    for _ in range(14):
        n = rng.standard_normal(3)
        cos = d @ (n / np.linalg.norm(n))
        radius = np.where(cos > 0.05, np.minimum(radius, rng.uniform(0.75, 1.1) / np.maximum(cos, 0.05)), radius)
    for wave in 2.0 ** np.arange(1, 6):
        for _ in range(4):
            radius += 0.045 / wave * np.sin(wave * (d @ rng.standard_normal(3)) * 2 + rng.uniform(0, 6.28))
    vertices = d * radius[:, None] * rng.uniform(0.6, 1.1, 3)
    vertices *= rng.uniform(0.08, 0.16) / np.ptp(vertices, axis=0).max()
    return trimesh.Trimesh(vertices, sphere.faces, process=False), textures.stone


def part(rng: np.random.Generator) -> Made:
    """A machined bracket: plate and boss with bores, a slot, a step and a rib."""
    x, y, z = rng.uniform(0.09, 0.14), rng.uniform(0.06, 0.08), rng.uniform(0.015, 0.022)
    boss = rng.uniform(0.018, 0.025)
    high = rng.uniform(0.03, 0.05)
    bore = 0.55 * boss
    solid = _join(
        [
            trimesh.creation.box((x, y, z)),
            _at(trimesh.creation.cylinder(boss, high, sections=96), -0.2 * x, 0, high / 2),
            _at(trimesh.creation.box((0.3 * x, 0.012, high)), 0.02 * x, 0, high / 2 - 0.004),
            _at(trimesh.creation.box((0.012, y, 0.03)), x / 2 - 0.006, 0, 0.015),
        ]
    )
    tools = [_at(trimesh.creation.cylinder(bore, 1.0, sections=96), -0.2 * x, 0, 0)]
    for side in (-1, 1):
        tools.append(_at(trimesh.creation.cylinder(0.0045, 1.0, sections=48), -0.43 * x, side * 0.38 * y, 0))
        tools.append(_at(trimesh.creation.cylinder(0.006, 1.0, sections=48), 0.2 * x, side * 0.3 * y, 0))
    slot = trimesh.creation.box((0.02, 0.35 * y, 1.0))
    tools.append(_at(slot, 0.36 * x, 0, 0))
    cross = trimesh.creation.cylinder(0.004, 1.0, sections=48)
    cross.apply_transform(rotation_matrix(np.pi / 2, [1, 0, 0]))
    tools.append(_at(cross, -0.2 * x, 0, 0.7 * high))
    return trimesh.boolean.difference([solid, _join(tools)], engine="manifold"), textures.metal


def shoe(rng: np.random.Generator) -> Made:
    """A low shoe: sole and upper lofted along the foot, hollow from above."""
    length = rng.uniform(0.22, 0.28)
    s = np.linspace(0, 1, 60)
    wide = 0.19 * length * np.interp(s, [0, 0.04, 0.15, 0.4, 0.7, 0.92, 1], [0.25, 0.55, 0.72, 0.66, 1.0, 0.62, 0.2])
    high = 0.34 * length * np.interp(s, [0, 0.1, 0.45, 0.7, 0.9, 1], [0.8, 0.85, 0.75, 0.42, 0.3, 0.15])
    bend = 0.03 * length * np.sin(np.pi * s) * rng.uniform(0.5, 1.5)
    upper = _loft(s * length, wide, high, bend, 0.004)
    sole = _loft(-0.01 + s * (length + 0.02), wide + 0.006, np.full(60, 0.016), bend, 0.0)
    inner = _loft(
        0.012 + s * (0.62 * length),
        np.interp(s, [0, 0.1, 1], [0.4, 0.75, 0.6]) * wide.max() * 0.72,
        np.full(60, 0.5 * length),
        bend * 0.6,
        0.02,
    )
    body = trimesh.boolean.difference([_join([sole, upper]), inner], engine="manifold")
    return body, textures.painted


def _loft(
    along: np.ndarray, half_width: np.ndarray, height: np.ndarray, bend: np.ndarray, floor: float
) -> trimesh.Trimesh:
    """A tube of rounded sections (n of them) on z = floor, closed at both ends."""
    angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    c, s = np.cos(angle), np.sin(angle)
    across = np.sign(c) * np.abs(c) ** 0.6
    up = np.where(s > 0, np.abs(s) ** 0.8, 0.0)
    rings = np.stack(
        [
            np.column_stack(
                [np.full(64, x), b + w * across, floor + h * np.maximum(up, 0) - 0.001 * (s < 0) * np.abs(s)]
            )
            for x, w, h, b in zip(along, half_width, height, bend, strict=True)
        ]
    )
    n, m = rings.shape[:2]
    vertices = np.concatenate([rings.reshape(-1, 3), rings[[0, -1]].mean(1)])
    i, j = np.meshgrid(np.arange(n - 1), np.arange(m), indexing="ij")
    a, b = (i * m + j).ravel(), (i * m + (j + 1) % m).ravel()
    faces = [np.column_stack([a, b, a + m]), np.column_stack([b, b + m, a + m])]
    k = np.arange(m)
    faces += [
        np.column_stack([(k + 1) % m, k, np.full(m, n * m)]),
        np.column_stack([(n - 1) * m + k, (n - 1) * m + (k + 1) % m, np.full(m, n * m + 1)]),
    ]
    mesh = trimesh.Trimesh(vertices, np.concatenate(faces), process=True)
    trimesh.repair.fix_normals(mesh)
    return mesh


KINDS: dict[str, Callable[[np.random.Generator], Made]] = {
    "figure": figure,
    "chair": chair,
    "rock": rock,
    "part": part,
    "shoe": shoe,
}


def resting_poses(mesh: trimesh.Trimesh, up: tuple[float, float, float] | None, turned: bool) -> list[np.ndarray]:
    """(4, 4) poses in which the object rests on z = 0, its centre of mass over its footprint on the z axis.

    Args:
        mesh: closed.
        up: direction of the object's axes that shall point up; None takes the likeliest pose of a dropped body.
        turned: a second pose is given as well: of those with the other side up, the likeliest.
    """
    transforms, likely = trimesh.poses.compute_stable_poses(mesh, center_mass=mesh.center_mass, sigma=0.0, n_samples=1)
    ups = np.stack([T[2, :3] for T in transforms])
    first = int(np.argmax(likely if up is None else ups @ np.array(up) + 0.02 * likely))
    chosen = [first]
    if turned:
        against = ups @ ups[first]
        other = np.flatnonzero(against < -0.5)
        chosen.append(int(other[np.argmax(likely[other])]) if len(other) else int(np.argmin(against)))
    poses = []
    for k in chosen:
        pose = np.array(transforms[k])
        pose[:2, 3] -= (pose[:3, :3] @ mesh.center_mass + pose[:3, 3])[:2]
        pose[2, 3] -= (mesh.vertices @ pose[2, :3] + pose[2, 3]).min()
        poses.append(pose)
    return poses
