"""Formats that carry a run's cameras, and USD, each read back by its real consumer."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent.parent / "report"))

from fake_run import add_everything, make_run

from massprops.errors import InputError
from massprops.exchange.body import read_body
from massprops.exchange.export import export
from massprops.views import Views

FACTOR = 2.5


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose model unit is 2.5 m; its density was assumed."""
    folder = add_everything(make_run(tmp_path_factory.mktemp("cameras") / "probe", count=10))
    scale = {"source": "given", "metres_per_unit": FACTOR, "unit_per_sfm": 1.0, "relative_sigma": 0.0}
    (folder / "work" / "scale" / "scale.json").write_text(json.dumps(scale))
    return folder


def views_of(run: Path) -> Views:
    return Views.load(run / "work" / "sfm" / "views.npz")


def test_tum_in_evo(run: Path, tmp_path: Path) -> None:
    evo = pytest.importorskip("evo.tools.file_interface", reason="test extra 'consumers' is not installed")
    path, views = export(run, "tum", tmp_path / "a.tum"), views_of(run)
    found = evo.read_tum_trajectory_file(str(path))
    assert np.allclose(found.timestamps, views.timestamp_ns * 1e-9)
    assert np.allclose(found.positions_xyz, FACTOR * views.centres)
    assert np.allclose([pose[:3, :3] for pose in found.poses_se3], np.swapaxes(views.R, 1, 2), atol=1e-9)
    assert "assumed density" in path.read_text()


def test_colmap_text_in_pycolmap(run: Path, tmp_path: Path) -> None:
    pytest.importorskip("pycolmap")
    folder, views = export(run, "colmap-text", tmp_path / "model"), views_of(run)
    code = (
        "import zlib, json, sys, pycolmap; r = pycolmap.Reconstruction(sys.argv[1]); r.update_point_3d_errors(); "
        "print(json.dumps([r.compute_mean_reprojection_error(), r.num_reg_images(), r.num_points3D(), "
        "{i.name: i.projection_center().tolist() for i in r.images.values()}]))"
    )
    done = subprocess.run([sys.executable, "-c", code, str(folder)], capture_output=True, text=True, check=True)
    error, images, points, centres = json.loads(done.stdout.splitlines()[-1])
    # observations are 0.3 px off in each coordinate
    assert (images, points) == (10, 80) and error == pytest.approx(0.3 * np.sqrt(np.pi / 2), rel=0.1)
    assert np.allclose([centres[name] for name in views.names], FACTOR * views.centres)
    assert export(run, "colmap-text", folder) == folder, "the same again"


def test_nerfstudio_cameras_see_the_points_where_they_were(run: Path, tmp_path: Path) -> None:
    found = json.loads(export(run, "nerfstudio", tmp_path / "transforms.json").read_text())
    views = views_of(run)
    assert "assumed density" in found["comment"] and len(found["frames"]) == 10
    for i, frame in enumerate(found["frames"]):
        assert Path(frame["file_path"]).is_file() and Path(frame["mask_path"]).is_file()
        to_camera = np.linalg.inv(np.array(frame["transform_matrix"]))
        x, y, z = (to_camera @ [0.3, -0.2, 0.4, 1.0])[:3]
        ours = views.K[i] @ (views.R[i] @ np.array([0.3, -0.2, 0.4]) / FACTOR + views.t[i])
        # OpenGL's camera looks along -z with y up
        assert frame["fl_x"] * x / -z + frame["cx"] - 0.5 == pytest.approx(ours[0] / ours[2])
        assert frame["fl_y"] * -y / -z + frame["cy"] - 0.5 == pytest.approx(ours[1] / ours[2])


def test_a_fisheye_keeps_its_lens(run: Path, tmp_path: Path) -> None:
    """COLMAP's FULL_OPENCV has the same eight numbers; Nerfstudio has no such model."""
    views = views_of(run)
    lens = np.array([-0.1, 0.02, 0.0, 0.0, 0.001, 0.3, 0.01, 0.0])
    replace(views, distortion=np.tile(lens, (len(views), 1))).save(run / "work" / "sfm" / "views.npz")
    try:
        folder = export(run, "colmap-text", tmp_path / "model")
        camera = (folder / "cameras.txt").read_text().splitlines()[-1].split()
        assert camera[1] == "FULL_OPENCV" and np.allclose([float(v) for v in camera[-8:]], lens)
        with pytest.raises(InputError, match="fisheye"):
            export(run, "nerfstudio", tmp_path / "transforms.json")
    finally:
        views.save(run / "work" / "sfm" / "views.npz")


def test_nerfstudio_in_a_reader_of_its_data_sets(run: Path, tmp_path: Path) -> None:
    """NerfBaselines reads the same data sets as Nerfstudio, whose own parser needs torch (5.8 GB installed).

    So that one is not installed for the tests. It was given this export once by hand (Nerfstudio 1.1.5, poses neither
    turned, centred nor scaled): ten images and masks found, the point within 1e-5 px, and the ray that its camera sends
    through that pixel within 3e-6 m of the point, 23 m away.
    """
    reader = pytest.importorskip("nerfbaselines.datasets.nerfstudio", reason="pip install --no-deps nerfbaselines")
    export(run, "nerfstudio", tmp_path / "transforms.json")
    views, point, seen = views_of(run), np.array([0.3, -0.2, 0.4]), {}
    for split in ("train", "test"):
        found = reader.load_nerfstudio_dataset(str(tmp_path), split, features=frozenset())
        cameras = found["cameras"]
        for path, pose, (fx, fy, cx, cy) in zip(found["image_paths"], cameras.poses, cameras.intrinsics, strict=True):
            x, y, z = pose[:, :3].T @ (point - pose[:, 3])  # camera axes as OpenCV's
            seen["/".join(Path(path).parts[-2:])] = (fx * x / z + cx - 0.5, fy * y / z + cy - 0.5)
        assert all(Path(p).is_file() for p in found["mask_paths"])
    assert len(seen) == 10
    for i, name in enumerate(views.names):
        ours = views.K[i] @ (views.R[i] @ point / FACTOR + views.t[i])
        assert seen[name] == pytest.approx(ours[:2] / ours[2], abs=1e-2), name


def test_usd_in_openusd(run: Path, tmp_path: Path) -> None:
    pytest.importorskip("pxr", reason="test extra 'consumers' is not installed")
    from pxr import Gf, Usd, UsdGeom, UsdPhysics

    body = read_body(run, recommended=True)
    stage = Usd.Stage.Open(str(export(run, "usd", tmp_path / "a.usda")))
    prim = stage.GetDefaultPrim()
    api = UsdPhysics.MassAPI(prim)
    assert prim.HasAPI(UsdPhysics.RigidBodyAPI) and UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert api.GetMassAttr().Get() == pytest.approx(body.mass)
    assert np.allclose(api.GetCenterOfMassAttr().Get(), body.center_of_mass, atol=1e-6)
    turn = np.array(Gf.Matrix3d(Gf.Quatd(api.GetPrincipalAxesAttr().Get()))).T  # rows are images of the axes there
    inertia = turn @ np.diag(api.GetDiagonalInertiaAttr().Get()) @ turn.T
    assert np.allclose(inertia, body.inertia, atol=1e-5 * np.trace(body.inertia))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(prim.GetPath().AppendChild("surface")))
    assert len(mesh.GetPointsAttr().Get()) == len(body.mesh.vertices)
    assert "assumed density" in stage.GetRootLayer().documentation


def test_rerun_reads_its_recording(run: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="test extra 'consumers' is not installed")
    path = export(run, "rerun", tmp_path / "a.rrd")
    command = [sys.executable, "-m", "rerun", "rrd", "print", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    for entity in ("/body/mesh", "/body/principal_axes", "/camera/image", "/points"):
        assert entity in done.stdout
    check = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(path)], capture_output=True, text=True, timeout=120
    )
    assert check.returncode == 0, check.stderr


def test_a_mesh_alone_has_no_cameras(run: Path, tmp_path: Path) -> None:
    for name in ("tum", "nerfstudio", "colmap-text"):
        with pytest.raises(InputError, match="needs the cameras of a run"):
            export(run / "mesh.ply", name, tmp_path / "x")
