"""Kepler motion of the chaser ("leader"): position, velocity and its local-vertical local-horizontal frame at any time.

Inertial axes are whatever `Orbit.R_inertial_perifocal` leads to: cam0's axes at the first timestamp in a sequence.
LVLH axes: x radially outward, z along the orbit's normal, y completing them (along-track), as in pesce2017.
"""

from __future__ import annotations

import numpy as np

from massprops.sequence.data import Orbit


def eccentric_anomaly(mean: np.ndarray, eccentricity: float) -> np.ndarray:
    """E of Kepler's equation E - e sin E = M (any shape) [rad], 0 <= e < 1, by Newton from Danby's start.

    A fixed number of steps, so that a value never depends on what else is in the array; none on a circle.
    """
    if eccentricity == 0.0:
        return np.array(mean, float)
    turns = np.round(mean / (2 * np.pi))
    M = mean - 2 * np.pi * turns
    E = M + 0.85 * eccentricity * np.sign(np.sin(M))
    for _ in range(12):
        E = E - (E - eccentricity * np.sin(E) - M) / (1.0 - eccentricity * np.cos(E))
    return E + 2 * np.pi * turns


def true_anomaly(orbit: Orbit, times: np.ndarray) -> np.ndarray:
    """True anomaly (...) [rad] at seconds `times` (...) after the orbit's first instant."""
    e = orbit.eccentricity
    half = np.sqrt((1 - e) / (1 + e))
    E0 = 2 * np.arctan2(half * np.sin(orbit.true_anomaly_rad / 2), np.cos(orbit.true_anomaly_rad / 2))
    motion = np.sqrt(orbit.mu_m3_s2 / orbit.semi_major_axis_m**3)
    E = eccentric_anomaly(E0 - e * np.sin(E0) + motion * np.asarray(times, float), e)
    return 2 * np.arctan2(np.sin(E / 2) / half, np.cos(E / 2))


def position_velocity(orbit: Orbit, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position [m] and velocity [m/s] (..., 3) from the Earth's centre, inertial axes, at `times` (...) [s]."""
    nu, e = true_anomaly(orbit, times), orbit.eccentricity
    parameter = orbit.semi_major_axis_m * (1 - e * e)
    radius = parameter / (1 + e * np.cos(nu))
    speed = np.sqrt(orbit.mu_m3_s2 / parameter)
    zero = np.zeros_like(nu)
    position = np.stack([radius * np.cos(nu), radius * np.sin(nu), zero], axis=-1)
    velocity = np.stack([-speed * np.sin(nu), speed * (e + np.cos(nu)), zero], axis=-1)
    return _turn(orbit.R_inertial_perifocal, position), _turn(orbit.R_inertial_perifocal, velocity)


def lvlh_axes(orbit: Orbit, times: np.ndarray) -> np.ndarray:
    """(..., 3, 3): columns are the LVLH axes (radial, along-track, normal) in inertial axes, at `times` (...) [s]."""
    nu = true_anomaly(orbit, times)
    c, s, zero = np.cos(nu), np.sin(nu), np.zeros_like(nu)
    rows = [[c, -s, zero], [s, c, zero], [zero, zero, zero + 1.0]]
    perifocal = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return np.asarray(np.asarray(orbit.R_inertial_perifocal) @ perifocal)


def lvlh_rate(orbit: Orbit, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angular velocity [rad/s] and acceleration [rad/s^2] (..., 3) of the LVLH frame, inertial axes.

    nu_dot = sqrt(mu / p^3) (1 + e cos nu)^2: pesce2017 eq 14 with its square taken out of the root.
    """
    nu, e = true_anomaly(orbit, times), orbit.eccentricity
    parameter = orbit.semi_major_axis_m * (1 - e * e)
    scale = np.sqrt(orbit.mu_m3_s2 / parameter**3)
    rate = scale * (1 + e * np.cos(nu)) ** 2
    acceleration = -2 * scale * (1 + e * np.cos(nu)) * e * np.sin(nu) * rate
    normal = np.asarray(orbit.R_inertial_perifocal)[:, 2]
    return rate[..., None] * normal, acceleration[..., None] * normal


def _turn(R: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("ij,...j->...i", np.asarray(R, float), v))
