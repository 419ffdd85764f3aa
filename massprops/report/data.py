"""What the report reads of a run folder. Every part may be absent: a stopped run gets a report too."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from massprops.core.outputs import Outputs
from massprops.documents.fields import read
from massprops.documents.loading import load_json, load_yaml
from massprops.documents.scale_json import ScaleStageFile
from massprops.errors import InputError
from massprops.report.meshes import Shape, decimated, read_compared, read_shape

READ = (
    *("massprops.json", "mesh.ply", "report.json", "crosscheck.json", "compare.json", "compare.ply"),
    *(f"work/{stage}" for stage in ("capture", "sfm", "shape", "silhouettes", "dense", "surface", "scale")),
)
"""What the page is made of, as the run's record names it."""


@dataclass(frozen=True)
class RunData:
    """A run folder as read.

    Attributes:
        folder: the run.
        document: `massprops.json`, or {}.
        manifest: `run.yaml`, or {}.
        verdict: `report.json`, or {}.
        crosscheck, comparison: their JSON files where they exist, else {}.
        facts: per stage, its small JSON document.
        shape: the mesh, reduced for the page, or None.
        compared: the mesh in the CAD's axes with its distances, or None; None too where `shape` has the distances.
        views: registered cameras in SfM units, or None.
        points: sparse points with their observations (`massprops.sfm.points`), SfM units, or None.
        factor: final units per SfM unit.
        changed: files and folders that are not what was written there; they are left out.
    """

    folder: Path
    document: dict[str, Any]
    manifest: dict[str, Any]
    verdict: dict[str, Any]
    crosscheck: dict[str, Any]
    comparison: dict[str, Any]
    facts: dict[str, dict[str, Any]] = field(default_factory=dict)
    shape: Shape | None = None
    compared: Shape | None = None
    views: Any = None
    points: Any = None
    factor: float = 1.0
    changed: tuple[str, ...] = ()

    @property
    def metric(self) -> bool:
        """Whether lengths are in metres."""
        return bool(self.document.get("units", {}).get("length") == "m")

    @property
    def length_unit(self) -> str:
        return "m" if self.metric else "unit"

    @property
    def mass_unit(self) -> str:
        return "kg" if self.metric else "model mass"

    @property
    def centre(self) -> np.ndarray | None:
        """(3,) centre of mass, or the mesh's middle where the run did not come so far."""
        centre = self.document.get("center_of_mass")
        if centre is not None:
            return np.array(centre, float)
        return None if self.shape is None else 0.5 * (self.shape.vertices.min(0) + self.shape.vertices.max(0))

    @property
    def camera_centres(self) -> np.ndarray:
        """(n, 3) camera centres in the mesh's axes and units."""
        return np.zeros((0, 3)) if self.views is None else self.views.centres * self.factor


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object, or {} when the file is absent or broken."""
    try:
        return load_json(path)
    except InputError:
        return {}


def _read_manifest(path: Path) -> dict[str, Any]:
    """`run.yaml`, or {} when it is absent or broken. What it says of the stage that makes the page is of an earlier page."""
    try:
        manifest = load_yaml(path)
    except InputError:
        return {}
    parts = ("inputs", "stages", "versions", "options")
    if any(not isinstance(manifest.get(part) or {}, dict) for part in parts):
        return {}
    (manifest.get("stages") or {}).pop("report", None)
    return manifest


def _factor(scale: dict[str, Any]) -> float:
    """Final length units per unit of the structure from motion."""
    try:
        return read(ScaleStageFile, scale, "scale.json").factor
    except InputError:
        return 1.0


def _read_points(folder: Path, views: Any) -> Any:
    from massprops.sfm.points import SparsePoints

    try:
        points = SparsePoints.load(folder / "work" / "sfm" / "points.npz")
        fits = views is not None and int(points.obs_view.max()) < len(views)
        return points if fits and int(points.obs_point.max()) < len(points.xyz) else None
    except (OSError, ValueError, KeyError):
        return None


def read_run(folder: Path) -> RunData:
    """Reads everything the page shows."""
    from massprops.views import Views

    outputs = Outputs(folder)
    changed = tuple(name for name in READ if not outputs.intact(name))

    def known(*parts: str) -> dict[str, Any]:
        whole = "/".join(parts[:2])
        return {} if whole in changed else read_json(folder / "/".join(parts))

    stages = ("sfm", "shape", "silhouettes", "dense", "surface", "scale")
    facts = {stage: known("work", stage, f"{stage}.json") for stage in stages}
    facts["footage"] = known("work", "capture", "footage.json")
    factor = _factor(facts["scale"])
    try:
        views = None if "work/sfm" in changed else Views.load(folder / "work" / "sfm" / "views.npz")
    except (OSError, ValueError, KeyError):
        views = None
    compared = None if "compare.ply" in changed else read_compared(folder)
    shape = None if {"mesh.ply", "work/surface"} & set(changed) else read_shape(folder, factor, compared)
    return RunData(
        folder=folder,
        document=known("massprops.json"),
        manifest=_read_manifest(folder / "run.yaml"),
        verdict=known("report.json"),
        crosscheck=known("crosscheck.json"),
        comparison=known("compare.json"),
        facts=facts,
        shape=shape,
        compared=None
        if compared is None or (shape is not None and shape.distance is not None)
        else decimated(compared),
        views=views,
        points=None if "work/sfm" in changed else _read_points(folder, views),
        factor=factor,
        changed=changed,
    )
