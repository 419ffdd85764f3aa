"""What happens to the rotation's state at the one moment an effect acts, with its derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import Any

import numpy as np

from massprops.dynamics.kernels import quaternion_rate, to_body

STEP = 1e-30
"""Complex step: so small that its square vanishes."""


def struck(y: Sequence[Any], effect: ModuleType, p: Sequence[Any]) -> list[Any]:
    """The state just after: y = (q, h, extra) components, p the effect's own parameters.

    `swing` turns the body and leaves its momentum where it was in space; `jump` adds momentum.
    """
    q, h = list(y[:4]), list(y[4:7])
    if hasattr(effect, "swing"):
        sx, sy, sz = effect.swing(p)
        # the quaternion (1, swing / 2) over its length: smooth at zero, where an angle is not
        scale = (1.0 + 0.25 * (sx * sx + sy * sy + sz * sz)) ** -0.5
        rate = quaternion_rate(q[0], q[1], q[2], q[3], sx, sy, sz)
        q = [scale * (a + b) for a, b in zip(q, rate, strict=True)]
        half = 0.5 * scale
        h = list(to_body(scale, half * sx, half * sy, half * sz, *h))
    if hasattr(effect, "jump"):
        h = [a + b for a, b in zip(h, effect.jump(p), strict=True)]
    return [*q, *h, *y[7:]]


def stepped(values: Sequence[Any], j: int) -> list[Any]:
    """The values with a complex step of number j."""
    return [v + 1j * STEP if i == j else v for i, v in enumerate(values)]


def acts_at_once(effect: ModuleType) -> bool:
    """Whether the state is not continuous at the effect's moment."""
    return hasattr(effect, "jump") or hasattr(effect, "swing")


def struck_jacobian(y: Sequence[Any], effect: ModuleType, p: Sequence[Any]) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (ny, ny) by the state before and (ny, k) by the effect's parameters, by the complex step."""

    def columns(start: list[Any], other: Any, first: bool) -> np.ndarray:
        out = []
        for j in range(len(start)):
            moved = stepped(start, j)
            after = struck(moved, effect, other) if first else struck(other, effect, moved)
            out.append(np.imag(np.array(after, complex)) / STEP)
        return np.stack(out, axis=1)

    return columns(list(y), list(p), True), columns(list(p), list(y), False)
