"""Bodies that are hard to see, drawn from a seed: repeated cells, foil, plaster, painted buses, rocks. Metres.

A body is a list of closed solids, each with a surface. Its truth is their exact union; what is drawn are the solids
themselves, whose hidden parts nobody sees.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh
from tabletop import objects
from trimesh.creation import box, cylinder

Solid = tuple[trimesh.Trimesh, dict[str, Any]]
"""A closed solid and its surface: the picture's kind in `textures`, its span [m], and the renderer's words."""


@dataclass(frozen=True, kw_only=True)
class Body:
    """`mesh`: the truth, closed. `solids`: what is drawn."""

    mesh: trimesh.Trimesh
    solids: list[Solid]


def make_body(kind: str, rng: np.random.Generator) -> Body:
    """A body of one of `KINDS`.

    Raises:
        ValueError: its solids do not make one closed body.
    """
    solids = KINDS[kind](rng)
    mesh = solids[0][0] if len(solids) == 1 else trimesh.boolean.union([m for m, _ in solids], engine="manifold")
    if not mesh.is_volume or mesh.body_count != 1:
        raise ValueError(f"{kind}: not one closed body")
    return Body(mesh=mesh, solids=solids)


def _at(mesh: trimesh.Trimesh, *where: float) -> trimesh.Trimesh:
    mesh.apply_translation(where)
    return mesh


def _rod(radius: float, start: list[float], end: list[float]) -> trimesh.Trimesh:
    return cylinder(radius, segment=np.array([start, end]), sections=24)


def cubesat(rng: np.random.Generator) -> list[Solid]:
    """Three units with the same cell picture on four sides and on a deployed panel of 2 mm, four thin rods."""
    a, tall = 0.1, 0.3
    cells = {"picture": "cells", "span": a / 2, "roughness": 0.25, "coat": 0.3}
    white = {"picture": "white", "span": 1.0, "roughness": 0.6}
    metal = {"picture": "metal", "span": 0.1, "roughness": 0.4, "metallic": 0.5}
    solids: list[Solid] = [(box((a, a, tall)), cells)]
    solids += [(_at(box((a + 0.001, a + 0.001, 0.02)), 0, 0, side * (tall / 2 + 0.005)), white) for side in (-1, 1)]
    lens = cylinder(rng.uniform(0.015, 0.03), 0.02, sections=64)
    solids.append((_at(lens, rng.uniform(-0.01, 0.01), 0, tall / 2 + 0.02), metal))
    wide = rng.uniform(1.0, 2.0) * a
    panel = box((wide, 0.002, tall * rng.uniform(0.7, 1.0)))
    solids.append((_at(panel, a / 2 + wide / 2 - 0.001, rng.uniform(-0.045, 0.045), 0), cells))
    for x, y in ((-1, -1), (1, -1), (-1, 1), (1, 1)):
        root = [0.03 * x, 0.03 * y, -tall / 2 - 0.012]
        solids.append((_rod(0.0015, root, [0.03 * x + 0.12 * x, 0.03 * y + 0.12 * y, root[2] - 0.01]), metal))
    return solids


def foil(rng: np.random.Generator) -> list[Solid]:
    """A bus in crinkled gold foil with one glossy wing, a dish and a boom."""
    x, y, z = rng.uniform(0.7, 1.3, 3)
    gold = {"picture": "foil", "span": 0.6, "roughness": 0.22, "metallic": 0.95, "bump": 1.0}
    cells = {"picture": "cells", "span": 0.1, "roughness": 0.15, "coat": 0.6}
    white = {"picture": "white", "span": 1.0, "roughness": 0.5}
    wing = rng.uniform(1.2, 2.2)
    r = rng.uniform(0.25, 0.45)
    dish = trimesh.creation.revolve(
        np.array([[0, 0], [0.5 * r, 0.06 * r], [r, 0.28 * r], [r, 0.36 * r], [0.5 * r, 0.14 * r], [0, 0.08 * r]]),
        sections=64,
    )
    return [
        (box((x, y, z)), gold),
        (_at(box((wing, 0.03, 0.7 * z)), x / 2 + 0.12 + wing / 2, 0, 0), cells),
        (_rod(0.025, [x / 2 - 0.05, 0, 0], [x / 2 + 0.2, 0, 0]), white),
        (_at(dish, 0, 0, z / 2 + 0.04), white),
        (_rod(0.03, [0, 0, z / 2 - 0.02], [0, 0, z / 2 + 0.07]), white),
        (_rod(0.02, [-x / 2 + 0.05, 0.2 * y, 0], [-x / 2 - rng.uniform(0.4, 0.9), 0.35 * y, 0.1]), white),
    ]


def bus(rng: np.random.Generator) -> list[Solid]:
    """A painted bus with two wings of unlike length, a drum and a mast: textured, an easy body."""
    x, y, z = rng.uniform(0.6, 1.2, 3)
    paint = {"picture": "painted", "span": 0.8, "roughness": 0.6}
    poster = {"picture": "poster", "span": 0.7, "roughness": 0.5}
    solids: list[Solid] = [(box((x, y, z)), paint)]
    for side in (-1, 1):
        wing = rng.uniform(0.8, 1.6)
        solids.append((_at(box((wing + 0.1, 0.04, 0.6 * z)), side * (x / 2 + wing / 2 - 0.05), 0.1 * y, 0), poster))
    solids.append((_at(cylinder(0.25 * min(x, y), 0.5, sections=64), 0, 0, z / 2 + 0.2), paint))
    solids.append((_rod(0.03, [0.2 * x, 0, -z / 2 + 0.05], [0.35 * x, 0.1, -z / 2 - 0.6]), poster))
    return solids


def plaster(rng: np.random.Generator) -> list[Solid]:
    """Smooth lumps grown together, one white without any detail."""
    parts: list[trimesh.Trimesh] = []
    for _ in range(int(rng.integers(3, 6))):
        # finer than a pixel: facets would be texture
        lump = trimesh.creation.icosphere(6, 1.0)
        lump.apply_scale(rng.uniform(0.3, 0.7, 3))
        # about a point under the surface of an earlier one, so that they are one body
        where = 0.85 * rng.choice(rng.choice(np.stack([p.vertices for p in parts]))) if parts else np.zeros(3)
        parts.append(_at(lump, *where))
    mesh = trimesh.boolean.union(parts, engine="manifold")
    return [(mesh, {"picture": "white", "span": 1.0, "roughness": 0.8})]


def rock(rng: np.random.Generator) -> list[Solid]:
    """The table-top's boulder, ten times larger."""
    mesh, _ = objects.rock(rng)
    mesh.apply_scale(10.0)
    return [(mesh, {"picture": "stone", "span": 1.0, "roughness": 0.9, "smooth": False})]


KINDS: dict[str, Callable[[np.random.Generator], list[Solid]]] = {
    "cubesat": cubesat,
    "foil": foil,
    "bus": bus,
    "plaster": plaster,
    "rock": rock,
}
