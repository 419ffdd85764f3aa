"""`--distance A B METRES` between two points of the model."""

from __future__ import annotations

import numpy as np

from massprops.errors import InputError
from massprops.sfm.scale.base import ScaleEstimate, ScaleInputs

PICKED = 2e-3
"""1-sigma of a point picked by hand, in model units."""


def estimate(inputs: ScaleInputs) -> ScaleEstimate | None:
    """Points are `x,y,z` in model units, names of picked points, or feature numbers of the sparse points."""
    if inputs.distance is None:
        return None
    a, b, metres = inputs.distance
    if not float(metres) > 0:
        raise InputError(f"--distance {a} {b} {metres}: the metres must be above 0")
    pa, sa = _point(a, inputs)
    pb, sb = _point(b, inputs)
    units = float(np.linalg.norm(pa - pb))
    if units < 1e-6:
        raise InputError(f"--distance {a} {b}: both are the same point; pick two that are far apart")
    sigma = np.hypot(np.hypot(sa, sb) / units, inputs.given_sigma)
    return ScaleEstimate("distance", float(metres) / units / inputs.length, float(sigma))


def _point(text: str, inputs: ScaleInputs) -> tuple[np.ndarray, float]:
    """Position and 1-sigma, both in model units."""
    if text in inputs.named:
        return np.asarray(inputs.named[text], float), PICKED
    parts = text.split(",")
    if len(parts) == 3:
        try:
            point = np.array([float(p) for p in parts])
        except ValueError:
            point = np.full(3, np.nan)
        if np.all(np.isfinite(point)):
            return point, PICKED
    if text.isdigit() and inputs.points is not None:
        row = np.flatnonzero(inputs.points.id == int(text))
        if len(row):
            return inputs.points.xyz[row[0]] / inputs.length, PICKED / 4
    raise InputError(
        f'--distance: "{text}" is no point; give "x,y,z" in model units, a picked name or a feature number'
    )
