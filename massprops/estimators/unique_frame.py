"""One principal frame out of the 24 that a rigid body has (hu2024 section 3, the rule mended).

A principal frame T has its axes along the eigenvectors of the inertia: six orders and four sign choices with a right
hand. The order of the moments settles the order of the axes. The paper's single sign rule ("the first element of r1
is positive") leaves two frames, half a turn about x apart, and fails where that element is near zero; here a
component of r1 and one of r3 must be positive, each the largest when the frame is first determined, and the same
components decide from then on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SignRule:
    """Which body components of the frame's x and z axes are positive: indices (...), of any batch shape."""

    x: np.ndarray
    z: np.ndarray


def sign_rule(inertia: np.ndarray) -> SignRule:
    """The rule that is furthest from a tie for this inertia (..., 3, 3): the largest components decide."""
    axes = np.linalg.eigh(inertia)[1]
    return SignRule(np.argmax(np.abs(axes[..., 2]), axis=-1), np.argmax(np.abs(axes[..., 0]), axis=-1))


def unique_frame(inertia: np.ndarray, rule: SignRule | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Moments (..., 3) from the largest to the smallest and their axes (..., 3, 3) as columns in body axes.

    Args:
        inertia: (..., 3, 3) in body axes, any scale.
        rule: which components are positive; by default the largest of each axis.
    """
    if rule is None:
        rule = sign_rule(inertia)
    moments, axes = np.linalg.eigh(inertia)
    x, z = axes[..., 2], axes[..., 0]
    x = x * _sign(np.take_along_axis(x, np.asarray(rule.x)[..., None], -1))
    z = z * _sign(np.take_along_axis(z, np.asarray(rule.z)[..., None], -1))
    return moments[..., ::-1], np.stack([x, np.cross(z, x), z], axis=-1)


def _sign(x: np.ndarray) -> np.ndarray:
    return np.where(x < 0, -1.0, 1.0)
