"""What acts from outside, as functions of time: the planet, the Sun, the magnetic field. Inertial axes are cam0's at
the first timestamp."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from massprops.dynamics import orbit
from massprops.sequence.data import Environment, Orbit


class EnvironmentState(NamedTuple):
    """What an effect may ask of the surroundings at a moment; inertial axes.

    Attributes:
        position: of the chaser from the planet's centre [m]; sun: direction; field: [T], constant or along the orbit.
        mu: [m^3/s^2], 0 without an orbit.
    """

    position: tuple[Any, Any, Any]
    sun: tuple[float, float, float]
    field: tuple[Any, Any, Any]
    mu: float


class EnvironmentModel:
    """The environment of a sequence, ready to be asked at any time.

    Attributes:
        mu: [m^3/s^2], 0 without an orbit; sun, field: three components each, inertial; zeros when unknown. dipole: the planet's
            (3,) [T m^3], whose field along the orbit stands in place of a constant one, or None.
        falls: whether the target falls freely beside the chaser; otherwise its path is straight in inertial axes.
        compiled: whether a free body's rotation, too, goes by the compiled kernel. It takes a second to load, which pays where
            many integrations are to come; effects of the catalogue always go by it.
    """

    def __init__(self, environment: Environment, falls: bool = True, compiled: bool = False) -> None:
        self.compiled = compiled
        self.orbit = environment.orbit
        self.falls = falls and environment.orbit is not None
        self.lvlh = environment.chaser_attitude == "lvlh" and environment.orbit is not None
        self.mu = environment.orbit.mu_m3_s2 if environment.orbit else 0.0
        self.sun = _three(environment.sun_direction)
        self.field = _three(environment.magnetic_field_T)
        self.dipole = environment.magnetic_dipole_T_m3
        self.known = {
            name
            for name, there in (
                ("orbit", environment.orbit is not None),
                ("sun direction", environment.sun_direction is not None),
                ("magnetic field", environment.magnetic_field_T is not None or self.dipole is not None),
            )
            if there
        }
        if self.orbit is not None:
            o = self.orbit
            self._motion = math.sqrt(o.mu_m3_s2 / o.semi_major_axis_m**3)
            half = math.tan(o.true_anomaly_rad / 2) * math.sqrt((1 - o.eccentricity) / (1 + o.eccentricity))
            E = 2 * math.atan(half)
            self._mean = E - o.eccentricity * math.sin(E)
            self._rows = [[float(v) for v in row] for row in np.asarray(o.R_inertial_perifocal)]

    def position(self, t: Any) -> tuple[Any, Any, Any]:
        """Chaser from the planet's centre, inertial axes [m], at time(s) t; by Kepler's equation."""
        o = self.orbit
        assert o is not None
        E = eccentric_anomaly(self._mean + self._motion * t, o.eccentricity)
        sine, cosine = (math.sin(E), math.cos(E)) if isinstance(E, float) else (np.sin(E), np.cos(E))
        x = o.semi_major_axis_m * (cosine - o.eccentricity)
        y = o.semi_major_axis_m * math.sqrt(1 - o.eccentricity**2) * sine
        (a, b, _), (c, d, _), (e, f, _) = self._rows
        return a * x + b * y, c * x + d * y, e * x + f * y

    def state(self, t: Any, orbiting: bool = True) -> EnvironmentState:
        """All that effects ask for at time(s) t; the position is zeros without an orbit, or where none asks for it."""
        place = self.position(t) if orbiting and self.orbit is not None else (0.0, 0.0, 0.0)
        return EnvironmentState(place, self.sun, self.field_at(t), self.mu)

    def field_at(self, t: Any) -> tuple[Any, Any, Any]:
        """Magnetic field at time(s) t, inertial axes [T]."""
        if self.dipole is None:
            return self.field
        x, y, z = self.position(t)
        square = x * x + y * y + z * z
        a, b, c = (float(v) for v in self.dipole)
        along, cube = 3.0 * (a * x + b * y + c * z) / square, square**1.5
        return (along * x - a) / cube, (along * y - b) / cube, (along * z - c) / cube

    def known_in_body(self, times: np.ndarray, R: np.ndarray) -> dict[str, np.ndarray]:
        """Unit vectors (n, 3) to the Sun, along the field and down to the planet, as far as they are known, in the axes of a body.

        Args:
            times: (n,) [s]; R: (n, 3, 3) body to inertial axes.
        """
        out: dict[str, Any] = {}
        if "sun direction" in self.known:
            out["sun"] = self.sun
        if "magnetic field" in self.known:
            out["field"] = self.field_at(times)
        if "orbit" in self.known:
            out["nadir"] = tuple(-v for v in self.position(times))
        for name, inertial in out.items():
            v = np.stack(np.broadcast_arrays(*inertial, times)[:3], axis=-1)
            out[name] = np.einsum("nji,nj->ni", R, v / np.linalg.norm(v, axis=1, keepdims=True))
        return out

    def chaser_turn(self, times: np.ndarray) -> np.ndarray:
        """(n, 3, 3) from inertial axes to cam0's: the orbital frame's turn since the first time, or none."""
        if not self.lvlh:
            return np.broadcast_to(np.eye(3), (len(times), 3, 3))
        r = np.stack(np.broadcast_arrays(*self.position(np.asarray(times, float))), axis=-1)
        first = np.array(self.position(0.0))
        normal = np.asarray(self.orbit.R_inertial_perifocal)[:, 2]  # type: ignore[union-attr]

        def frame(v: np.ndarray) -> np.ndarray:
            x = v / np.linalg.norm(v, axis=-1, keepdims=True)
            z = np.broadcast_to(normal, x.shape)
            return np.stack([x, np.cross(z, x), z], axis=-2)

        # cam0 keeps its orientation against the orbital frame: C(t) = L(0)^T L(t)
        return frame(first).T @ frame(r)


def eccentric_anomaly(mean: Any, eccentricity: float) -> Any:
    """Solves M = E - e sin E by Newton's method; a float gives a float."""
    if isinstance(mean, float):
        E = mean if eccentricity < 0.8 else math.pi
        for _ in range(30):
            step = (E - eccentricity * math.sin(E) - mean) / (1 - eccentricity * math.cos(E))
            E -= step
            if abs(step) < 1e-14 * max(1.0, abs(E)):
                break
        return E
    return orbit.eccentric_anomaly(np.asarray(mean, float), eccentricity)


def _three(vector: np.ndarray | None) -> tuple[float, float, float]:
    return (0.0, 0.0, 0.0) if vector is None else tuple(float(v) for v in vector)  # type: ignore[return-value]


__all__ = ["EnvironmentModel", "Orbit", "eccentric_anomaly"]
