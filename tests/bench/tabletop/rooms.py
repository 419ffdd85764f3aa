"""The room: table, floor, walls, lights, and what lies about. Lists of plain dictionaries, as the renderer reads them.

A thing has a shape (`box`: three sizes; `cylinder`: radius and height), a pose (4, 4) of its middle, and a surface.
A surface has the name of a picture, the width it covers [m], and the renderer's roughness, metallic, coat and bump.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from trimesh.transformations import rotation_matrix, translation_matrix

from tabletop import textures

TABLES = ("plain", "wood", "tiles", "cloth", "newspaper")
SPAN = {"plain": 0.8, "wood": 0.7, "tiles": 0.35, "cloth": 0.4, "newspaper": 0.4}
"""Width of one picture on the table [m]."""


class Pictures:
    """The pictures of a scene by name; drawing one returns its name."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.images: dict[str, np.ndarray] = {}

    def draw(self, kind: str) -> str:
        name = f"{kind}{len(self.images)}"
        self.images[name] = getattr(textures, kind)(self.rng)
        return name


def surface(picture: str, span: float, roughness: float = 0.6, **more: float) -> dict[str, Any]:
    return {"picture": picture, "span": span, "roughness": roughness, **more}


def box(size: tuple[float, float, float], pose: np.ndarray, look: dict[str, Any], moves: str = "") -> dict[str, Any]:
    return {"shape": "box", "size": list(size), "pose": pose.tolist(), "surface": look, "moves": moves}


def cylinder(radius: float, height: float, pose: np.ndarray, look: dict[str, Any], moves: str = "") -> dict[str, Any]:
    return {"shape": "cylinder", "size": [radius, height], "pose": pose.tolist(), "surface": look, "moves": moves}


def shell(rng: np.random.Generator, pictures: Pictures, table: str) -> list[dict[str, Any]]:
    """Table, floor and two walls with pictures on them."""
    top = surface(pictures.draw(table), SPAN[table], rng.uniform(0.35, 0.7))
    things = [box((1.5, 1.0, 0.03), translation_matrix([0, 0, -0.015]), top)]
    things.append(box((6, 6, 0.02), translation_matrix([0, 0, -0.75]), surface(pictures.draw("wood"), 1.2, 0.5)))
    wall = surface(pictures.draw("plain"), 3.0, 0.9)
    side = rng.choice([-1, 1], 2)
    at = rng.uniform(1.1, 1.8, 2)
    things.append(box((0.05, 6, 3), translation_matrix([side[0] * at[0], 0, 0.6]), wall))
    things.append(box((6, 0.05, 3), translation_matrix([0, side[1] * at[1], 0.6]), wall))
    for _ in range(4):
        size = rng.uniform(0.3, 0.8, 2)
        where, height = rng.uniform(-0.8, 0.8), rng.uniform(-0.1, 0.9)
        look = surface(pictures.draw("poster"), float(size.max()), 0.7)
        if rng.random() < 0.5:
            things.append(
                box((0.03, size[0], size[1]), translation_matrix([side[0] * (at[0] - 0.035), where, height]), look)
            )
        else:
            things.append(
                box((size[0], 0.03, size[1]), translation_matrix([where, side[1] * (at[1] - 0.035), height]), look)
            )
    return things


def lights(rng: np.random.Generator) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """A lamp above, a window at one side, sometimes a third; and the light of the room all round."""
    found = []
    lamp = np.array([rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), rng.uniform(1.2, 1.7)])
    found.append(
        {"at": lamp.tolist(), "size": rng.uniform(0.3, 1.0), "watts": rng.uniform(12, 25), "warm": rng.uniform(0, 0.25)}
    )
    angle = rng.uniform(0, 2 * np.pi)
    window = [1.6 * np.cos(angle), 1.6 * np.sin(angle), rng.uniform(0.5, 1.1)]
    found.append(
        {"at": window, "size": rng.uniform(0.6, 1.2), "watts": rng.uniform(10, 40), "warm": -rng.uniform(0, 0.2)}
    )
    if rng.random() < 0.4:
        angle += rng.uniform(1.5, 4.5)
        third = [1.3 * np.cos(angle), 1.3 * np.sin(angle), rng.uniform(0.3, 0.9)]
        found.append({"at": third, "size": 0.2, "watts": rng.uniform(4, 10), "warm": 0.3})
    return found, {"strength": rng.uniform(0.25, 0.5), "warm": rng.uniform(-0.1, 0.1)}


def clutter(rng: np.random.Generator, pictures: Pictures, free: float, reach: float) -> list[dict[str, Any]]:
    """Cards, books, pens, pots, coins round the object.

    A thing at distance d is lower than (d - free) / 4, so that a camera 15 degrees above the table sees past it.

    Args:
        free: radius about the object that stays free [m].
        reach: radius within which things lie [m].
    """
    things: list[dict[str, Any]] = []
    taken: list[tuple[np.ndarray, float]] = []
    for _ in range(200):
        if len(things) >= 14:
            break
        angle, away = rng.uniform(0, 2 * np.pi), rng.uniform(free * 1.1, reach)
        where = away * np.array([np.cos(angle), np.sin(angle)])
        kind = rng.choice(["card", "book", "pen", "pot", "coin"])
        size = float(rng.uniform(0.02, 0.06) * {"coin": 0.3, "pen": 1.2, "book": 1.4}.get(kind, 1.0))
        highest = (away - size - free) / 4
        outside = np.linalg.norm(where) - size > free
        if not outside or highest < 0.0008 or any(np.linalg.norm(where - w) < size + s for w, s in taken):
            continue
        taken.append((where, size))
        things.append(_lying(kind, rng, pictures, where, size, highest))
    return things


def _lying(
    kind: str, rng: np.random.Generator, pictures: Pictures, where: np.ndarray, size: float, highest: float
) -> dict[str, Any]:
    """One thing within `size` of a place on the table, no higher than `highest`."""
    turn = rotation_matrix(rng.uniform(0, 2 * np.pi), [0, 0, 1])
    look = surface(pictures.draw("poster"), 1.4 * size, rng.uniform(0.3, 0.8))
    if kind == "pen":
        radius = min(0.004, highest / 2)
        lying = rotation_matrix(np.pi / 2, [0, 1, 0])
        return cylinder(radius, 1.8 * size, translation_matrix([*where, radius]) @ turn @ lying, look)
    if kind in ("pot", "coin"):
        height = min(highest, 1.5 * size if kind == "pot" else 0.002)
        return cylinder(0.8 * size, height, translation_matrix([*where, height / 2]) @ turn, look)
    height = min(highest, rng.uniform(0.01, 0.03) if kind == "book" else 0.001)
    return box((1.5 * size, 1.1 * size, height), translation_matrix([*where, height / 2]) @ turn, look)


def stand(rng: np.random.Generator, pictures: Pictures, radius: float) -> tuple[dict[str, Any], float]:
    """A block under the object, and its height [m]."""
    height = float(rng.uniform(0.02, 0.05))
    look = surface(pictures.draw("faint"), 0.2, 0.8)
    middle = translation_matrix([0, 0, height / 2]) @ rotation_matrix(rng.uniform(0, 3), [0, 0, 1])
    side = 2 * radius * rng.uniform(1.05, 1.5)
    return box((side, side * rng.uniform(0.8, 1.0), height), middle, look), height


def turntable(pictures: Pictures, radius: float) -> tuple[dict[str, Any], float]:
    """A printed plate under the object, and its height [m]."""
    height = 0.015
    look = surface(pictures.draw("newspaper"), 0.3, 0.5)
    return cylinder(1.5 * radius, height, translation_matrix([0, 0, height / 2]), look, "plate"), height
