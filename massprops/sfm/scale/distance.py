"""`--distance A B METRES` between two points of the model."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from massprops.documents.loading import load_text
from massprops.errors import InputError
from massprops.sfm.scale._base import ScaleEstimate, ScaleInputs

PICKED = 2e-3
"""1-sigma of a point picked by hand, in model units."""


def read_named(source: Path) -> dict[str, np.ndarray]:
    """Picked points (3,) by name: `points.csv` beside the images, name,x,y,z in model units; none without that file.

    Raises:
        InputError: a line that holds no point.
    """
    path = source / "points.csv"
    if not path.is_file():
        return {}
    named = {}
    for number, line in enumerate(load_text(path).splitlines(), 1):
        if line.strip() and not line.startswith("#"):
            try:
                name, x, y, z = (part.strip() for part in line.split(","))
                named[name] = np.array([float(x), float(y), float(z)])
                if not np.isfinite(named[name]).all():
                    raise ValueError("not finite")
            except ValueError as error:
                raise InputError(f"{path}:{number}: not a picked point; write name,x,y,z in model units") from error
    return named


def check(distance: tuple[str, str, float], named: dict[str, np.ndarray]) -> None:
    """Says what can be said before there is a model.

    Raises:
        InputError: a length of nothing, one point twice, or something that can be no point.
    """
    a, b, metres = distance
    if not (float(metres) > 0 and np.isfinite(metres)):
        raise InputError(f"--distance {a} {b} {metres}: the metres must be a number above 0")
    if a == b:
        raise InputError(f"--distance {a} {b}: both are the same point; pick two that are far apart")
    for text in (a, b):
        if not text.isdigit():
            _given(text, named)


def estimate(inputs: ScaleInputs) -> ScaleEstimate | None:
    """Points are `x,y,z` in model units, names of picked points, or feature numbers of the sparse points."""
    if inputs.distance is None:
        return None
    check(inputs.distance, inputs.named)
    a, b, metres = inputs.distance
    pa, sa = _point(a, inputs)
    pb, sb = _point(b, inputs)
    units = float(np.linalg.norm(pa - pb))
    if units < 1e-6:
        raise InputError(f"--distance {a} {b}: both are the same point; pick two that are far apart")
    sigma = np.hypot(np.hypot(sa, sb) / units, inputs.given_sigma)
    return ScaleEstimate("distance", float(metres) / units / inputs.length, float(sigma))


def _point(text: str, inputs: ScaleInputs) -> tuple[np.ndarray, float]:
    """Position and 1-sigma, both in model units."""
    if text.isdigit() and text not in inputs.named and inputs.points is not None:
        row = np.flatnonzero(inputs.points.id == int(text))
        if len(row):
            return inputs.points.xyz[row[0]] / inputs.length, PICKED / 4
    return _given(text, inputs.named), PICKED


def _given(text: str, named: dict[str, np.ndarray]) -> np.ndarray:
    """(3,) a picked point, or coordinates in words."""
    if text in named:
        return np.asarray(named[text], float)
    try:
        point = np.array([float(part) for part in text.split(",")])
    except ValueError:
        point = np.empty(0)
    if point.shape == (3,) and np.all(np.isfinite(point)):
        return point
    raise InputError(
        f'--distance: "{text}" is no point; give "x,y,z" in model units, a picked name or a feature number'
    )
