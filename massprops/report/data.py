"""What the report reads of a run folder. Every part may be absent: a stopped run gets a report too."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Shape:
    """Mesh for the page: vertices (v, 3) final units, faces (f, 3), observed (f,) bool."""

    vertices: np.ndarray
    faces: np.ndarray
    observed: np.ndarray


@dataclass(frozen=True)
class RunData:
    """A run folder as read.

    Attributes:
        folder: the run.
        document: `massprops.json`, or {}.
        manifest: `run.yaml`, or {}.
        verdict: `report.json`, or {}.
        crosscheck, comparison, diagnosis, estimates: their JSON files where they exist, else {}.
        facts: per stage, its small JSON document.
        shape: the mesh, reduced for the page, or None.
        views: registered cameras in final units, or None.
    """

    folder: Path
    document: dict[str, Any]
    manifest: dict[str, Any]
    verdict: dict[str, Any]
    crosscheck: dict[str, Any]
    comparison: dict[str, Any]
    facts: dict[str, dict[str, Any]] = field(default_factory=dict)
    shape: Shape | None = None
    views: Any = None
    factor: float = 1.0

    @property
    def metric(self) -> bool:
        """Whether lengths are in metres."""
        return self.document.get("units", {}).get("length") == "m"

    @property
    def length_unit(self) -> str:
        return "m" if self.metric else "unit"

    @property
    def mass_unit(self) -> str:
        return "kg" if self.metric else "model mass"


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object, or {} when the file is absent or broken."""
    try:
        content = json.loads(path.read_text())
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def read_run(folder: Path) -> RunData:
    """Reads everything the page shows."""
    import yaml

    from massprops.views import Views

    try:
        manifest = yaml.safe_load((folder / "run.yaml").read_text()) or {}
    except (OSError, yaml.YAMLError):
        manifest = {}
    work = folder / "work"
    facts = {
        "footage": read_json(work / "capture" / "footage.json"),
        "sfm": read_json(work / "sfm" / "sfm.json"),
        "silhouettes": read_json(work / "silhouettes" / "silhouettes.json"),
        "dense": read_json(work / "dense" / "dense.json"),
        "surface": read_json(work / "surface" / "surface.json"),
        "scale": read_json(work / "scale" / "scale.json"),
    }
    scale = facts["scale"]
    factor = float(scale.get("metres_per_unit") or 1.0) * float(scale.get("unit_per_sfm") or 1.0)
    views = Views.load(work / "sfm" / "views.npz") if (work / "sfm" / "views.npz").is_file() else None
    return RunData(
        folder=folder,
        document=read_json(folder / "massprops.json"),
        manifest=manifest if isinstance(manifest, dict) else {},
        verdict=read_json(folder / "report.json"),
        crosscheck=read_json(folder / "crosscheck.json"),
        comparison=read_json(folder / "compare.json"),
        facts=facts,
        shape=_shape(folder, work, factor),
        views=views,
        factor=factor,
    )


def _shape(folder: Path, work: Path, factor: float) -> Shape | None:
    path = work / "surface" / "surface.npz"
    if path.is_file():
        with np.load(path, allow_pickle=False) as z:
            return lighten(Shape(z["vertices"] * factor, z["faces"], z["observed"].astype(bool)))
    if (folder / "mesh.ply").is_file():
        import trimesh

        mesh = trimesh.load(folder / "mesh.ply", force="mesh", process=False)
        return lighten(Shape(np.asarray(mesh.vertices), np.asarray(mesh.faces), np.ones(len(mesh.faces), bool)))
    return None


MOST_FACES = 50_000


def lighten(shape: Shape) -> Shape:
    """The shape with at most `MOST_FACES` faces; each takes the flag of the nearest original face."""
    if len(shape.faces) <= MOST_FACES:
        return shape
    import pymeshlab
    from scipy.spatial import cKDTree

    work = pymeshlab.MeshSet(verbose=False)
    work.add_mesh(pymeshlab.Mesh(np.asarray(shape.vertices, float), np.asarray(shape.faces, np.int32)))
    work.meshing_decimation_quadric_edge_collapse(targetfacenum=MOST_FACES, preservenormal=True)
    mesh = work.current_mesh()
    vertices, faces = mesh.vertex_matrix(), mesh.face_matrix()
    nearest = cKDTree(shape.vertices[shape.faces].mean(1)).query(vertices[faces].mean(1))[1]
    return Shape(vertices, faces, shape.observed[nearest])
