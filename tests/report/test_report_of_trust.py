"""What the page says first, what else the object may be, and the switch between two colourings."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from fake_run import HOSTILE, make_run, spacecraft

from massprops.report import write_report
from massprops.report.meshes import Shape, decimated, read_shape
from massprops.report.viewer import viewer
from massprops.run.stages.publish import mesh_ply


def painted(run: Path) -> tuple[np.ndarray, np.ndarray]:
    """Puts a mesh with all three origins and colours into a run."""
    mesh = spacecraft()
    v, f = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    height = mesh.triangles_center[:, 2]
    origin = np.where(height < -0.65, 2, np.where(height < -0.3, 0, 1)).astype(np.uint8)
    rgb = np.column_stack([np.where(v[:, 0] > 0, 200, 20), np.full(len(v), 90), np.full(len(v), 40)]).astype(np.uint8)
    (run / "mesh.ply").write_bytes(mesh_ply(v, f, origin, rgb))
    return origin, rgb


def test_origins_and_colours_come_from_the_mesh_file(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run")
    origin, rgb = painted(run)
    shape = read_shape(run, 1.0)
    assert shape is not None and shape.inferred is not None and shape.rgb is not None
    assert np.array_equal(shape.inferred, origin == 2) and np.array_equal(shape.observed, origin == 1)
    assert np.array_equal(shape.rgb, rgb)
    light = decimated(shape, 1500)
    assert light.rgb is not None and light.inferred is not None and len(light.faces) <= 1500
    clear = np.abs(light.vertices[:, 0]) > 0.2
    assert np.array_equal(light.rgb[clear, 0] > 100, light.vertices[clear, 0] > 0)


def test_the_page_has_a_switch_to_the_photographs_colours(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run")
    assert 'data-mode="colour"' not in write_report(run).read_text(), "no colours, no switch"
    origin, rgb = painted(run)
    page = write_report(run).read_text()
    assert 'data-mode="colour" aria-pressed="true"' in page and "closed at the plane it stood on" in page
    data = json.loads(re.search(r'application/json">(.*?)</script>', page).group(1))  # type: ignore[union-attr]
    unpack = {k: np.frombuffer(base64.b64decode(data[k]), np.uint8) for k in ("rgb", "filled", "inferred")}
    assert np.array_equal(unpack["rgb"].reshape(-1, 3), rgb)
    for key, value in (("filled", 0), ("inferred", 2)):
        assert np.array_equal(np.unpackbits(unpack[key], bitorder="little")[: len(origin)], origin == value)


def test_a_mesh_without_flags_has_no_switches() -> None:
    mesh = spacecraft()
    plain = viewer(Shape(np.asarray(mesh.vertices), np.asarray(mesh.faces), np.ones(len(mesh.faces), bool)))
    assert (
        "data-show" not in plain and "data-mode" not in plain and '"inferred": null' in plain and '"rgb": null' in plain
    )


@pytest.mark.parametrize(("level", "box"), [("high", "done"), ("medium", "warning"), ("low", "stopped")])
def test_confidence_comes_first(tmp_path: Path, level: str, box: str) -> None:
    run = make_run(tmp_path / "run")
    document = json.loads((run / "massprops.json").read_text())
    document["confidence"] = {"level": level, "because": ["first reason", HOSTILE]}
    (run / "massprops.json").write_text(json.dumps(document))
    page = write_report(run).read_text()
    assert "window.hit=1</script>" not in page
    summary = page[page.index("<h2>Answer</h2>") :]
    assert summary.startswith(f'<h2>Answer</h2><div class="{box} confidence"><b>Confidence {level}</b>: first reason')


def test_both_readings_are_shown_with_their_options(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run")
    assert "What the object may be" not in write_report(run).read_text()
    place = run / "work" / "shape" / "placement0"
    place.mkdir(parents=True)
    (run / "work" / "scale" / "scale.json").write_text(json.dumps({"metres_per_unit": 4.1, "unit_per_sfm": 1.0}))
    readings = []
    for k, what in enumerate(("the object without what it stands on", HOSTILE)):
        cv2.imwrite(str(place / f"reading{k}.png"), np.full((30, 40, 3), 90, np.uint8))
        readings.append(
            {"reading": what, "extent": [0.3, 0.2, 0.1], "used": k == 0, "option": "--keep-support",
             "picture": f"placement0/reading{k}.png", "image": "cam0/000000.png"}
        )  # fmt: skip
    (run / "work" / "shape" / "shape.json").write_text(json.dumps({"placements": [{"readings": readings}], "lost": []}))
    page = write_report(run).read_text()
    section = page[page.index('<section id="readings">') : page.index('<section id="numbers">')]
    assert section.count("<img") == 2 and section.count("--keep-support") == 2 and section.count("measured here") == 1
    assert "window.hit=1</script>" not in section and "1.23" in section, "0.3 in metres"
    readings[0]["picture"] = "../../../secret.png"
    cv2.imwrite(str(run.parent / "secret.png"), np.zeros((9, 9, 3), np.uint8))
    (run / "work" / "shape" / "shape.json").write_text(json.dumps({"placements": [{"readings": readings}], "lost": []}))
    page = write_report(run).read_text()
    section = page[page.index('<section id="readings">') : page.index('<section id="numbers">')]
    assert section.count("<img") == 1, "no picture from outside the run"
