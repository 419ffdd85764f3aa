"""Where body and camera are in each frame."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from massprops.dynamics.quaternion import (
    from_rotation_matrix,
    from_rotation_vector,
    multiply,
    normalise,
    rotation_matrix,
)
from massprops.dynamics.rigid_body import propagate
from massprops.simulation.scenario import Scenario


@dataclass(frozen=True)
class Path:
    """n frames.

    Attributes:
        timestamp_ns: (n,) int64.
        q: (n, 4) body to cam0, Hamilton.
        position: (n, 3) body origin (centre of the visible mass) in cam0 [m].
        w: (n, 3) body rates [rad/s]; zero for a still body.
        sun: (n, 3) unit vector to the Sun in body axes.
        inertia: (3, 3) that moved the body, about `centre`, body axes.
        centre: (3,) point that the body turns about, its whole centre of mass, in body axes [m].
    """

    timestamp_ns: np.ndarray
    q: np.ndarray
    position: np.ndarray
    w: np.ndarray
    sun: np.ndarray
    inertia: np.ndarray
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))

    @property
    def centre_in_camera(self) -> np.ndarray:
        """(n, 3) whole centre of mass in cam0 [m]; at rest when the body turns freely."""
        return self.position + rotation_matrix(self.q) @ self.centre


def distance_for(scenario: Scenario, length: float) -> float:
    """Distance at which the body fills its share of the image's height [m]."""
    return scenario.focal * scenario.size[0] * length / (scenario.fill * scenario.size[1])


def tumbling(scenario: Scenario, inertia: np.ndarray, length: float, centre: np.ndarray) -> Path:
    """Torque-free rotation before a still camera under a still Sun.

    Args:
        scenario: what is simulated.
        inertia: (3, 3) of the motion, about `centre`, body axes.
        length: greatest length [m].
        centre: (3,) whole centre of mass, body axes [m]: zero without hidden mass. It stays where it is.
    """
    rng = np.random.default_rng([scenario.seed, 1])
    times = np.arange(scenario.frames) / scenario.rate_hz
    axes = np.linalg.eigh(inertia)[1]
    axes[:, 1] = np.cross(axes[:, 2], axes[:, 0])
    if scenario.spin is not None:
        direction = np.array(scenario.spin, float)
    else:
        # near the middle axis, where the motion turns over and shows all sides
        direction = np.array(
            [rng.uniform(0.15, 0.45) * rng.choice([-1, 1]), 1.0, rng.uniform(0.15, 0.45) * rng.choice([-1, 1])]
        )
    w0 = axes @ direction / np.linalg.norm(direction) * np.radians(scenario.rate_deg) * scenario.rate_hz
    q0 = normalise(rng.standard_normal(4))
    q, w = propagate(q0, w0, inertia, times, largest_turn=0.02)
    distance = distance_for(scenario, length)
    offset = rng.uniform(-0.02, 0.02, 2) * length
    position = np.array([*offset, distance]) - rotation_matrix(q) @ centre
    turn = rng.uniform(0, 2 * np.pi)
    phase = np.radians(scenario.sun_phase_deg)
    sun = np.array([np.sin(phase) * np.cos(turn), np.sin(phase) * np.sin(turn), -np.cos(phase)])
    sun_body = np.einsum("nji,j->ni", rotation_matrix(q), sun)
    return Path(np.round(times * 1e9).astype(np.int64), q, position, w, sun_body, inertia, centre)


def walk_round(scenario: Scenario, inertia: np.ndarray, length: float, centre: np.ndarray) -> Path:
    """A camera on two rings about a still body, looking at it with small errors; z is up. Arguments as `tumbling`."""
    rng = np.random.default_rng([scenario.seed, 1])
    n = scenario.frames
    times = np.arange(n) / scenario.rate_hz
    distance = distance_for(scenario, length)
    turn = np.linspace(0, 4 * np.pi, n, endpoint=False) + rng.uniform(0, 2 * np.pi)
    height = np.radians(np.where(np.arange(n) < n / 2, 28.0, 55.0)) + 0.02 * rng.standard_normal(n)
    centres = (
        distance
        * (1 + 0.03 * rng.standard_normal((n, 1)))
        * np.column_stack([np.cos(height) * np.cos(turn), np.cos(height) * np.sin(turn), np.sin(height)])
    )
    rotation = []
    for c in centres:
        z = -c / np.linalg.norm(c)
        x = np.cross(z, [0, 0, 1.0])
        x /= np.linalg.norm(x)
        rotation.append(np.stack([x, np.cross(z, x), z]))
    R = np.stack(rotation)
    shake = from_rotation_vector(0.01 * rng.standard_normal((n, 3)))
    q = multiply(shake, from_rotation_matrix(R))
    position = -np.einsum("nij,nj->ni", rotation_matrix(q), centres)
    phase = np.radians(scenario.sun_phase_deg)
    environment = rng.uniform(0, 2 * np.pi)
    sun = np.array([np.sin(phase) * np.cos(environment), np.sin(phase) * np.sin(environment), np.cos(phase)])
    stamp = np.round(times * 1e9).astype(np.int64)
    return Path(stamp, q, position, np.zeros((n, 3)), np.tile(sun, (n, 1)), inertia, centre)


def with_hidden_mass(
    inertia: np.ndarray, mass: float, hidden: tuple[float, float, float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Inertia (3, 3) and place (3,) of the new centre of mass with a point of `hidden[0] * mass` at `hidden[1:]`."""
    extra, place = hidden[0] * mass, np.array(hidden[1:], float)
    reduced = mass * extra / (mass + extra)
    moved = inertia + reduced * (place @ place * np.eye(3) - np.outer(place, place))
    return moved, place * extra / (mass + extra)
