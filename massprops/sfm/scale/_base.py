"""What a scale source is given and gives, and how several are weighed."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from massprops.sequence.data import RangeSeries
from massprops.sfm.points import SparsePoints
from massprops.views import Views


@dataclass(frozen=True)
class ScaleInputs:
    """Everything a source may look at; lengths in the units of the reconstruction.

    Attributes:
        length: greatest length of the mesh, that is one model unit.
        views: registered images.
        points: sparse points, or None.
        centre_of_mass: (3,) of the mesh at constant density, or None.
        frames: folder of the stored frames, or None.
        range: chaser to centre of mass, or None.
        rig_metres: metres per unit of the reconstruction by a rig's mounting, or None.
        focal_sigma: relative 1-sigma of the focal length: distances to the object, over its size, are in proportion to it.
        given: metres per model unit, or None.
        given_sigma: relative 1-sigma of any length that the user gave.
        distance: two points and metres, or None.
        named: (3,) points in model units by name.
        marker: as in `ReconstructOptions`, or None.
    """

    length: float
    views: Views | None = None
    points: SparsePoints | None = None
    centre_of_mass: np.ndarray | None = None
    frames: Path | None = None
    range: RangeSeries | None = None
    rig_metres: float | None = None
    focal_sigma: float = 0.0
    given: float | None = None
    given_sigma: float = 0.0
    distance: tuple[str, str, float] | None = None
    named: dict[str, np.ndarray] = field(default_factory=dict)
    marker: str | None = None


@dataclass(frozen=True)
class ScaleEstimate:
    """One source's answer: metres per unit of the reconstruction, relative 1-sigma, and remarks."""

    source: str
    metres_per_sfm: float
    relative_sigma: float
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Scale:
    """The scale that is used.

    Attributes:
        source: name of the source, or `none`.
        metres_per_unit: metres per model unit, or None.
        unit_per_sfm: model units per unit of the reconstruction.
        relative_sigma: 1-sigma, or None.
        all: every source's estimate.
        warnings: one line each.
    """

    source: str
    metres_per_unit: float | None
    unit_per_sfm: float
    relative_sigma: float | None
    all: tuple[ScaleEstimate, ...] = ()
    warnings: tuple[str, ...] = ()

    def document(self) -> dict[str, Any]:
        """`scale.json`."""
        return {
            "source": self.source,
            "metres_per_unit": self.metres_per_unit,
            "unit_per_sfm": self.unit_per_sfm,
            "relative_sigma": self.relative_sigma,
            "sources": [
                {
                    "source": e.source,
                    "metres_per_unit": e.metres_per_sfm / self.unit_per_sfm,
                    "relative_sigma": e.relative_sigma,
                }
                for e in self.all
            ],
            "warnings": list(self.warnings),
        }


def choose(found: list[ScaleEstimate], length: float) -> Scale:
    """The most precise source; others that disagree by more than three sigma (or 1 %) become warnings."""
    warnings = [w for e in found for w in e.warnings]
    if not found:
        return Scale("none", None, 1 / length, None, (), tuple(warnings))
    best = min(found, key=lambda e: e.relative_sigma)
    for other in found:
        gap = other.metres_per_sfm / best.metres_per_sfm - 1
        if other is not best and abs(gap) > max(0.01, 3 * math.hypot(best.relative_sigma, other.relative_sigma)):
            warnings.append(
                f"scale: {other.source} differs from {best.source} by {100 * gap:+.1f} %; {best.source} is used, "
                "being the more precise; check both"
            )
    return Scale(
        best.source,
        best.metres_per_sfm * length,
        1 / length,
        best.relative_sigma,
        tuple(found),
        tuple(warnings),
    )
