"""Sunlight and thin air on the faces of a known mesh: as Basilisk has them, and from the run's own mesh."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from massprops.diagnosis.candidate import within_noise
from massprops.diagnosis.effect_search import best_fit
from massprops.diagnosis.measured_beside import effects_beside
from massprops.diagnosis.record import record_of_attitudes
from massprops.diagnosis.unnamed import without_effects
from massprops.dynamics.mesh_faces import faces_of, rows_of_mesh
from massprops.dynamics.sunlit_bodies import torque_of
from massprops.effect_contract import faults
from massprops.effects import effects, of_record
from massprops.errors import InputError
from massprops.geometry.vectors import sphere
from massprops.model import load_model
from massprops.sequence.data import Environment, Orbit, Sequence

BESIDE = np.array([0.08, -0.05, 0.03])
"""By which the mesh's centre of mass is off [m]."""


def ball(count: int) -> np.ndarray:
    """(t, 3, 3) triangles of an ellipsoid beside its centre of mass."""
    mesh = trimesh.creation.icosphere(subdivisions=count)
    return np.asarray(mesh.vertices * [1.0, 0.7, 0.5] + [0.1, 0.0, -0.05])[np.asarray(mesh.faces)]


def test_light_pushes_as_on_faces_one_by_one() -> None:
    corners, sun = ball(2), sphere(40)
    faces = faces_of({"faces": rows_of_mesh(corners)})
    absorbed, mirrored, scattered = faces.pushed(tuple(sun.T))[1]
    n, a, r = faces.normals, faces.areas, faces.centres
    for mirror, matt, ours in ((0.0, 0.0, absorbed), (1.0, 0.0, mirrored), (0.0, 1.0, scattered)):
        shares = [np.full(len(a), v) for v in (mirror, matt)]
        np.testing.assert_allclose(ours, torque_of(sun, n, a, r, *shares), atol=1e-12)


def test_triangles_that_look_the_same_way_are_one_face() -> None:
    fine, coarse = ball(4), ball(2)
    rows = rows_of_mesh(fine)
    assert len(fine) == 5120 and len(rows) <= 300
    sun = tuple(sphere(60).T)
    torques = [faces_of({"faces": rows_of_mesh(c)}).pushed(sun)[1] for c in (fine, coarse)]
    assert np.sqrt(np.mean((torques[0] - torques[1]) ** 2)) < 0.03 * np.sqrt(np.mean(torques[1] ** 2))


@pytest.mark.parametrize("kind", ["painted", "windward"])
def test_as_in_basilisk(kind: str) -> None:
    pytest.importorskip("Basilisk")
    from diagnosis import mesh_worlds

    sequence = mesh_worlds.recorded(getattr(mesh_worlds, kind), 1)
    corners = mesh_worlds.triangles(1) - BESIDE
    name = {"painted": "solar-pressure-on-mesh", "windward": "air-drag-on-mesh"}[kind]
    effect = of_record(effects()[name], {"faces": rows_of_mesh(corners), "orbit_normal": [0.0, 0.0, 1.0]})
    assert faults(effect) == ""
    record = record_of_attitudes(sequence.attitude, sequence.environment)
    base, unknown = without_effects(record)
    fit, general = (best_fit(record, e, base) for e in (effect, effects()["solar-pressure-on-facets"]))
    assert fit is not None and within_noise(fit) and not within_noise(base)
    assert general is not None and fit.evidence > max(general.evidence, unknown.evidence) + 5.0
    value, sigma = fit.values[name], np.sqrt(np.diag(fit.covariance[name]))
    if kind == "painted":
        absorbed = 1.0 - sum(mesh_worlds.SHARES)
        for k, share in enumerate(mesh_worlds.SHARES):
            spread = np.hypot(sigma[k + 1], sigma[0] * share / absorbed)
            assert abs(value[k + 1] - value[0] * share / absorbed) < 3.0 * spread
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2.0
    first = {"painted": slice(3, 6), "windward": slice(1, 4)}[kind]
    # the centre of mass lies at -BESIDE from where the mesh has it
    off = value[first] / value[0] - BESIDE / np.sqrt(areas.sum())
    assert (np.abs(off) < 3.5 * sigma[first] / value[0]).all()


def run_with_mesh(folder: Path, corners: np.ndarray) -> Sequence:
    """A sequence of a run that holds a mesh."""
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), process=True)
    (folder / "sequence").mkdir()
    mesh.export(folder / "mesh.ply")
    (folder / "massprops.json").write_text(json.dumps({"center_of_mass": [0.1, 0.0, -0.05]}))
    from diagnosis.test_measured_wheel import spun

    around = Environment(orbit=Orbit(3.986e14, 7e6, 0.0, 0.0), sun_direction=np.array([0.0, 0.6, 0.8]))
    return replace(spun(), rotor=None, environment=around, folder=folder / "sequence")


def test_a_run_brings_its_mesh(tmp_path: Path) -> None:
    sequence = run_with_mesh(tmp_path, ball(2))
    found = {m.NAME: m for m in effects_beside(sequence)}
    assert set(found) == {"solar-pressure-on-mesh", "air-drag-on-mesh"}
    assert found["air-drag-on-mesh"].GIVEN["orbit_normal"] == [0.0, 0.0, 1.0]
    # the mesh's own centre of mass is its middle
    areas = np.array(found["air-drag-on-mesh"].GIVEN["faces"])
    np.testing.assert_allclose(areas[:, 3] @ areas[:, 4:], 0.0, atol=1e-3)
    assert effects_beside(replace(sequence, environment=Environment())) == []
    assert effects_beside(replace(sequence, folder=tmp_path / "sequence" / "other")) == []


def test_a_model_without_its_mesh_is_refused(tmp_path: Path) -> None:
    parameters = ", ".join(f"{q.name}: 0" for q in effects()["air-drag-on-mesh"].PARAMETERS)
    text = f"format: massprops-model/1\neffects:\n- {{name: air-drag-on-mesh, parameters: {{{parameters}}}"
    path = tmp_path / "model.yaml"
    path.write_text(text + "}\n")
    with pytest.raises(InputError, match="needs given"):
        load_model(path)
    path.write_text(text + ", given: {faces: [[1, 0, 0, 1, 0, 0]], orbit_normal: [0, 0, 1]}}\n")
    with pytest.raises(InputError, match="seven numbers"):
        load_model(path)
    path.write_text(text + ", given: {faces: [[1, 0, 0, 1, 0, 0, 0]], orbit_normal: [0, 0, 1]}}\n")
    assert load_model(path).names == ("air-drag-on-mesh",)
