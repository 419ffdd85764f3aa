"""Fisheye lenses in the terms of a pinhole camera with distortion.

A fisheye's image radius follows the angle t to the axis, t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8) (Kannala and Brandt
2006; COLMAP's OPENCV_FISHEYE). What works with a pinhole camera's distortion reads it as OpenCV's rational model,

    (1 + a1 u + a2 u^2 + a3 u^3) / (1 + b1 u + b2 u^2 + b3 u^3) of u = tan(t)^2.

The two agree to 2e-4 px up to 65 degrees off the axis, and to 0.02 px up to 80 (focal length 300 px).
"""

from __future__ import annotations

import numpy as np

WIDEST = np.deg2rad(80.0)
"""Angle to the axis beyond which no pinhole camera can follow."""

ROUNDS = 4
"""Rounds in which the rational fit's own denominator weighs its errors."""


def fisheye_factor(k: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Image radius over focal length and angle: 1 + k1 t^2 + ..., of k (4,) at angles (n,) [rad]."""
    return np.asarray(np.polynomial.polynomial.polyval(angle**2, np.concatenate([[1.0], k])))


def widest_angle(k: np.ndarray, radius: float) -> float:
    """Angle to the axis [rad] that reaches an image radius (over the focal length), `WIDEST` at most; k: (4,) coefficients."""
    angle = np.linspace(0.0, WIDEST, 2000)
    reached = angle * fisheye_factor(k, angle)
    beyond = np.flatnonzero((reached > radius) | (np.diff(reached, prepend=-1.0) <= 0))
    return float(angle[beyond[0]]) if len(beyond) else float(WIDEST)


def rational(k: np.ndarray, radius: float) -> np.ndarray:
    """(8,) OpenCV's k1, k2, p1, p2, k3, k4, k5, k6 of a fisheye.

    Args:
        k: (4,).
        radius: of the image, over the focal length, up to which they shall agree.
    """
    # dense at either end, where a fit by least squares is worst (Chebyshev's nodes)
    angle = max(widest_angle(k, radius), 0.1) * 0.5 * (1 - np.cos(np.linspace(0.02, np.pi, 400)))
    r = np.tan(angle)
    factor = fisheye_factor(k, angle) * angle / r
    u = (r / r[-1]) ** 2
    powers = np.stack([u, u**2, u**3], axis=1)
    rows = np.concatenate([powers, -factor[:, None] * powers], axis=1)
    weight = np.ones(len(u))
    # the linear equation is the fit's error times its denominator (Sanathanan and Koerner 1963)
    for _ in range(ROUNDS):
        coefficients = np.linalg.lstsq(rows * weight[:, None], (factor - 1) * weight, rcond=None)[0]
        weight = r / np.maximum(np.abs(1 + powers @ coefficients[3:]), 1e-6)
    a, b = (coefficients[i : i + 3] / r[-1] ** (2 * np.arange(1, 4)) for i in (0, 3))
    return np.array([a[0], a[1], 0.0, 0.0, a[2], *b])


def fisheye(distortion: np.ndarray, reach: float) -> np.ndarray:
    """(4,) k of the fisheye nearest to a pinhole camera with radial distortion.

    Args:
        distortion: (4,) OpenCV's k1, k2, p1, p2; the tangential terms are left out.
        reach: tangent of the angle to the axis up to which they shall agree.
    """
    angle = np.linspace(1e-3, np.arctan(reach), 200)
    u = np.tan(angle) ** 2
    wanted = np.tan(angle) / angle * (1 + u * (distortion[0] + u * distortion[1])) - 1
    t = angle**2
    return np.linalg.lstsq(np.stack([t, t**2, t**3, t**4], axis=1), wanted, rcond=1e-8)[0]
