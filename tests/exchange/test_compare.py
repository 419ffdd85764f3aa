"""`massprops compare`: known poses found again, distances that are known by construction, and refusals."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from massprops.dynamics.quaternion import rotation_matrix
from massprops.errors import InputError
from massprops.exchange.alignment import align
from massprops.exchange.body import read_body
from massprops.exchange.compare import axis_angles, compare
from massprops.exchange.distances import surface_distances
from massprops.exchange.mesh_files import in_metres, read_mesh
from massprops.mass.integrals import greatest_length
from massprops.run.stages.publish import mesh_ply


def box(size: tuple, at: tuple) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(extents=size)
    mesh.apply_translation(at)
    return mesh


def spacecraft() -> trimesh.Trimesh:
    """A bus between two like arrays; a small box on one side is all that breaks the symmetry."""
    return trimesh.util.concatenate(
        [
            box((1.2, 1.0, 1.4), (0, 0, 0)),
            box((1.4, 0.04, 1.0), (1.35, 0, 0)),
            box((1.4, 0.04, 1.0), (-1.35, 0, 0)),
            box((0.3, 0.2, 0.15), (0.25, 0.65, 0.35)),
        ]
    )


def drum() -> trimesh.Trimesh:
    """A cylinder with a small box on its side: two like moments, and the turn about the axis from the box alone."""
    return trimesh.util.concatenate(
        [trimesh.creation.cylinder(0.5, 2, sections=64), box((0.1, 0.2, 0.3), (0.56, 0, 0.6))]
    )


def lump() -> trimesh.Trimesh:
    mesh = trimesh.creation.icosphere(subdivisions=3)
    v = np.array(mesh.vertices)
    v[:, 0] *= 1 + 0.3 * v[:, 1] + 0.2 * np.sin(2 * v[:, 2])
    return trimesh.Trimesh(v @ np.diag([1.0, 0.7, 0.5]), mesh.faces, process=False)


def measured_copy(mesh: trimesh.Trimesh, seed: int, noise: float = 0.002) -> trimesh.Trimesh:
    """The mesh as a reconstruction would give it: fine faces, waves and noise of a share of the length."""
    while len(mesh.faces) < 8_000:
        mesh = mesh.subdivide()
    rng = np.random.default_rng(seed)
    v, length = np.array(mesh.vertices), float(np.ptp(mesh.vertices, axis=0).max())
    waves = np.sin(v @ rng.normal(size=(3, 6)) * 6 / length + rng.uniform(0, 6, 6)).sum(1, keepdims=True) / 2
    v = v + mesh.vertex_normals * noise * length * (waves + 0.3 * rng.normal(size=(len(v), 1)))
    return trimesh.Trimesh(v, mesh.faces, process=False)


def pose(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    q = rng.normal(size=4)
    return rotation_matrix(q / np.linalg.norm(q)), 3 * rng.normal(size=3)


def moved(mesh: trimesh.Trimesh, R: np.ndarray, t: np.ndarray, scale: float = 1.0) -> trimesh.Trimesh:
    out = mesh.copy()
    out.apply_transform(np.block([[scale * R, t[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]))
    return out


def run_folder(folder: Path, mesh: trimesh.Trimesh, **changes: object) -> Path:
    """A run with this mesh."""
    folder.mkdir()
    mesh.export(folder / "body.stl")
    document = read_body(folder / "body.stl").document
    v, f = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    flags = np.ones(len(f), bool)
    (folder / "mesh.ply").write_bytes(mesh_ply(v, f, flags.astype(np.uint8), None))
    (folder / "massprops.json").write_text(json.dumps({**document, **changes}))
    return folder


@pytest.mark.parametrize(("body", "scale", "seed"), [(spacecraft, 1.0, 0), (spacecraft, 0.37, 1), (drum, 1.0, 2)])
def test_nearly_symmetric_bodies_are_laid_the_right_way_round(body, scale: float, seed: int) -> None:  # type: ignore[no-untyped-def]
    cad = body()
    R, t = pose(seed)
    found = align(moved(measured_copy(cad, seed), R, t, scale), cad, free_scale=scale != 1.0)
    turn = found.R @ R
    assert np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))) < 0.6
    assert np.allclose(found.apply(t[None]), 0, atol=0.01)
    assert found.scale * scale == pytest.approx(1.0, abs=1e-2)  # waves of 0.5 % of the length
    assert np.linalg.det(found.R) == pytest.approx(1.0)


def test_filled_faces_do_not_pull_the_alignment() -> None:
    cad = lump()
    ours = cad.copy()
    centre = ours.triangles_center
    filled = centre[:, 0] > 0.35
    v = np.array(ours.vertices)
    v[np.unique(ours.faces[filled])] *= 1.25
    bulged = trimesh.Trimesh(v, ours.faces, process=False)
    found = align(bulged, cad, False, measured=~filled)
    assert np.allclose(found.matrix, np.eye(4), atol=2e-3)


def test_distances_of_spheres_are_known() -> None:
    small, large = (trimesh.creation.icosphere(subdivisions=5, radius=r) for r in (1.0, 1.1))
    large.apply_translation([5e3, 0, 0])
    small.apply_translation([5e3, 0, 0])
    for ours, cad, sign in ((large, small, 1), (small, large, -1)):
        d = surface_distances(ours, cad, 2.0)
        for side in ("ours", "cad"):
            assert d[side]["mean_signed"] == pytest.approx(sign * 0.1, abs=1e-3)
            for key in ("median", "rms", "p95", "hausdorff"):
                assert d[side][key] == pytest.approx(0.1, abs=2e-3)


def test_one_way_and_the_other_differ_where_a_part_is_missing() -> None:
    whole, bare = spacecraft(), spacecraft().split(only_watertight=True)
    d = surface_distances(trimesh.util.concatenate(list(bare[:3])), whole, 4.1)
    assert d["ours"]["hausdorff"] < 1e-6
    assert d["cad"]["hausdorff"] > 0.2
    assert d["cad"]["mean_signed"] < 0
    assert d["hausdorff"] == d["cad"]["hausdorff"]


def test_a_run_against_its_own_cad(tmp_path: Path) -> None:
    cad = lump()
    R, t = pose(3)
    cad.export(tmp_path / "cad.stl")
    run = run_folder(tmp_path / "run", moved(cad, R, t))
    document = json.loads((run / "massprops.json").read_text())
    volume = document["volume"]
    document["interval_90"] = {"volume": [0.99 * volume, 1.01 * volume], "k1": [0.5, 0.6]}
    (run / "massprops.json").write_text(json.dumps(document))
    found = compare(run, tmp_path / "cad.stl", out=tmp_path / "out")
    assert not found.free_scale and not found.warnings
    for row in found.rows:
        if row["unit"] == "kg m^2":
            assert row["relative_error"] is not None
        else:
            assert abs(row["error"]) < 2e-3 * max(1.0, abs(row["cad"]))
        if row["relative_error"] is not None:
            assert abs(row["relative_error"]) < 1e-3
    assert found.row("volume")["holds"] is True
    assert found.row("k1")["holds"] is False
    assert found.row("I1")["holds"] is None
    # products are compared in the CAD's axes, whatever the run's axes are
    assert found.row("I_xy")["ours"] == pytest.approx(found.row("I_xy")["cad"], abs=1e-3 * found.row("I3")["cad"])

    written = json.loads((tmp_path / "out" / "compare.json").read_text())
    assert written["units"]["length"] == "m" and written["rows"] == found.document()["rows"]
    coloured = trimesh.load(tmp_path / "out" / "compare.ply", process=False)
    assert len(coloured.vertices) == len(found.vertex_distance)
    assert cv2.imread(str(tmp_path / "out" / "compare_legend.png")).shape == (90, 640, 3)


def test_a_run_in_model_units_gets_a_free_scale_and_says_so(tmp_path: Path) -> None:
    cad = lump()
    cad.export(tmp_path / "cad.obj")
    model = {"length": "model", "mass": "model"}
    bounds = {"volume": [1e-9, 2e-9], "k1": [-10, 10]}
    run = run_folder(tmp_path / "run", moved(cad, *pose(4), scale=0.5), units=model, interval_90=bounds)
    found = compare(run, tmp_path / "cad.obj")
    assert found.free_scale and "scale was fitted" in found.warnings[0]
    assert found.transform.scale == pytest.approx(2.0, rel=1e-3)
    assert found.row("k1")["holds"] is True
    assert found.row("volume")["holds"] is None  # its interval is in model units
    kept = compare(run, tmp_path / "cad.obj", free_scale=False)
    assert kept.transform.scale == 1.0 and "ratios" in kept.warnings[0]


def test_millimetres_are_recognised_or_given(tmp_path: Path) -> None:
    cad, large, odd = lump(), lump(), lump()
    length = greatest_length(np.asarray(cad.vertices))[0]
    large.apply_scale(1000)
    same, notes = in_metres(large, "auto", 1.05 * length)
    assert "mm" in notes[0] and np.allclose(same.vertices, cad.vertices)
    same, notes = in_metres(large, "mm", length)
    assert not notes and np.allclose(same.vertices, cad.vertices)
    odd.apply_scale(3)
    same, notes = in_metres(odd, "auto", length)
    assert "3 times longer" in notes[0] and same is odd
    assert in_metres(large) == (large, ())  # nothing to compare with: metres
    with pytest.raises(InputError, match="cad-unit"):
        in_metres(cad, "furlong")
    cad.export(tmp_path / "m.stl")
    large.export(tmp_path / "mm.stl")
    found = compare(tmp_path / "m.stl", tmp_path / "mm.stl")
    assert "mm" in found.warnings[0] and abs(found.row("volume")["relative_error"]) < 1e-4


def test_the_same_call_gives_the_same_numbers(tmp_path: Path) -> None:
    cad = lump()
    cad.export(tmp_path / "cad.ply")
    measured_copy(moved(cad, *pose(5)), 1).export(tmp_path / "ours.ply")
    first, second = (compare(tmp_path / "ours.ply", tmp_path / "cad.ply").document() for _ in range(2))
    assert first == second


def test_axes_of_like_moments_are_compared_as_a_plane() -> None:
    turn = rotation_matrix(np.array([np.cos(0.35), 0, 0, np.sin(0.35)]))
    assert np.allclose(axis_angles(turn, np.eye(3), np.array([1.0, 1.001, 3.0])), 0, atol=1e-9)
    assert np.allclose(axis_angles(turn, np.eye(3), np.array([1.0, 1.2, 2.0])), [np.degrees(0.7)] * 2 + [0])
    assert np.allclose(axis_angles(-turn, np.eye(3), np.array([1.0, 1.2, 2.0])), [np.degrees(0.7)] * 2 + [0])


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "glb", "off"])
def test_formats_and_scenes_of_several_parts(tmp_path: Path, suffix: str) -> None:
    scene = trimesh.Scene([box((1, 1, 1), (0, 0, 0)), box((1, 2, 1), (3, 0, 0))])
    body = scene if suffix == "glb" else scene.to_geometry()
    body.export(tmp_path / f"two.{suffix}")
    assert read_mesh(tmp_path / f"two.{suffix}").volume == pytest.approx(3.0)


def test_small_defects_are_repaired_with_a_warning(tmp_path: Path) -> None:
    cad = lump()
    cad.export(tmp_path / "ours.stl")
    hole = cad.copy()
    hole.update_faces(np.arange(len(hole.faces)) != 7)
    hole.export(tmp_path / "hole.stl")
    found = compare(tmp_path / "ours.stl", tmp_path / "hole.stl")
    assert any("hole" in w for w in found.warnings)
    assert abs(found.row("volume")["relative_error"]) < 1e-3


def test_what_is_no_closed_body_is_refused_in_one_line(tmp_path: Path) -> None:
    cad = lump()
    cad.export(tmp_path / "ours.stl")
    half = cad.copy()
    half.update_faces(half.triangles_center[:, 2] > 0)
    half.export(tmp_path / "half.stl")
    trimesh.PointCloud(cad.vertices).export(tmp_path / "points.ply")
    (tmp_path / "empty.stl").write_bytes(b"")
    (tmp_path / "text.obj").write_text("this is no mesh\n")
    (tmp_path / "odd.xyzzy").write_text("this is no mesh\n")
    for name in ("half.stl", "points.ply", "empty.stl", "text.obj", "odd.xyzzy", "absent.stl"):
        for first, second in (("ours.stl", name), (name, "ours.stl")):
            with pytest.raises(InputError) as refusal:
                compare(tmp_path / first, tmp_path / second)
            assert name in str(refusal.value) and "\n" not in str(refusal.value)
    with pytest.raises(InputError, match="no massprops.json"):
        compare(tmp_path, tmp_path / "ours.stl")


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from massprops_cli.compare import comparison_table
    from massprops_cli.main import run as massprops

    lump().export(tmp_path / "a.stl")
    assert (
        massprops(["compare", str(tmp_path / "a.stl"), str(tmp_path / "a.stl"), "-o", str(tmp_path / "o"), "--json"])
        == 0
    )
    document = json.loads(capsys.readouterr().out)
    assert document["format"] == "massprops-compare/1"
    table = comparison_table(document)
    assert "I_xy" in table and "kg m^2" in table and "Hausdorff" in table and "k2" in table
    assert massprops(["compare", str(tmp_path / "a.stl"), str(tmp_path / "b.stl")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "b.stl" in said
    (tmp_path / "file").write_text("")
    assert massprops(["compare", str(tmp_path / "a.stl"), str(tmp_path / "a.stl"), "-o", str(tmp_path / "file")]) == 2
    assert "-o" in capsys.readouterr().err


def test_an_ascii_stl_of_msvc_is_read_without_a_word(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    from massprops.exchange.mesh_files import read_solid

    text = trimesh.creation.box().export(file_type="stl_ascii").replace("facet normal ", "facet normal -1.#IND ")
    (tmp_path / "m.stl").write_text(text)
    solid, notes = read_solid(tmp_path / "m.stl")
    said = capfd.readouterr()
    assert solid.volume == pytest.approx(1.0) and notes == () and said.err == said.out == ""


def test_mesh_and_motion_together_are_scored_beside_the_mesh(tmp_path: Path) -> None:
    mesh, (R, t) = lump(), pose(4)
    run = run_folder(tmp_path / "run", moved(mesh, R, t))
    document = json.loads((run / "massprops.json").read_text())
    keys = ("volume", "mass", "center_of_mass", "inertia", "principal_moments", "principal_axes", "inertia_ratios")
    both = {key: document[key] for key in keys}
    for key in ("volume", "mass", "inertia", "principal_moments"):
        both[key] = (1.1 * np.array(both[key])).tolist()
    both["interval_90"] = {"volume": [0.9 * both["volume"], 1.2 * both["volume"]], "k1": [0.5, 0.6]}
    crosscheck = {"mesh": {"k1": document["inertia_ratios"]["k1"]}, "fused": both}
    (run / "crosscheck.json").write_text(json.dumps(crosscheck))
    mesh.export(tmp_path / "cad.stl")
    found = compare(run, tmp_path / "cad.stl")
    assert found.fused is not None
    rows = {row["quantity"]: row for row in found.fused}
    for name in ("volume", "I1", "I2", "I3", "I_xx", "I_yy"):
        assert rows[name]["relative_error"] == pytest.approx(0.1, abs=2e-3), name
    for name in ("center_of_mass_x", "I_xy", "axis_1", "k1"):
        assert rows[name]["ours"] == pytest.approx(found.row(name)["ours"] * (1.1 if name == "I_xy" else 1), abs=1e-4)
    assert rows["volume"]["holds"] is True and rows["k1"]["holds"] is False and rows["I1"]["holds"] is None
    crosscheck["mesh"]["k1"] -= 0.1  # type: ignore[operator]
    (run / "crosscheck.json").write_text(json.dumps(crosscheck))
    assert compare(run, tmp_path / "cad.stl").fused is None, "of an earlier mesh"
