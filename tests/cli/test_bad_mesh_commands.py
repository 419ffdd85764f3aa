"""What bad meshes and broken runs get from `mass`, `compare`, `export` and `crosscheck`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from whole import assert_one_line, massprops

FORMATS = ("filter", "urdf", "mjcf", "sdf", "basilisk", "csv", "json")
METRIC = ("urdf", "mjcf", "sdf", "basilisk")


def box() -> trimesh.Trimesh:
    return trimesh.creation.box((1.0, 2.0, 3.0))


def save(mesh: trimesh.Trimesh, path: Path) -> Path:
    mesh.export(path)
    return path


def with_holes(path: Path) -> Path:
    mesh = trimesh.creation.icosphere(3)
    mesh.update_faces(np.arange(len(mesh.faces)) % 4 > 0)
    return save(mesh, path)


def half_open(path: Path) -> Path:
    mesh = box()
    mesh.update_faces(np.arange(12) < 6)
    return save(mesh, path)


def text(path: Path, content: str) -> Path:
    path.write_text(content)
    return path


BAD_MESHES: dict[str, tuple[Callable[[Path], Path], str]] = {
    "missing": (lambda t: t / "no.stl", "no such"),
    "no faces": (lambda t: text(t / "m.off", "OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n"), "face"),
    "empty": (lambda t: text(t / "m.stl", ""), "m.stl"),
    "text": (lambda t: text(t / "m.stl", "not a mesh at all\n" * 30), "m.stl"),
    "unknown ending": (lambda t: text(t / "m.step", "ISO-10303-21;"), "STL"),
    "half open": (lambda t: half_open(t / "m.stl"), "m.stl"),
    "with holes": (lambda t: with_holes(t / "m.ply"), "m.ply"),
    "flat": (lambda t: text(t / "m.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"), "m.off"),
    "not finite": (lambda t: text(t / "m.off", "OFF\n3 1 0\nnan 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"), "m.off"),
}


@pytest.mark.parametrize("scale", ["1e-300", "1e300"])
def test_a_scale_that_nobody_means_is_called_by_name(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], scale: str
) -> None:
    said = massprops(capfd, "mass", save(box(), tmp_path / "box.stl"), "-o", tmp_path / "run", "--scale", scale)
    assert_one_line(said, 2, "--scale 1e", "m long: give the metres per unit")


def test_a_variable_of_the_shell_that_is_not_set_is_no_folder(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    part = save(box(), tmp_path / "box.stl")
    monkeypatch.chdir(tmp_path)
    for arguments in (("mass", part, "-o", ""), ("mass", "", "-o", "run")):
        assert_one_line(massprops(capfd, *arguments), 2, "an argument is empty")
    assert [p.name for p in tmp_path.iterdir()] == ["box.stl"]


@pytest.mark.parametrize("case", BAD_MESHES)
def test_a_mesh_that_is_no_closed_body(tmp_path: Path, capfd: pytest.CaptureFixture[str], case: str) -> None:
    build, says = BAD_MESHES[case]
    bad, good = build(tmp_path), save(box(), tmp_path / "box.stl")
    for arguments in (
        ("mass", bad, "-o", tmp_path / "run", "--json"),
        ("compare", good, bad, "-o", tmp_path / "c"),
        ("compare", bad, good, "--json"),
        ("export", bad, "--to", "urdf", "-o", tmp_path / "x.urdf"),
        ("simulate", bad, "-o", tmp_path / "seq", "-q"),
    ):
        said = massprops(capfd, *arguments)
        assert_one_line(said, 2, bad.name, says)
        assert said.out == ""
    assert not any((tmp_path / name).exists() for name in ("run", "c", "x.urdf", "seq")), "nothing half done is left"


def made_run(place: Path, **changes: Any) -> Path:
    """A run folder as far as `export` and `crosscheck` read it."""
    place.mkdir()
    box().export(place / "mesh.ply")
    content = {
        "format": "massprops/1",
        "units": {"length": "m", "mass": "kg"},
        "density": 1000.0,
        "volume": 6.0,
        "mass": 6000.0,
        "center_of_mass": [0.0, 0.0, 0.0],
        "inertia": [[6500.0, 0, 0], [0, 5000.0, 0], [0, 0, 2500.0]],
        "principal_moments": [2500.0, 5000.0, 6500.0],
        "principal_axes": [[0, 0, 1.0], [0, 1.0, 0], [1.0, 0, 0]],
        "inertia_ratios": {"k1": float(np.log(0.5)), "k2": float(np.log(5 / 6.5))},
        "interval_90": {},
        "scale": {"source": "given", "metres_per_unit": 1.0, "relative_sigma": 0.0},
        "surface": {"watertight": True, "area": 22.0, "observed_fraction": 1.0},
        "warnings": [],
    }
    (place / "massprops.json").write_text(json.dumps({**content, **changes}))
    return place


NO_BODY: dict[str, tuple[dict[str, Any], str]] = {
    "mass of nothing": ({"mass": 0.0}, "mass must be above 0"),
    "negative mass": ({"mass": -5.0}, "mass must be above 0"),
    "no inertia": ({"inertia": None}, "make the run again"),
    "not symmetric": ({"inertia": [[3.0, 1, 0], [0, 3, 0], [0, 0, 3]]}, "symmetric"),
    "triangle inequality": ({"inertia": [[1.0, 0, 0], [0, 1, 0], [0, 0, 5]]}, "triangle inequality"),
    "negative moment": ({"inertia": [[-1.0, 0, 0], [0, 1, 0], [0, 0, 1]]}, "no body has them"),
}


@pytest.mark.parametrize("case", NO_BODY)
def test_no_format_is_written_of_a_body_that_cannot_be(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], case: str
) -> None:
    changes, says = NO_BODY[case]
    run = made_run(tmp_path / "run", **changes)
    before = sorted(run.iterdir())
    for form in FORMATS:
        assert_one_line(massprops(capfd, "export", run, "--to", form), 2, says)
    assert sorted(run.iterdir()) == before


def test_exports_that_need_metres(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    run = made_run(tmp_path / "run", units={"length": "model", "mass": "model"})
    for form in METRIC:
        said = massprops(capfd, "export", run, "--to", form)
        assert_one_line(said, 2, "model units", "--scale, --distance or --marker")
    assert sorted(p.name for p in run.iterdir()) == ["massprops.json", "mesh.ply"]
    assert massprops(capfd, "export", run, "--to", "json").code == 0


BAD_RUNS: dict[str, tuple[Callable[[Path], object], str]] = {
    "no mesh": (lambda run: (run / "mesh.ply").unlink(), "no mesh.ply"),
    "no document": (lambda run: (run / "massprops.json").unlink(), "no massprops.json"),
    "document cut short": (lambda run: (run / "massprops.json").write_text('{"mass": 1'), "massprops.json"),
    "document of another kind": (lambda run: (run / "massprops.json").write_text("[1, 2]"), "massprops.json"),
    "mesh of text": (lambda run: (run / "mesh.ply").write_text("no mesh"), "mesh.ply"),
    "mesh with holes": (lambda run: with_holes(run / "mesh.ply"), "mesh.ply"),
}


@pytest.mark.parametrize("case", BAD_RUNS)
def test_a_broken_run(tmp_path: Path, capfd: pytest.CaptureFixture[str], case: str) -> None:
    change, says = BAD_RUNS[case]
    run = made_run(tmp_path / "run")
    change(run)
    before = sorted(run.iterdir())
    for arguments in (
        ("export", run, "--to", "urdf"),
        ("compare", run, save(box(), tmp_path / "box.stl"), "-o", tmp_path / "c"),
        ("crosscheck", run, "-q"),
    ):
        if arguments[0] == "crosscheck" and "mesh" in case:
            says = "give one of the same footage with --sequence"  # it reads the numbers, not the mesh
        assert_one_line(massprops(capfd, *arguments), 2, says)
    assert sorted(run.iterdir()) == before


def test_a_mesh_inside_out_is_turned_with_a_warning(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    mesh = box()
    mesh.invert()
    turned = save(mesh, tmp_path / "m.stl")
    said = massprops(capfd, "mass", turned, "-o", tmp_path / "run", "--json")
    assert said.code == 0 and json.loads(said.out)["volume"] == pytest.approx(6.0)
    assert any("warning" in line and "inside out" in line for line in said.lines), said
    said = massprops(capfd, "export", turned, "--to", "urdf", "-o", tmp_path / "x.urdf")
    assert said.code == 0 and "inside out" in said.err and "warning" in said.err, said


OPTIONS = {
    ("mass", "-o", "run", "--density", "0"): "density",
    ("mass", "-o", "run", "--density", "-1"): "density",
    ("mass", "-o", "run", "--density", "nan"): "density",
    ("mass", "-o", "run", "--scale", "0"): "--scale",
    ("mass", "-o", "run", "--scale", "inf"): "--scale",
    ("mass", "-o", "run", "--scale-sigma", "2"): "--scale-sigma",
    ("mass",): "-o",
    ("export", "--to", "dwg"): "filter",
    ("export", "--to", "urdf", "--mass", "0"): "--mass",
    ("export", "--to", "urdf", "--mass", "-3"): "--mass",
    ("export", "--to", "urdf", "--density", "-3"): "density",
    ("export", "--to", "urdf", "--density", "nan"): "density",
    ("export",): "--to",
}


@pytest.mark.parametrize("options", OPTIONS)
def test_an_option_out_of_range(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    save(box(), tmp_path / "box.stl")
    assert_one_line(massprops(capfd, options[0], "box.stl", *options[1:]), 2, OPTIONS[options])
    assert [p.name for p in tmp_path.iterdir()] == ["box.stl"]


NO_RUN = ("nowhere", "empty", "box.stl")


@pytest.mark.parametrize("run", NO_RUN)
def test_crosscheck_of_what_is_no_run(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, run: str
) -> None:
    monkeypatch.chdir(tmp_path)
    save(box(), tmp_path / "box.stl")
    (tmp_path / "empty").mkdir()
    assert_one_line(massprops(capfd, "crosscheck", run, "-q"), 2, run)


def test_crosscheck_without_a_sequence(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    run = made_run(tmp_path / "run")
    assert_one_line(massprops(capfd, "crosscheck", run, "-q"), 2, "no sequence/ in this run", "--sequence")
    said = massprops(capfd, "crosscheck", run, "-q", "--sequence", tmp_path / "nowhere")
    assert_one_line(said, 2, "give a sequence folder or a run folder")
