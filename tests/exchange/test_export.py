"""Every export format, read back by the program it is meant for."""

from __future__ import annotations

import csv
import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from massprops.errors import InputError
from massprops.exchange.body import read_body
from massprops.exchange.collision import collision_mesh
from massprops.exchange.export import export
from massprops.exchange.formats import formats

OF_CAMERAS = [name for name, style in formats().items() if hasattr(style, "read_cameras") and name != "rerun"]
"""Formats of nothing but cameras."""
"""Formats of a run's cameras; `test_camera_formats.py` has one."""


def lump(subdivisions: int = 3) -> trimesh.Trimesh:
    """A closed body without symmetry, off the origin, with all three products of inertia."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    v = np.array(mesh.vertices)
    v[:, 0] *= 1 + 0.3 * v[:, 1] + 0.2 * np.sin(2 * v[:, 2])
    v = v @ np.array([[1.0, 0.3, -0.2], [0.0, 0.7, 0.25], [0.1, 0.0, 0.5]]) + [0.4, -0.3, 0.2]
    return trimesh.Trimesh(v, mesh.faces, process=False)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    folder = tmp_path / "my run"
    folder.mkdir()
    lump().export(folder / "mesh.ply")
    lump().export(tmp_path / "lump.stl")
    (folder / "massprops.json").write_text(json.dumps(read_body(tmp_path / "lump.stl", density=40.0).document))
    return folder


def test_every_format_writes_and_is_listed_by_name(run: Path, tmp_path: Path) -> None:
    for name, style in formats().items():
        if name in OF_CAMERAS:
            with pytest.raises(InputError, match="cameras"):
                export(run, name, tmp_path / f"out{style.SUFFIX}")
            continue
        if name == "rerun" and importlib.util.find_spec("rerun") is None:
            continue
        path = export(run, name, tmp_path / f"out{style.SUFFIX}")
        assert path.stat().st_size > 100
        assert not list(tmp_path.glob(".*.tmp"))
    with pytest.raises(InputError, match="urdf"):
        export(run, "dwg")


def test_urdf_in_yourdfpy(run: Path, tmp_path: Path) -> None:
    yourdfpy = pytest.importorskip("yourdfpy", reason="test extra 'consumers' is not installed")
    body = read_body(run)
    robot = yourdfpy.URDF.load(str(export(run, "urdf", tmp_path / "b.urdf")), load_meshes=True)
    inertial = robot.robot.links[0].inertial
    assert inertial.mass == pytest.approx(body.mass, rel=1e-12)
    assert np.allclose(inertial.origin[:3, 3], body.center_of_mass)
    assert np.allclose(inertial.inertia, body.inertia, rtol=1e-12)


def world_inertia(model, data, index: int) -> np.ndarray:  # type: ignore[no-untyped-def]
    axes = data.ximat[index].reshape(3, 3)
    return axes @ np.diag(model.body_inertia[index]) @ axes.T


@pytest.mark.parametrize("name", ["urdf", "mjcf"])
def test_in_mujoco(run: Path, tmp_path: Path, name: str) -> None:
    mujoco = pytest.importorskip("mujoco", reason="test extra 'consumers' is not installed")
    body = read_body(run)
    path = export(run, name, tmp_path / f"b{formats()[name].SUFFIX}")
    if name == "urdf":  # MuJoCo welds a URDF's root link to the world, and keeps its inertia only on a moving body
        text = path.read_text().replace(
            "</robot>",
            '<link name="w"/><joint name="j" type="floating"><parent link="w"/><child link="my_run"/></joint></robot>',
        )
        path.write_text(text)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    assert model.body_mass[1] == pytest.approx(body.mass, rel=1e-9)
    assert np.allclose(model.body_ipos[1], body.center_of_mass, rtol=1e-6)
    assert np.allclose(world_inertia(model, data, 1), body.inertia, rtol=1e-6, atol=1e-8 * np.trace(body.inertia))
    assert model.nmesh >= 1


def test_in_basilisk(run: Path, tmp_path: Path) -> None:
    """The hub propagated 100 s without torque: momentum kept, and the same motion as ours."""
    pytest.importorskip("Basilisk", reason="test extra 'consumers' is not installed")
    from Basilisk.simulation import spacecraft, svIntegrators
    from Basilisk.utilities import RigidBodyKinematics as rbk
    from Basilisk.utilities import SimulationBaseClass, macros

    from massprops.dynamics.rigid_body import propagate

    body = read_body(run)
    file = export(run, "basilisk", tmp_path / "hub.py")
    spec = importlib.util.spec_from_file_location("hub", file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)

    sim = SimulationBaseClass.SimBaseClass()
    sim.CreateNewProcess("p").addTask(sim.CreateNewTask("t", macros.sec2nano(0.05)))
    craft = spacecraft.Spacecraft()
    integrator = svIntegrators.svIntegratorRK4(craft)
    craft.setIntegrator(integrator)
    module.apply(craft.hub)
    rates = [0.05, -0.03, 0.08]
    craft.hub.omega_BN_BInit = [[w] for w in rates]
    sim.AddModelToTask("t", craft)
    log = craft.scStateOutMsg.recorder(macros.sec2nano(1.0))
    sim.AddModelToTask("t", log)
    sim.InitializeSimulation()
    sim.ConfigureStopTime(macros.sec2nano(100.0))
    sim.ExecuteSimulation()

    times = np.arange(101.0)
    q, w = propagate(np.array([1.0, 0, 0, 0]), np.array(rates), body.inertia, times)
    assert np.allclose(log.omega_BN_B[:101], w, atol=1e-6 * np.linalg.norm(rates))
    momentum = [rbk.MRP2C(s).T @ body.inertia @ v for s, v in zip(log.sigma_BN, log.omega_BN_B, strict=True)]
    assert np.allclose(momentum, momentum[0], atol=1e-6 * np.linalg.norm(momentum[0]))
    last = rbk.MRP2C(log.sigma_BN[100]).T  # body to inertial
    from massprops.dynamics.quaternion import rotation_matrix

    assert np.allclose(last, rotation_matrix(q[100]), atol=1e-6)


@pytest.mark.parametrize("name", ["sdf", "urdf"])
def test_in_drake(run: Path, tmp_path: Path, name: str) -> None:
    pytest.importorskip("pydrake", reason="test extra 'consumers' is not installed")
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    body, plant = read_body(run), MultibodyPlant(0.0)
    (model,) = Parser(plant).AddModels(str(export(run, name, tmp_path / f"b.{name}")))
    plant.Finalize()
    (index,) = plant.GetBodyIndices(model)
    found = plant.get_body(index).default_spatial_inertia()
    about_centre = found.Shift(found.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    assert found.get_mass() == pytest.approx(body.mass) and np.allclose(found.get_com(), body.center_of_mass)
    assert np.allclose(about_centre, body.inertia, rtol=1e-12, atol=1e-12 * np.trace(body.inertia))


def test_sdf_json_and_csv_read_back(run: Path, tmp_path: Path) -> None:
    from xml.etree import ElementTree

    body = read_body(run)
    link = ElementTree.parse(export(run, "sdf", tmp_path / "b.sdf")).getroot().find("model/link/inertial")
    assert link is not None
    assert float(link.findtext("mass", "")) == pytest.approx(body.mass)
    assert [float(v) for v in link.findtext("pose", "").split()] == pytest.approx([*body.center_of_mass, 0, 0, 0])
    assert float(link.findtext("inertia/ixz", "")) == pytest.approx(body.inertia[0, 2])
    document = json.loads(export(run, "json", tmp_path / "b.json").read_text())
    assert np.allclose(document["inertia"], body.inertia)
    with export(run, "csv", tmp_path / "b.csv").open() as file:
        rows = {row["quantity"]: row for row in csv.DictReader(file)}
    assert float(rows["I_yz"]["value"]) == pytest.approx(body.inertia[1, 2])
    assert rows["mass"]["unit"] == "kg"


def test_a_given_mass_scales_the_inertia(run: Path, tmp_path: Path) -> None:
    plain, heavy = read_body(run), read_body(run, mass=7.0)
    assert heavy.mass == 7.0
    assert np.allclose(heavy.inertia / 7.0, plain.inertia / plain.mass)


def test_collision_mesh_is_light_closed_and_has_the_same_inertia() -> None:
    full = lump(5)
    light = collision_mesh(full)
    assert light.is_volume and len(light.faces) < 5000 < len(full.faces)
    assert light.volume == pytest.approx(full.volume, rel=1e-9)
    assert np.allclose(light.moment_inertia, full.moment_inertia, atol=0.01 * np.trace(full.moment_inertia) / 3)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"mass": 0.0}, "mass must be above 0, not 0.0"),
        ({"mass": -2.0}, "mass must be above 0, not -2.0"),
        ({"inertia": [[1, 0, 0], [0, 1, 0], [0, 0, 5]]}, "triangle inequality"),
        ({"inertia": [[1, 2, 0], [0, 1, 0], [0, 0, 1]]}, "symmetric"),
        ({"units": {"length": "model", "mass": "model"}}, "needs metres"),
        ({"center_of_mass": None}, "center_of_mass must be 3 finite numbers"),
    ],
)
def test_impossible_bodies_are_refused_and_nothing_is_written(
    run: Path, tmp_path: Path, change: dict, says: str
) -> None:
    document = json.loads((run / "massprops.json").read_text())
    (run / "massprops.json").write_text(json.dumps({**document, **change}))
    with pytest.raises(InputError, match=says):
        export(run, "urdf", tmp_path / "new" / "b.urdf")
    assert not (tmp_path / "new").exists()


def test_a_run_without_a_mesh_and_broken_meshes(run: Path, tmp_path: Path) -> None:
    (run / "mesh.ply").unlink()
    with pytest.raises(InputError, match=r"no mesh\.ply"):
        export(run, "urdf")
    with pytest.raises(InputError, match="no such"):
        export(tmp_path / "nothing", "urdf")
    half = lump()
    half.update_faces(np.arange(len(half.faces)) % 2 == 0)
    half.export(tmp_path / "half.stl")
    with pytest.raises(InputError):
        export(tmp_path / "half.stl", "urdf")
    inside_out = lump()
    inside_out.invert()
    inside_out.export(tmp_path / "inside_out.stl")
    assert read_body(tmp_path / "inside_out.stl").mass > 0
    (tmp_path / "text.stl").write_text("not a mesh")
    with pytest.raises(InputError):
        export(tmp_path / "text.stl", "urdf")
    with pytest.raises(InputError, match="--mass"):
        export(tmp_path / "inside_out.stl", "urdf", mass=-1.0)


@pytest.mark.parametrize("form", ["urdf", "mjcf", "sdf"])
@pytest.mark.parametrize("name", ["R&D", 'a"b<c>', "a\x01b", "-- x"])
def test_any_file_name_gives_well_formed_xml(tmp_path: Path, form: str, name: str) -> None:
    import xml.etree.ElementTree as ElementTree

    trimesh.creation.box().export(tmp_path / "box.stl")
    (tmp_path / "box.stl").rename(tmp_path / f"{name}.stl")
    path = export(tmp_path / f"{name}.stl", form, tmp_path / f"{name}.{form}")
    tree = ElementTree.fromstring(path.read_text())
    named = [e.get("filename") or e.get("file") or e.text for e in tree.iter() if e.tag in ("mesh", "uri")]
    named = [n for n in named if n and n.strip()]
    assert named and all((tmp_path / n).is_file() for n in named)


def test_every_format_says_that_the_density_was_assumed(run: Path, tmp_path: Path) -> None:
    document = read_body(tmp_path / "lump.stl").document
    assert document["density_assumed"] is True and document["density"] == 1000.0
    (run / "massprops.json").write_text(json.dumps(document))
    for name, style in formats().items():
        if name in (*OF_CAMERAS, "rerun"):
            continue
        given = export(run, name, tmp_path / f"given{style.SUFFIX}", mass=3.0).read_bytes()
        assumed = export(run, name, tmp_path / f"assumed{style.SUFFIX}").read_bytes()
        assert b"assumed density" not in given
        assert (b"assumed density 1000 kg/m^3" in assumed) == (name != "filter"), f"{name}: a filter takes ratios alone"
