"""Camera paths. Every path is a smooth function of time, so motion blur and truth come from the same function.

World axes: z up, the table's top at z = 0, the object about the z axis. Camera axes: x right, y down, z forward.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Path = Callable[[float], np.ndarray]
"""Time [s] -> (4, 4) camera -> world."""

FILM_DIAGONAL = 43.267
"""Of the 35 mm film, to which EXIF's equivalent focal lengths refer [mm]."""


@dataclass(frozen=True, kw_only=True)
class Lens:
    """Of one camera: size [px], focal length [px], radial k1, and what its EXIF says of the focal length [mm]."""

    width: int
    height: int
    focal: float
    k1: float
    focal_35mm: int

    @property
    def K(self) -> np.ndarray:
        """(3, 3); the centre of the first pixel is at (0.5, 0.5)."""
        return np.array([[self.focal, 0, self.width / 2], [0, self.focal, self.height / 2], [0, 0, 1.0]])


def draw_lens(rng: np.random.Generator, upright: bool) -> Lens:
    """A phone's main camera: the true focal length is within 0.5 % (one sigma) of the one it states."""
    equivalent = int(rng.integers(36, 46))
    focal = equivalent / FILM_DIAGONAL * np.hypot(640, 480) * (1 + 0.005 * rng.standard_normal())
    width, height = (480, 640) if upright else (640, 480)
    return Lens(
        width=width, height=height, focal=float(focal), k1=float(rng.uniform(-0.06, 0.05)), focal_35mm=equivalent
    )


def look_at(centre: np.ndarray, target: np.ndarray, roll: float = 0.0) -> np.ndarray:
    """(4, 4) camera -> world at `centre` with `target` on its axis, turned by `roll` [rad] about it."""
    z = np.asarray(target, float) - centre
    z /= np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    c, s = np.cos(roll), np.sin(roll)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([c * x + s * y, -s * x + c * y, z])
    pose[:3, 3] = centre
    return pose


def tremor(rng: np.random.Generator, slowest: float, fastest: float, count: int = 8) -> Callable[[float], float]:
    """A smooth random function of deviation 1: sines between two frequencies [Hz]."""
    hertz = np.geomspace(slowest, fastest, count) * rng.uniform(0.85, 1.15, count)
    size = rng.standard_normal(count) * hertz**-0.5
    size /= np.sqrt(0.5 * (size**2).sum())
    phase = rng.uniform(0, 2 * np.pi, count)
    return lambda t: float(size @ np.sin(2 * np.pi * hertz * t + phase))


def ball(elevation: float, azimuth: float, distance: float) -> np.ndarray:
    """(3,) point at that direction [rad] and distance."""
    return distance * np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )


def hand_held(rng: np.random.Generator, seconds: float, distance: float, target: np.ndarray) -> Path:
    """Once and a bit round the object, down and up again, with a hand's sway and tremor."""
    start, turns = rng.uniform(0, 2 * np.pi), rng.choice([-1, 1]) * rng.uniform(1.05, 1.25)
    low, high = np.radians(rng.uniform(18, 25)), np.radians(rng.uniform(48, 62))
    waves, shift = rng.uniform(1.3, 2.2), rng.uniform(0, 2 * np.pi)
    sway = [tremor(rng, 0.1, 1.0) for _ in range(3)]
    shake = [tremor(rng, 2.0, 9.0) for _ in range(3)]
    aim = [tremor(rng, 0.1, 1.2) for _ in range(3)]
    roll, reach = tremor(rng, 0.08, 1.0), tremor(rng, 0.05, 0.2)

    def path(t: float) -> np.ndarray:
        u = t / seconds
        elevation = low + (high - low) * (0.5 - 0.5 * np.cos(2 * np.pi * waves * u + shift))
        away = distance * (1 + 0.05 * reach(t))
        centre = target + ball(elevation, start + 2 * np.pi * turns * u, away)
        centre = centre + away * (0.012 * np.array([f(t) for f in sway]) + 0.0006 * np.array([f(t) for f in shake]))
        seen = target + away * 0.025 * np.array([f(t) for f in aim])
        return look_at(centre, seen, np.radians(2.0) * roll(t))

    return path


def photographs(
    rng: np.random.Generator, count: int, distance: float, target: np.ndarray, arc: float = 2 * np.pi
) -> list[np.ndarray]:
    """Rings at two heights and a few from above, or arcs [rad] of them; (4, 4) each."""
    above = max(2, count // 12)
    low = (count - above + 1) // 2
    rings = ((low, 24.0), (count - above - low, 48.0), (above, 70.0))
    poses = []
    for many, degrees in rings:
        begin = rng.uniform(0, 2 * np.pi) if arc == 2 * np.pi else 0.0
        for i in range(many):
            azimuth = begin + arc * (i + rng.uniform(-0.25, 0.25)) / many
            elevation = np.radians(degrees + rng.uniform(-5, 5))
            away = distance * rng.uniform(0.93, 1.1)
            seen = target + away * 0.025 * rng.standard_normal(3)
            poses.append(
                look_at(target + ball(elevation, azimuth, away), seen, np.radians(3.0) * rng.standard_normal())
            )
    return poses


def still(rng: np.random.Generator, distance: float, target: np.ndarray) -> list[np.ndarray]:
    """Two heights of a tripod before a turntable."""
    azimuth = rng.uniform(0, 2 * np.pi)
    return [
        look_at(target + ball(np.radians(e), azimuth, distance), target)
        for e in (rng.uniform(20, 26), rng.uniform(45, 55))
    ]


def fitting_distance(points: np.ndarray, target: np.ndarray, lens: Lens, share: float = 0.36) -> float:
    """Distance at which the sphere about `target` that holds the points has a radius of `share` of the short side [m]."""
    radius = float(np.linalg.norm(points - target, axis=1).max())
    return radius * lens.focal / (share * min(lens.width, lens.height))
