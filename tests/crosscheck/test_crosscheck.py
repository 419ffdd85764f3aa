"""Shape against motion on runs made by arithmetic: the same inertia, another one, a flat spin, a still object."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from estimators.made_sequence import AXES, TRUE_K, make_sequence, simple_method

from massprops.consistency.crosscheck import crosscheck
from massprops.consistency.free_rotation import free_rotation_residuals
from massprops.consistency.mesh_side import read_mesh_side
from massprops.consistency.motion_side import Centre, Tumble, centre_of_motion, tumble_of
from massprops.consistency.verdict import decide, hints_of
from massprops.dynamics.inertia import ratios
from massprops.dynamics.quaternion import from_rotation_matrix, from_rotation_vector, multiply, rotation_matrix
from massprops.dynamics.rigid_body import propagate
from massprops.errors import InputError
from massprops.estimators import methods as registry
from massprops.mass.document import document
from massprops.mass.properties import mass_properties
from massprops.mass.ratio_space import (
    FLIPS,
    chi_square,
    covariance,
    inertia_of,
    log_components,
    p_value,
    turn_between,
    turn_jacobian,
)


@pytest.fixture(autouse=True)
def simple(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "methods", lambda: {"simple": simple_method()})


def box_with_ratios(k: np.ndarray, axes: np.ndarray) -> trimesh.Trimesh:
    """The box whose inertia has these ratios and axes, centre at the origin."""
    a, b, c = np.diag(np.diag(np.exp([k[0] + k[1], k[1], 0.0])))
    sides = np.sqrt(6 * np.array([b + c - a, a + c - b, a + b - c]))
    mesh = trimesh.creation.box(extents=sides)
    mesh.apply_transform(
        np.block([[axes * [1, 1, np.linalg.det(axes)], np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])
    )
    return mesh


def make_run(folder: Path, k: np.ndarray, sigma: float = 0.01, axes: np.ndarray = AXES, **motion: object) -> Path:
    """A run folder whose mesh has ratios k, and whose footage moves with TRUE_K about AXES unless told otherwise."""
    make_sequence(folder / "sequence", stereo=False, attitude=True, **motion)  # type: ignore[arg-type]
    shutil.rmtree(folder / "sequence" / "truth")
    mesh = box_with_ratios(k, axes)
    mesh.export(folder / "mesh.ply")
    properties = mass_properties(mesh, 1000.0)
    half = 1.645 * sigma
    J = properties.inertia
    interval = {
        "k1": [properties.k1 - half, properties.k1 + half],
        "k2": [properties.k2 - half, properties.k2 + half],
        "inertia": [[[J[i, j] - half * J[2, 2] / 4, J[i, j] + half * J[2, 2] / 4] for j in range(3)] for i in range(3)],
    }
    surface = {"watertight": True, "area": float(mesh.area), "observed_fraction": 0.95}
    content = document(properties, interval, {"source": "none"}, surface, [])
    (folder / "massprops.json").write_text(json.dumps(content))
    return folder


def test_same_inertia_is_consistent_and_the_page_shows_it(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run", TRUE_K)
    found = crosscheck(run)
    content = json.loads((run / "crosscheck.json").read_text())
    assert found.verdict == content["verdict"] == "consistent" and content["p_value"] > 0.01
    one = content["estimators"][0]
    assert one["axis_misalignment_deg"] < 3 * one["sigma_axis_deg"] + 0.5 and one["tied_by"] == "attitude0"
    for key in ("name", "k1", "k2", "sigma_k1", "sigma_k2", "axis_misalignment_deg", "sigma_axis_deg", "converged",
                "observable", "nees", "cpu_us_per_step"):  # fmt: skip
        assert key in one
    page = (run / "report.html").read_text()
    assert "Shape against motion" in page and "Residuals over time" in page and "Principal axes on the mesh" in page


def test_another_inertia_is_inconsistent_with_a_hint(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run", TRUE_K + [0.12, -0.1])
    found = crosscheck(run)
    assert found.verdict == "inconsistent" and found.document["p_value"] < 1e-4
    assert "density" in " ".join(found.document["hints"])
    left = found.document["residuals"]
    assert left["mesh"]["rms"] > 3 * left["motion"]["rms"]


def test_a_mesh_whose_volume_is_open_contradicts_nothing(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run", TRUE_K + [0.12, -0.1])
    content = json.loads((run / "massprops.json").read_text())
    for times, verdict in ((2.9, "inconsistent"), (3.5, "unobservable")):
        content["interval_90"]["volume"] = [content["volume"], times * content["volume"]]
        (run / "massprops.json").write_text(json.dumps(content))
        judged = crosscheck(run, report=False)
        assert judged.verdict == verdict
    assert "leave open how large" in judged.document["reason"]


def test_turned_axes_are_inconsistent_though_the_ratios_agree(tmp_path: Path) -> None:
    turn = rotation_matrix(from_rotation_vector(np.radians(12) * np.array([0.6, 0.0, 0.8])))
    run = make_run(tmp_path / "run", TRUE_K, axes=turn @ AXES)
    found = crosscheck(run, report=False)
    one = found.document["estimators"][0]
    assert found.verdict == "inconsistent" and one["p_ratios"] > 0.01 and one["p_axes"] < 1e-3
    assert one["axis_misalignment_deg"] == pytest.approx(12, abs=2)


def test_estimators_never_see_the_body_that_the_mesh_wrote(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = make_run(tmp_path / "run", TRUE_K)
    (run / "sequence" / "body.yaml").write_text("inertia: [[1, 0, 0], [0, 2, 0], [0, 0, 2.5]]\ninertia_units: ratio\n")
    method, seen = simple_method(), []
    inner = method.estimate

    def spy(problem, prior, start):  # type: ignore[no-untyped-def]
        seen.append((problem.body, prior.inertia))
        return inner(problem, prior, start)

    method.estimate = spy  # type: ignore[attr-defined]
    monkeypatch.setattr(registry, "methods", lambda: {"simple": method})
    crosscheck(run, report=False)
    assert seen == [(None, None)]


def test_flat_spin_is_unobservable_whatever_an_estimator_says(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run", TRUE_K, spin=(0.0, 0.0, 0.9))
    found = crosscheck(run, report=False)
    assert found.verdict == "unobservable" and "flat spin" in found.document["reason"]
    assert found.document["p_value"] is None


def test_still_object_is_unobservable_and_exit_0(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run", TRUE_K)
    shutil.rmtree(run / "sequence" / "attitude0")
    done = subprocess.run(
        [sys.executable, "-m", "massprops_cli.main", "crosscheck", str(run), "--json", "-q"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    content = json.loads(done.stdout)
    assert content["verdict"] == "unobservable" and "still" in content["reason"]


def test_no_mass_properties_is_one_line_and_exit_2(tmp_path: Path) -> None:
    make_sequence(tmp_path / "run" / "sequence", stereo=False, attitude=True)
    with pytest.raises(InputError, match=r"massprops\.json"):
        crosscheck(tmp_path / "run")
    with pytest.raises(InputError, match="no such folder; give a run"):
        crosscheck(tmp_path / "absent")


def test_own_frame_of_a_stereo_sequence_is_tied_by_the_attitudes(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run", TRUE_K)
    stereo = make_sequence(tmp_path / "seq", stereo=True)
    found = crosscheck(run, sequence=stereo, report=False)
    one = found.document["estimators"][0]
    assert one["tied_by"] == "attitude" and one["axis_misalignment_deg"] < 3
    assert found.verdict == "consistent"


def test_turns_between_principal_frames_know_their_symmetries() -> None:
    rng = np.random.default_rng(1)
    turn = rotation_matrix(from_rotation_vector(np.array([0.02, -0.05, 0.03])))
    for flip in FLIPS:
        a, b = AXES @ turn @ flip, AXES @ FLIPS[rng.integers(4)]
        assert np.linalg.norm(turn_between(a, b)) == pytest.approx(np.linalg.norm([0.02, -0.05, 0.03]), abs=1e-9)
    left = AXES * [1, 1, -1]
    assert np.linalg.norm(turn_between(left, AXES)) < 1e-9


def test_covariance_of_the_five_numbers_by_sampling() -> None:
    rng = np.random.default_rng(2)
    k, axes = np.array([-0.3, -0.2]), AXES
    k_cov, turn_cov = np.diag([2e-3, 1e-3]) ** 2, np.diag([1e-3, 3e-3, 2e-3]) ** 2
    basis = AXES @ rotation_matrix(from_rotation_vector(np.array([0.1, 0.2, -0.1])))
    draws = []
    for _ in range(4000):
        R = rotation_matrix(from_rotation_vector(rng.multivariate_normal(np.zeros(3), turn_cov)))
        inertia = inertia_of(rng.multivariate_normal(k, k_cov), axes)
        draws.append(log_components(R @ inertia @ R.T, basis))
    found = covariance(inertia_of(k, axes), k_cov, turn_cov, basis)
    assert np.allclose(found, np.cov(np.array(draws).T), atol=0.08 * np.abs(found).max())


def test_chi_square_is_uniform_in_p_when_both_sides_are_honest() -> None:
    """Mesh and motion each drawn with their stated covariance, the body nearly symmetric: p-values stay uniform."""
    rng = np.random.default_rng(3)
    k, axes = np.array([-0.004, -0.4]), AXES
    own = inertia_of(k, axes)
    turn_cov = np.diag([4e-3, 4e-3, 0.3]) ** 2
    J = turn_jacobian(own, axes)
    both = 2 * (covariance(own, np.eye(2) * 0.01**2, None, axes) + J @ turn_cov @ J.T)
    p = []
    for _ in range(600):
        sides = [
            log_components(own, axes) + np.linalg.cholesky(0.5 * both + 1e-18 * np.eye(5)) @ rng.standard_normal(5)
            for _ in range(2)
        ]
        p.append(p_value(*chi_square(sides[0] - sides[1], both)))
    assert abs(np.mean(p) - 0.5) < 0.05 and 0.002 < np.mean(np.array(p) < 0.01) + 0.002 < 0.03


def test_centre_of_motion_and_its_sigma() -> None:
    rng = np.random.default_rng(4)
    inertia = inertia_of(TRUE_K, AXES)
    times = 0.1 * np.arange(80)
    q, _ = propagate(np.array([1.0, 0, 0, 0]), AXES @ [0.3, 0.9, 0.25], inertia, times)
    R, c = rotation_matrix(q), np.array([0.3, -0.2, 0.1])
    stamps = np.round(times * 1e9).astype(np.int64)
    error = []
    for _ in range(60):
        t = np.array([0.1, 0, 8.0]) + times[:, None] * [0.01, 0, -0.02] - R @ c
        t = t + rng.standard_normal((80, 3)) * [0.002, 0.002, 0.02]
        found = centre_of_motion(stamps, R, t)
        assert found is not None
        error.append(np.linalg.solve(np.linalg.cholesky(found.covariance), found.place - c))
    assert 0.5 < np.mean(np.square(error)) < 1.5


def test_free_rotation_explains_its_own_motion_to_the_noise() -> None:
    rng = np.random.default_rng(5)
    inertia = inertia_of(TRUE_K, AXES)
    times = 0.1 * np.arange(150)
    q, _ = propagate(np.array([1.0, 0, 0, 0]), AXES @ [0.3, 0.9, 0.25], inertia, times)
    sigma = np.full(150, 1e-3)
    noisy = multiply(q, from_rotation_vector(1e-3 * rng.standard_normal((150, 3))))
    good = free_rotation_residuals(times, noisy, sigma, inertia)
    assert np.sqrt(np.mean((good / 1e-3) ** 2)) == pytest.approx(1.0, abs=0.1)
    bad = free_rotation_residuals(times, noisy, sigma, inertia_of(TRUE_K + 0.1, AXES))
    assert np.sqrt(np.mean((bad / 1e-3) ** 2)) > 5


def test_tumble_and_flat_spin_are_told_apart() -> None:
    rng = np.random.default_rng(6)
    times, sigma = 0.1 * np.arange(100), np.full(100, 2e-3)
    stamps = np.round(times * 1e9).astype(np.int64)
    inertia = inertia_of(TRUE_K, AXES)
    for spin, wanders in (([0.3, 0.9, 0.25], True), ([0.0, 0.0, 0.9], False)):
        q, _ = propagate(from_rotation_matrix(AXES), AXES @ np.array(spin), inertia, times)
        noisy = multiply(q, from_rotation_vector(2e-3 * rng.standard_normal((100, 3))))
        found = tumble_of(stamps, noisy, sigma)
        assert found is not None and (found.wander > 10 * found.noise) == wanders
        assert wanders or found.wander < 3 * found.noise
    assert np.allclose(ratios(inertia)[0], TRUE_K)


@pytest.mark.parametrize(
    ("off", "tumble", "said"),
    [
        (0.1, Tumble(10.0, 0.3, 0.001), "inconsistent"),
        (0.0, Tumble(10.0, 0.3, 0.001), "unobservable"),
        (0.1, Tumble(10.0, 0.001, 0.001), "unobservable"),
        (0.1, None, "unobservable"),
    ],
)
def test_centre_of_mass_contradicts_without_the_ratios_but_confirms_nothing(tmp_path, off, tumble, said) -> None:
    mesh = read_mesh_side(make_run(tmp_path / "run", TRUE_K))
    centre = Centre(mesh.centre + [off, 0.0, 0.0], 1e-4 * np.eye(3))
    found = decide([], mesh, centre, tumble, {})
    assert found.verdict == said
    if said == "inconsistent":
        assert found.p_value is not None and found.p_value < 1e-3
        assert found.hints[0].startswith("density") and "0.1 " in found.hints[0]
        assert "no estimator" in found.reason
        # where what was filled in reaches as far, the shape may be the cause as well
        filled = replace(mesh, fill=np.array([[0.06, 0.0, 0.0], [-0.06, 0.0, 0.0]]), unseen=0.46)
        doubtful = decide([], filled, centre, tumble, {})
        assert doubtful.verdict == "unobservable" and "46 % of the surface was filled in" in doubtful.reason
        assert decide([], replace(filled, fill=0.5 * filled.fill), centre, tumble, {}).verdict == said
        first, second = hints_of(None, filled, centre, {"centre of mass": 1e-4}, {})
        assert first.startswith("an unseen side: 46 %") and second.startswith("density")
