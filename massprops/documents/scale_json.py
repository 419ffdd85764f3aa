"""`work/scale/scale.json` of a run: what turns the units of structure from motion into final ones."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from massprops.documents.fields import Number, Text, document, read
from massprops.documents.loading import load_json


@document(others="ignored")
class ScaleStageFile:
    """What the scale stage of a run found."""

    source: Annotated[str, Text("`none`, `given`, or a source of `massprops.sfm.scale`")] | None = None
    metres_per_unit: Annotated[float, Number("metres per unit of the mesh", "m", low=1e-15, high=1e15)] | None = None
    unit_per_sfm: (
        Annotated[float, Number("units of the mesh per unit of the structure from motion", "", low=1e-15, high=1e15)]
        | None
    ) = None
    relative_sigma: Annotated[float, Number("relative 1-sigma of the scale", "", low=0, high=10)] | None = None
    seed: Annotated[int, Number("of what was drawn", "", 0, 2**63 - 1, whole=True)] | None = None

    @property
    def factor(self) -> float:
        """Final length units per unit of the structure from motion."""
        return (self.metres_per_unit or 1.0) * (self.unit_per_sfm or 1.0)


def read_scale(run: Path) -> ScaleStageFile:
    """What a run's scale stage found.

    Raises:
        InputError: the run has no scale stage, or a damaged one.
    """
    path = run / "work" / "scale" / "scale.json"
    return read(ScaleStageFile, load_json(path), str(path))


def has_scale(run: Path) -> bool:
    """Whether a run got as far as its scale."""
    return (run / "work" / "scale" / "scale.json").is_file()
