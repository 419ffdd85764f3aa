"""Bodies of one paint whose mesh is known, pushed by Basilisk's facets in sunlight or in thin air.

The hub's centre of mass is Basilisk's origin; the mesh has its own a little beside it, as one of even density would.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from diagnosis import basilisk_worlds

SHARES = (0.25, 0.15)
"""Of the light: mirrored, scattered."""


def triangles(seed: int) -> np.ndarray:
    """(24, 3, 3) a box and a wing as thin as a board, from the centre of mass [m], wound outward."""
    rng = np.random.default_rng([seed, 80])
    half = [np.array([0.6, 0.5, 0.4]) * rng.uniform(0.8, 1.2, 3), np.array([0.02, 0.9, 0.7])]
    place = rng.uniform(-0.25, 0.25, 3)
    places = [place, place + np.array([0.1, 1.6, 0.2])]
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    return np.concatenate([_box(half[0]) + places[0], _box(half[1]) @ (turn * np.linalg.det(turn)).T + places[1]])


def _box(half: np.ndarray) -> np.ndarray:
    import trimesh

    box = trimesh.creation.box(extents=2.0 * half)
    return np.asarray(box.vertices)[np.asarray(box.faces)]


def _facets(seed: int) -> list[tuple[np.ndarray, float, np.ndarray]]:
    """Normal, area and centre of each triangle."""
    corners = triangles(seed)
    oriented = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(oriented, axis=1)
    return [(o / a, float(a), c) for o, a, c in zip(oriented, areas, corners.mean(axis=1), strict=True)]


def painted(seed: int) -> Any:
    """What makes Basilisk's sunlight on the mesh."""

    def act(world: Any, hub: Any, rng: np.random.Generator, inertia: np.ndarray, w: np.ndarray) -> dict:
        from Basilisk.architecture import messaging
        from Basilisk.simulation import facetSRPDynamicEffector

        effector = facetSRPDynamicEffector.FacetSRPDynamicEffector()
        faces = _facets(seed)
        effector.setNumFacets(len(faces))
        for normal, area, place in faces:
            effector.addFacet(
                area, np.eye(3).tolist(), normal.tolist(), [0, 0, 1], place.tolist(), SHARES[1], SHARES[0]
            )
        sun = messaging.SpicePlanetStateMsgPayload()
        sun.PositionVector = (basilisk_worlds.AU * basilisk_worlds.SUN / np.linalg.norm(basilisk_worlds.SUN)).tolist()
        message = messaging.SpicePlanetStateMsg().write(sun)
        effector.sunInMsg.subscribeTo(message)
        hub.addDynamicEffector(effector)
        world.AddModelToTask("t", effector)
        return {"kept": (effector, message)}

    return act


def windward(seed: int) -> Any:
    """What makes Basilisk's thin air push on the mesh, around the planet."""

    def act(world: Any, hub: Any, rng: np.random.Generator, inertia: np.ndarray, w: np.ndarray) -> dict:
        from Basilisk.architecture import messaging
        from Basilisk.simulation import facetDragDynamicEffector

        planet = basilisk_worlds._planet(world, hub)
        effector = facetDragDynamicEffector.FacetDragDynamicEffector()
        for normal, area, place in _facets(seed):
            effector.addFacet(area, 2.2, normal.tolist(), place.tolist())
        air = messaging.AtmoPropsMsgPayload()
        air.neutralDensity = 2e-13
        message = messaging.AtmoPropsMsg().write(air)
        effector.atmoDensInMsg.subscribeTo(message)
        hub.addDynamicEffector(effector)
        world.AddModelToTask("t", effector)
        return {"kept": (planet, effector, message)}

    return act


def recorded(make: Any, seed: int, **given: Any) -> Any:
    """`basilisk_worlds.recorded` of what `painted` or `windward` makes."""
    basilisk_worlds.STRANGERS["mesh"] = make(seed)
    try:
        return basilisk_worlds.recorded("mesh", seed, **given)
    finally:
        del basilisk_worlds.STRANGERS["mesh"]
