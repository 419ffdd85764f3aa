"""What sunlight's torque on a body can be: a law for unknown bodies, from bodies drawn at random.

The torque of pressure on a closed surface is no free function of the Sun's direction s in the body. A face takes no
momentum while it is dark, and begins with none as it turns to the light; what is absorbed pushes along -s, so it has no
torque along s; what a mirror or a matt surface sends back pushes against the normal; all of it acts at the centre of
pressure. Areas, and shares of the light, are not negative, and the areas of a closed surface balance: were all of it
equally dark, the torque would turn round with the Sun (what faces the Sun and what faces away have one shadow). Bodies
that obey all this are drawn here. Their covariance is the prior of sunlight's unknowns, so that what pressure seldom does
costs evidence. Forces on a face as in Wertz (1978), eq. 17-46.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from massprops.geometry.vectors import sphere

BODIES = 900
"""Drawn: nine for each unknown of twenty faces."""
DIRECTIONS = 150
MOST_WINGS = 2
STRETCH = 0.7
"""Of the logarithm of a body's half axes: most are up to four times as long as wide."""
UNEVEN = 0.4
"""Of the half axes: how far from the middle the centre of mass lies."""
MOST_SENT_BACK = 0.6
"""Share of light sent back by a mirror, and of the rest by a matt surface: 0 to this, each face its own."""
RIDGE = 1e-4
"""Over the columns' mean square: of unknowns that no direction shows."""


LEAST_PART = 1e-6
"""Of the largest variance of the unknowns: what has less is no body's."""


@cache
def _solids() -> tuple[np.ndarray, ...]:
    """Normals (f, 3) of the cube, the octahedron and the dodecahedron, whose faces touch a sphere and are alike."""
    golden = 0.5 * (1.0 + 5.0**0.5)
    signs = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]) / 3.0**0.5
    pairs = [np.roll([0.0, a, b * golden], k) for k in range(3) for a in (-1, 1) for b in (-1, 1)]
    return np.concatenate([np.eye(3), -np.eye(3)]), signs, np.array(pairs) / np.hypot(1.0, golden)


def drawn_body(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normals (f, 3), areas (f,) and centres (f, 3), from the centre of mass, of a closed solid's faces and of both sides of
    its wings."""
    normals = _solids()[int(rng.integers(3))]
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    shape = turn * np.exp(STRETCH * rng.standard_normal(3)) @ np.linalg.qr(rng.standard_normal((3, 3)))[0]
    # an affine image of a solid is closed as it is: area times normal goes by the cofactors
    oriented = normals @ np.linalg.inv(shape) * abs(np.linalg.det(shape))
    areas = np.linalg.norm(oriented, axis=1)
    centre = shape @ (UNEVEN * rng.uniform(-1.0, 1.0, 3))
    n, a, r = [oriented / areas[:, None]], [areas], [normals @ shape.T - centre]
    for _ in range(int(rng.integers(MOST_WINGS + 1))):
        way, place = rng.standard_normal((2, 3))
        way = way / np.linalg.norm(way)
        place = place / np.linalg.norm(place) * rng.uniform(0.5, 2.5) * np.linalg.norm(shape) / 3.0**0.5
        area = areas.sum() * np.exp(rng.uniform(-3.0, 0.0))
        n, a, r = [*n, np.array([way, -way])], [*a, np.full(2, area)], [*r, np.tile(place - centre, (2, 1))]
    return np.concatenate(n), np.concatenate(a), np.concatenate(r)


def torque_of(
    sun: np.ndarray, normals: np.ndarray, areas: np.ndarray, centres: np.ndarray, mirror: np.ndarray, matt: np.ndarray
) -> np.ndarray:
    """(n, 3) torque of unit pressure on faces, for directions of the Sun (n, 3), body axes; no face shades another.

    Args:
        normals, centres: (f, 3); areas: (f,); mirror, matt: (f,) shares of the light sent back.
    """
    lit = np.maximum(sun @ normals.T, 0.0)
    along = lit * areas * (1.0 - mirror)
    outward = lit * areas * (2.0 * mirror * lit + 2.0 / 3.0 * matt)
    return np.asarray(-np.cross(along @ centres, sun) - outward @ np.cross(centres, normals))


def likely_unknowns(columns: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """(k, j) matrix B: unknowns B z with j independent z of one size are as likely as those of the bodies drawn.

    Args:
        columns: torque (n, 3, k) of a unit of each unknown, for directions of the Sun (n, 3), body axes.
    """
    rng, sun = np.random.default_rng(0), sphere(DIRECTIONS)
    torques = []
    for _ in range(BODIES):
        normals, areas, centres = drawn_body(rng)
        # one paint all over, or each face its own
        paint = rng.uniform(0.0, MOST_SENT_BACK, (2, len(areas) if rng.random() < 0.5 else 1))
        mirror, matt = np.broadcast_to(paint, (2, len(areas)))
        torque = torque_of(sun, normals, areas, centres, mirror, (1.0 - mirror) * matt).ravel()
        torques.append(torque / np.sqrt(np.mean(torque**2)))
    X = columns(sun).reshape(3 * len(sun), -1)
    ridge = RIDGE * np.mean(X**2) * len(X) * np.eye(X.shape[1])
    unknowns = np.linalg.solve(X.T @ X + ridge, X.T @ np.array(torques).T)
    value, vector = np.linalg.eigh(unknowns @ unknowns.T / BODIES)
    kept = value > LEAST_PART * value[-1]
    return np.asarray(vector[:, kept] * np.sqrt(value[kept]))
