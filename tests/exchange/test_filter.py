"""`export --to filter`: what is written is what `estimate --prior` reads, in the run's body frame."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from estimators.made_sequence import make_sequence

from massprops.dynamics.inertia import ratios
from massprops.estimators.prior import read_filter
from massprops.exchange.body import read_body
from massprops.exchange.export import export
from massprops.exchange.formats.filter import turn_covariance
from massprops.mass.document import document
from massprops.mass.properties import mass_properties


def lump() -> trimesh.Trimesh:
    mesh = trimesh.creation.icosphere(subdivisions=3)
    v = np.array(mesh.vertices) @ np.array([[1.0, 0.3, -0.2], [0.0, 0.7, 0.25], [0.1, 0.0, 0.5]]) + [0.4, -0.3, 0.2]
    return trimesh.Trimesh(v, mesh.faces, process=False)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run with its sequence and, in 0.25 m to a unit of structure from motion, its points."""
    folder = tmp_path / "run"
    make_sequence(folder / "sequence", stereo=False, attitude=True)
    mesh = lump()
    mesh.export(folder / "mesh.ply")
    found = mass_properties(mesh, 1000.0)
    J = found.inertia
    interval = {
        "k1": [found.k1 - 0.02, found.k1 + 0.04],
        "k2": [found.k2 - 0.03, found.k2 + 0.03],
        "inertia": [[[J[i, j] - 0.02 * J[2, 2], J[i, j] + 0.02 * J[2, 2]] for j in range(3)] for i in range(3)],
    }
    scale = {"source": "given", "metres_per_unit": 2.0, "relative_sigma": 0.0}
    content = document(found, interval, scale, {"observed_fraction": 1.0}, [])
    (folder / "massprops.json").write_text(json.dumps(content))
    points = np.random.default_rng(0).uniform(-1, 1, (14, 3))
    (folder / "work" / "sfm").mkdir(parents=True)
    (folder / "work" / "scale").mkdir()
    (folder / "work" / "scale" / "scale.json").write_text('{"metres_per_unit": 2.0, "unit_per_sfm": 0.125}')
    np.savez(folder / "work" / "sfm" / "points.npz", id=np.arange(100, 114), xyz=points / 0.25)
    return folder


def test_reads_back_what_the_mesh_says(run: Path, tmp_path: Path) -> None:
    path = export(run, "filter", tmp_path / "prior.yaml")
    found, body = read_filter(path), read_body(run)
    k = body.document["inertia_ratios"]
    assert np.allclose(found.prior.inertia, body.inertia / np.trace(body.inertia), rtol=1e-12)
    assert np.allclose(ratios(found.prior.inertia)[0], [k["k1"], k["k2"]], atol=1e-9)
    assert found.prior.k_sigma == pytest.approx([np.sqrt((0.02**2 + 0.04**2) / 2) / 1.645, 0.03 / 1.645], rel=1e-3)
    assert found.prior.axes_sigma is not None and (found.prior.axes_sigma > 1e-3).all()
    # features 112 and 113 are in no track; the rest are from the centre of mass, in metres
    assert found.metric and found.prior.feature_ids.tolist() == list(range(100, 112))
    points = np.random.default_rng(0).uniform(-1, 1, (14, 3))[:12]
    assert np.allclose(found.prior.features, points - body.center_of_mass, atol=1e-8)
    assert found.prior.process_noise is not None and 0 < found.prior.process_noise < 1e-2
    assert found.mark_ns is not None and len(found.mark_ns) == 3


def test_axes_sigma_matches_sampling_of_the_stated_intervals(run: Path, tmp_path: Path) -> None:
    body, rng = read_body(run), np.random.default_rng(1)
    found = read_filter(export(run, "filter", tmp_path / "prior.yaml"))
    sigma = 0.02 * body.inertia[2, 2] / 1.645
    turns = []
    axes = np.array(body.document["principal_axes"])
    for _ in range(3000):
        step = np.triu(rng.standard_normal((3, 3))) * sigma
        step = step + np.triu(step, 1).T
        moved = np.linalg.eigh(body.inertia + step)[1]
        moved = moved * np.sign(np.sum(moved * axes, axis=0))
        R = axes.T @ moved
        turns.append(0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]))
    assert found.prior.axes_sigma == pytest.approx(np.std(turns, axis=0), rel=0.15)


def test_a_bare_mesh_says_that_its_sigma_is_assumed(tmp_path: Path) -> None:
    lump().export(tmp_path / "lump.stl")
    path = export(tmp_path / "lump.stl", "filter", tmp_path / "prior.yaml")
    content = yaml.safe_load(path.read_text())
    assert "assumed" in content["source"] and content["features"] is None
    found = read_filter(path)
    assert found.prior.k_sigma == pytest.approx([0.05, 0.05]) and found.prior.features is None


def test_axes_that_the_body_hardly_shows_are_at_most_half_a_turn() -> None:
    found = turn_covariance(np.eye(3) * 0.01**2, -1e-6, -0.3)
    assert np.sqrt(found[2, 2]) == pytest.approx(np.pi / 2, rel=1e-3) and np.sqrt(found[0, 0]) < 0.04
    assert np.linalg.eigvalsh(found)[0] > 0


def test_what_mesh_and_motion_know_together_goes_before_the_mesh(run: Path, tmp_path: Path) -> None:
    content = json.loads((run / "massprops.json").read_text())
    k = {name: value + 0.01 for name, value in content["inertia_ratios"].items()}
    moments = np.exp([k["k1"] + k["k2"], k["k2"], 0.0])
    axes = np.array(content["principal_axes"])
    J = axes @ np.diag(moments) @ axes.T
    interval = {
        "k1": [k["k1"] - 0.001, k["k1"] + 0.001],
        "k2": [k["k2"] - 0.002, k["k2"] + 0.002],
        "inertia": [[[J[i, j] - 1e-3, J[i, j] + 1e-3] for j in range(3)] for i in range(3)],
    }
    fused = {
        "source": "fused", "volume": 1.0, "mass": 1000.0, "inertia": J.tolist(), "principal_moments": sorted(moments),
        "principal_axes": axes.tolist(), "center_of_mass": [0.1, 0.2, 0.3], "interval_90": interval, "because": "", **k,
    }  # fmt: skip
    (run / "massprops.json").write_text(json.dumps({**content, "recommended": fused}))
    prior = read_filter(export(run, "filter", tmp_path / "both.yaml")).prior
    assert np.allclose(ratios(prior.inertia)[0], [k["k1"], k["k2"]], atol=1e-9)
    assert prior.k_sigma == pytest.approx([0.001 / 1.645, 0.002 / 1.645], rel=1e-3)
    for other in (content, {key: value for key, value in content.items() if key != "recommended"}):
        (run / "massprops.json").write_text(json.dumps(other))
        prior = read_filter(export(run, "filter", tmp_path / "mesh.yaml")).prior
        assert np.allclose(ratios(prior.inertia)[0], list(content["inertia_ratios"].values()), atol=1e-9)
