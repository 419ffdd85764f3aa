"""Rendered footage against its own truth."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from massprops.dynamics.quaternion import rotation_matrix
from massprops.errors import InputError
from massprops.sequence import read_sequence
from massprops.sequence.truth import read_truth
from massprops.simulate import simulate
from massprops.simulate.scenario import known, load_scenario

SMALL = {"frames": 5, "size": (160, 120)}


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulate(
        "spacecraft", tmp_path_factory.mktemp("s") / "seq", stereo_m=0.5, range_sigma_m=0.01, seed=4, **SMALL
    )


def frame(folder: Path, i: int, camera: int = 0) -> np.ndarray:
    return cv2.imread(str(sorted((folder / f"cam{camera}" / "data").glob("*.png"))[i]), cv2.IMREAD_GRAYSCALE)


def test_body_projects_where_the_truth_says(sequence: Path) -> None:
    truth, read = read_truth(sequence), read_sequence(sequence)
    assert truth is not None
    mesh = trimesh.load(sequence / "truth" / "mesh.ply")
    fu, fv, cu, cv = read.cameras[0].intrinsics
    for i in range(SMALL["frames"]):
        p = mesh.vertices @ rotation_matrix(truth.q[i]).T + truth.position[i]
        uv = p[:, :2] / p[:, 2:] * [fu, fv] + [cu, cv]
        v, u = np.nonzero(frame(sequence, i) > 14)
        low, high = uv.min(0) - 1.5, uv.max(0) + 1.5
        assert u.min() >= low[0] and u.max() <= high[0] and v.min() >= low[1] and v.max() <= high[1]
        assert len(u) > 200


def test_momentum_of_the_motion_is_constant(sequence: Path) -> None:
    truth = read_truth(sequence)
    assert truth is not None
    inertia = np.array(truth.facts["motion_inertia"])
    momentum = np.einsum("nij,jk,nk->ni", rotation_matrix(truth.q), inertia, truth.w)
    assert np.allclose(momentum, momentum[0], rtol=1e-6, atol=1e-6 * np.linalg.norm(momentum[0]))


def test_stereo_pair_shifts_by_the_baseline(sequence: Path) -> None:
    read, truth = read_sequence(sequence), read_truth(sequence)
    assert truth is not None and read.cameras[1].T_BS[0, 3] == 0.5
    left, right = frame(sequence, 0).astype(float), frame(sequence, 0, 1).astype(float)
    expected = read.cameras[0].intrinsics[0] * 0.5 / truth.position[0, 2]
    errors = [np.mean((left[:, s:] - right[:, : right.shape[1] - s]) ** 2) for s in range(12)]
    assert abs(int(np.argmin(errors)) - expected) < 1.5


def test_range_and_truth_files(sequence: Path) -> None:
    read, truth = read_sequence(sequence), read_truth(sequence)
    assert truth is not None and read.range is not None
    assert np.allclose(read.range.range_m, np.linalg.norm(truth.position, axis=1), atol=0.06)
    assert truth.facts["k1"] < 0 and truth.facts["k2"] < 0
    assert truth.facts["motion_k1"] == pytest.approx(truth.facts["k1"])


def test_same_seed_same_pixels_other_seed_others(tmp_path: Path) -> None:
    a, b = (simulate("asteroid", tmp_path / n, frames=2, size=(80, 60), seed=3) for n in "ab")
    c = simulate("asteroid", tmp_path / "c", frames=2, size=(80, 60), seed=5)
    assert np.array_equal(frame(a, 1), frame(b, 1))
    assert not np.array_equal(frame(a, 1), frame(c, 1))


def test_noise_of_the_sky_is_as_asked(tmp_path: Path) -> None:
    folder = simulate("asteroid", tmp_path / "n", frames=2, size=(200, 150), noise=5.0, fill=0.3, ambient=0.0)
    sky = frame(folder, 0)[:25].astype(float)
    # clipped at zero: half of a Gaussian about 2 grey levels
    assert 2.0 < sky.std() < 5.0


def test_hard_shadows_exist(tmp_path: Path) -> None:
    shadowed = simulate("spacecraft", tmp_path / "a", sun_phase_deg=70, seed=2, frames=4, size=(160, 120))
    full = simulate("spacecraft", tmp_path / "b", sun_phase_deg=0, seed=2, frames=4, size=(160, 120))
    assert (frame(shadowed, 1) > 40).sum() < 0.85 * (frame(full, 1) > 40).sum()


def test_hidden_mass_moves_the_motion_only(tmp_path: Path) -> None:
    folder = simulate("asteroid", tmp_path / "h", frames=2, size=(80, 60), hidden_mass=(0.08, 0.8, 0.0, 0.3))
    truth = read_truth(folder)
    assert truth is not None
    assert abs(truth.facts["motion_k1"] - truth.facts["k1"]) > 0.01
    expected = np.array(truth.facts["inertia"])
    d, m = np.array([0.8, 0.0, 0.3]), truth.facts["mass"]
    expected = expected + m * 0.08 / 1.08 * (d @ d * np.eye(3) - np.outer(d, d))
    assert np.allclose(truth.facts["motion_inertia"], expected)


def test_distortion_is_opencvs(tmp_path: Path) -> None:
    plain, bent = (
        simulate("asteroid", tmp_path / n, frames=2, size=(160, 120), distortion=d, focal=0.7, seed=1)
        for n, d in (("p", (0.0, 0.0)), ("d", (-0.3, 0.0)))
    )
    truth, read = read_truth(bent), read_sequence(bent)
    assert truth is not None
    fu, fv, cu, cv = read.cameras[0].intrinsics
    K = np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]])
    mesh = trimesh.load(bent / "truth" / "mesh.ply")
    p = mesh.vertices @ rotation_matrix(truth.q[0]).T + truth.position[0]
    uv = cv2.projectPoints(p, np.zeros(3), np.zeros(3), K, read.cameras[0].distortion)[0][:, 0]
    lit = frame(bent, 0) > 14
    v, u = np.nonzero(lit)
    assert u.max() <= uv[:, 0].max() + 1.5 and v.max() <= uv[:, 1].max() + 1.5
    assert lit.sum() < (frame(plain, 0) > 14).sum(), "barrel distortion makes the body smaller"


def test_a_users_mesh_and_wrong_ones(tmp_path: Path) -> None:
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "box.stl")
    folder = simulate(tmp_path / "box.stl", tmp_path / "seq", frames=2, size=(64, 48))
    truth = read_truth(folder)
    assert truth is not None and truth.facts["volume"] == pytest.approx(6.0)
    assert set(known()) >= {"spacecraft", "asteroid", "bracket"}
    for scenario, says in (("nothing", "spacecraft"), (tmp_path / "no.stl", "no such")):
        with pytest.raises(InputError, match=says):
            load_scenario(scenario)
    with pytest.raises(InputError, match="frames"):
        load_scenario("asteroid", frames=0)
    (tmp_path / "s.yaml").write_text("mesh: asteroid.stl\nspeed: 3\n")
    with pytest.raises(InputError, match="speed"):
        load_scenario(tmp_path / "s.yaml")


def test_array_is_one_percent_of_the_span() -> None:
    mesh = trimesh.load(load_scenario("spacecraft").mesh)
    assert mesh.is_volume and mesh.body_count == 1
    heights = np.unique(np.round(mesh.vertices[np.abs(mesh.vertices[:, 0]) > 2.0][:, 1], 4))
    assert np.ptp(heights) / mesh.extents[0] == pytest.approx(0.0101, abs=5e-4)
