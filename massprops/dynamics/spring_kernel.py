"""A mass on a spring in a body whose rate is known: what it carries of angular momentum, compiled; import it late."""

from __future__ import annotations

import math

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy")
def _answers(step: float, stiff: float, damping: float) -> tuple[float, float, float, float]:
    """Exponential of [[0, 1], [-stiff, -damping]] over a step, by rows."""
    square, shrunk = 0.25 * damping * damping - stiff, math.exp(-0.5 * damping * step)
    root = math.sqrt(abs(square))
    x = root * step
    if x < 1e-9:
        even, odd = shrunk, step * shrunk
    elif square > 0.0:
        even, odd = math.cosh(x) * shrunk, math.sinh(x) / root * shrunk
    else:
        even, odd = math.cos(x) * shrunk, math.sin(x) / root * shrunk
    return even + 0.5 * damping * odd, odd, -stiff * odd, even - 0.5 * damping * odd


@numba.njit(cache=True, error_model="numpy")
def momentum_inside(t: np.ndarray, w: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(n, m, 3) angular momentum beside that of the mass at rest, body axes, for m sets of values (m, 10).

    Args:
        t: (n,) [s]; w: (n, 3) rate of the body; values: arm, displacement, velocity, unit way, frequency and damping of each set, in the units
            of `spring-mass-damper`.
    """
    n, m = len(t), len(values)
    out = np.empty((n, m, 3))
    for i in range(m):
        ax, ay, az, s, speed, ux, uy, uz, frequency, damping = values[i]
        lx, ly, lz = ay * uz - az * uy, az * ux - ax * uz, ax * uy - ay * ux
        out_by, soft_before = ax * ux + ay * uy + az * uz, 0.0
        first, second, y, v = 0.0, 0.0, s, speed
        for k in range(n):
            x, b, c = w[k]
            along, square = x * ux + b * uy + c * uz, x * x + b * b + c * c
            arm = x * ax + b * ay + c * az
            turning, soft = x * lx + b * ly + c * lz, square - along * along
            # the drives of displacement and speed
            one, two = -turning, damping * turning + square * out_by - arm * along
            if k == 0:
                v = speed + turning
            else:
                h = t[k] - t[k - 1]
                stiff = frequency * frequency - 0.5 * (soft + soft_before)
                p, q, r, z = _answers(h, stiff, damping)
                e, f, g, d = _answers(0.5 * h, stiff, damping)
                a1, a2 = 0.5 * (first + one), 0.5 * (second + two)
                y, v = (
                    p * y + q * v + h / 6.0 * (p * first + q * second + 4.0 * (e * a1 + f * a2) + one),
                    r * y + z * v + h / 6.0 * (r * first + z * second + 4.0 * (g * a1 + d * a2) + two),
                )
            first, second, soft_before = one, two, soft
            # (arm + y u) x (w x (arm + y u)) - arm x (w x arm) + speed arm x u
            rate = v - turning
            bx, by, bz = ax + y * ux, ay + y * uy, az + y * uz
            more = 2.0 * y * out_by + y * y
            there = arm + y * along
            out[k, i, 0] = x * more - bx * there + ax * arm + rate * lx
            out[k, i, 1] = b * more - by * there + ay * arm + rate * ly
            out[k, i, 2] = c * more - bz * there + az * arm + rate * lz
    return out
