"""Fuzzed: what commands read from a run folder that somebody handed over, with no record of what massprops wrote there."""

from __future__ import annotations

import json
import os
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from massprops.errors import MasspropsError

sys.path.insert(0, str(Path(__file__).parents[1] / "report"))
from fake_run import add_everything, make_run

COUNT, SIZE = 4, (48, 36)
PAGES = (
    "massprops.json", "crosscheck.json", "report.json", "run.yaml", "compare.json", "mesh.ply", "work/capture/footage.json",
    "work/sfm/sfm.json", "work/sfm/points.npz", "work/sfm/views.npz", "work/dense/dense.json", "work/surface/surface.json",
    "work/scale/scale.json",
)  # fmt: skip
MASKS = (
    "work/capture/footage.json", "work/silhouettes/silhouettes.json", "work/sfm/views.npz", "work/join/views.npz",
    "work/surface/surface.npz", "work/shape/shape.json",
)  # fmt: skip
EXPORTS = (
    "massprops.json", "mesh.ply", "crosscheck.json", "work/scale/scale.json", "work/sfm/views.npz",
    "work/sfm/points.npz", "work/capture/footage.json",
)  # fmt: skip
POINTS = b"# picked in the viewer\ntip,0.1,0.2,0.3\n foot , 1e0, -2, .5\n\n"


@cache
def _files() -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as place:
        run = add_everything(make_run(Path(place) / "run", count=COUNT, size=SIZE))
        _complete(run)
        return {str(p.relative_to(run)): p.read_bytes() for p in sorted(run.rglob("*")) if p.is_file()}


def _complete(run: Path) -> None:
    """What `masks` and the exports read besides."""
    work, footage = run / "work", json.loads((run / "work/capture/footage.json").read_text())
    camera = {"id": 0, "width": SIZE[0], "height": SIZE[1], "source_size": [2 * SIZE[0], 2 * SIZE[1]]}
    footage |= {"source": "/none", "cameras": [camera], "left_out": []}
    for i, frame in enumerate(footage["frames"]):
        frame |= {"source_name": f"{i:06d}.png", "width": SIZE[0], "height": SIZE[1], "turn": i % 2}
        (work / "silhouettes/masks" / frame["name"]).parent.mkdir(parents=True, exist_ok=True)
        mask = cv2.imread(str(run / "masks" / f"{frame['name']}.png"), 0)
        cv2.imwrite(str(work / "silhouettes/masks" / f"{frame['name']}.png"), mask)
    (work / "capture/footage.json").write_text(json.dumps(footage))
    names = [frame["name"] for frame in footage["frames"]]
    for stage in ("join", "shape", "scale"):
        (work / stage).mkdir(exist_ok=True)
    (work / "join/views.npz").write_bytes((work / "sfm/views.npz").read_bytes())
    (work / "silhouettes/silhouettes.json").write_text(json.dumps({"left_out": {names[0]: "it is blurred"}}))
    (work / "shape/shape.json").write_text(json.dumps({"placements": [{"images": names}], "lost": []}))
    (work / "scale/scale.json").write_text('{"metres_per_unit": 2.0, "unit_per_sfm": 0.5, "seed": 1}')
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    np.savez(work / "surface/surface.npz", vertices=vertices, faces=faces)


def around(folder: Path) -> None:
    """The whole run."""
    for name, content in _files().items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def _pages(folder: Path, name: str) -> object:
    from massprops.report.data import read_run
    from massprops.report.page import page
    from massprops.report.runs import write_runs

    with tempfile.TemporaryDirectory() as place:
        write_runs(Path(place), [folder, folder])
    return page(read_run(folder))


def _masks(folder: Path, name: str) -> object:
    from massprops.run.masks import masks

    with tempfile.TemporaryDirectory() as place:
        try:
            return masks(folder, Path(place) / "below" / "out")
        finally:
            if {p.name for p in Path(place).iterdir()} - {"below"} or {
                p.name for p in (Path(place) / "below").glob("*")
            } - {"out"}:
                raise AssertionError("masks wrote outside of its folder")


def _exports(folder: Path, name: str) -> object:
    from massprops.exchange.export import export
    from massprops.exchange.formats import formats

    with tempfile.TemporaryDirectory() as place:
        said: list[MasspropsError] = []
        for to in formats():
            try:
                export(folder, to, Path(place) / to / "out")
            except MasspropsError as error:
                said.append(error)
        if said:
            raise said[0]
    return None


def _picked(folder: Path, name: str) -> object:
    from massprops.sfm.scale.distance import check, read_named

    named = read_named(folder)
    if len(named) > 1:
        check((*sorted(named)[:2], 1.0), named)
    return named


def seeds(names: tuple[str, ...]) -> dict[str, list[bytes]]:
    """Good content of files of the run."""
    return {name: [_files()[name]] for name in names if name in _files()}


def run_targets(target: Any) -> dict[str, Any]:
    """The targets by name, each made when asked for; `target` is the class."""
    os.environ.setdefault("BROWSER", "true")
    return {
        "run-pages": lambda: target(seeds(PAGES), _pages, around),
        "run-masks": lambda: target(seeds(MASKS), _masks, around),
        "run-exports": lambda: target(seeds(EXPORTS), _exports, around),
        "picked-points": lambda: target({"points.csv": [POINTS]}, _picked),
    }
