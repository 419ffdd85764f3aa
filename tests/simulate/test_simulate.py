"""Rendered footage against its own truth."""

from __future__ import annotations

from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import trimesh

import massprops
from massprops.dynamics.quaternion import rotation_matrix
from massprops.errors import InputError
from massprops.sequence import read_sequence
from massprops.sequence.truth import read_truth
from massprops.simulation import simulate
from massprops.simulation.render import undistorted_radius
from massprops.simulation.scenario import known, load_scenario
from massprops_cli.main import run

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


def test_body_with_hidden_mass_turns_about_its_whole_centre_of_mass(tmp_path: Path) -> None:
    folder = simulate(
        "asteroid", tmp_path / "h", range_sigma_m=1e-9, hidden_mass=(0.2, 0.9, 0.0, 0.3), frames=6, size=(64, 48)
    )
    truth, read = read_truth(folder), read_sequence(folder)
    assert truth is not None and read.range is not None
    centre = np.array(truth.facts["motion_centre_of_mass_m"])
    assert np.allclose(centre, np.array([0.9, 0.0, 0.3]) * 0.2 / 1.2)
    in_camera = truth.position + rotation_matrix(truth.q) @ centre
    assert np.allclose(in_camera, in_camera[0], atol=1e-9)
    assert np.linalg.norm(truth.position[-1] - truth.position[0]) > 0.01
    assert np.allclose(read.range.range_m, np.linalg.norm(in_camera, axis=1), atol=1e-7)


def test_distortion_is_opencvs(tmp_path: Path) -> None:
    plain, bent = (
        simulate("asteroid", tmp_path / n, frames=2, size=(160, 120), distortion=d, focal=0.7, seed=1)
        for n, d in (("p", (0.0, 0.0)), ("d", (-0.15, 0.0)))
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


@pytest.mark.parametrize(("k1", "k2"), [(-0.3, 0.05), (0.2, 0.0), (-0.1, 0.0), (0.0, 0.1)])
def test_rays_of_a_bent_lens_come_back_to_their_pixels(k1: float, k2: float) -> None:
    seen = np.linspace(0, 0.6, 50)
    r = undistorted_radius(seen, k1, k2)
    points = np.column_stack([r, np.zeros_like(r), np.ones_like(r)])
    uv = cv2.projectPoints(points, np.zeros(3), np.zeros(3), np.eye(3), np.array([k1, k2, 0.0, 0.0]))[0][:, 0]
    assert np.allclose(uv[:, 0], seen, atol=1e-10)
    assert np.all(np.diff(r) > 0)


def test_a_lens_that_turns_back_inside_the_image_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="corners"):
        simulate("asteroid", tmp_path / "d", distortion=(-3.0, 0.0), focal=0.5, frames=2, size=(64, 48))


def test_noise_has_the_stated_size_and_grows_with_light(tmp_path: Path) -> None:
    folder = simulate("asteroid", tmp_path / "n", background="still", noise=3.0, fill=0.3, frames=2, size=(320, 240))
    first, second = (frame(folder, i)[:50].astype(float) for i in (0, 1))
    grey = 0.5 * (first + second)
    # rounding adds 1/12 to the variance of each frame
    expected = 9.0 * (1.0 + grey / 60.0) + 1 / 12
    assert np.mean((first - second) ** 2 / (2 * expected)) == pytest.approx(1.0, abs=0.05)
    assert grey.std() > 10, "the background has a picture of its own"


def test_camera_walks_round_a_still_bracket(tmp_path: Path) -> None:
    folder = simulate("bracket", tmp_path / "b", frames=6, size=(160, 120))
    truth = read_truth(folder)
    assert truth is not None and not truth.w.any()
    centres = -np.einsum("nji,nj->ni", rotation_matrix(truth.q), truth.position)
    height = np.degrees(np.arcsin(centres[:, 2] / np.linalg.norm(centres, axis=1)))
    assert height[:3].max() + 10 < height[3:].min()
    assert np.abs(truth.position[:, :2]).max() < 0.1 * truth.position[:, 2].min()
    assert frame(folder, 0).min() > 3, "the table fills what the bracket leaves"


def test_the_verb_takes_the_same_scenario(tmp_path: Path) -> None:
    seen = massprops.simulate("asteroid", tmp_path / "a", frames=2, size=(64, 48))
    assert seen.sequence.cameras[0].resolution == (64, 48) and seen.frames.shape == (2, 48, 64)


def test_video_holds_every_frame(tmp_path: Path) -> None:
    folder = simulate("asteroid", tmp_path / "v", video=True, frames=4, size=(96, 64))
    with av.open(str(folder / "cam0" / "video.mp4")) as container:
        shown = [f.to_ndarray(format="gray") for f in container.decode(video=0)]
    assert len(shown) == 4
    for i, image in enumerate(shown):
        difference = [np.abs(image.astype(float) - frame(folder, j)).mean() for j in range(4)]
        assert int(np.argmin(difference)) == i


def test_odd_sizes_make_no_video(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="even"):
        simulate("asteroid", tmp_path / "v", video=True, frames=2, size=(81, 61))
    assert not (tmp_path / "v").exists()


def test_only_a_simulation_is_written_over(tmp_path: Path) -> None:
    precious = tmp_path / "footage" / "cam0" / "data" / "0.png"
    precious.parent.mkdir(parents=True)
    precious.write_bytes(b"footage")
    with pytest.raises(InputError, match="choose another"):
        simulate("asteroid", tmp_path / "footage", frames=2, size=(64, 48))
    assert precious.read_bytes() == b"footage"
    pair = {"stereo_m": 0.3, "range_sigma_m": 0.01}
    simulate("asteroid", tmp_path / "again", frames=3, size=(64, 48), **pair)
    folder = simulate("asteroid", tmp_path / "again", frames=2, size=(64, 48))
    read = read_sequence(folder)
    assert set(read.cameras) == {0} and read.range is None and len(read.cameras[0].images) == 2


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"spin": (0.0, 0.0, 0.0)}, "spin"),
        ({"spin": (1.0, 0.0)}, "spin"),
        ({"distortion": (0.1,)}, "distortion"),
        ({"hidden_mass": (0.1, float("nan"), 0.0, 0.0)}, "hidden_mass"),
        ({"hidden_mass": (1.5, 0.0, 0.0, 0.0)}, "share"),
        ({"frames": 2.5}, "whole"),
        ({"seed": -1}, "seed"),
        ({"size": (10, 10)}, "size"),
        ({"background": "red"}, "background"),
        ({"rate_deg": float("nan")}, "rate_deg"),
    ],
)
def test_values_out_of_range_are_named(changes: dict, says: str) -> None:
    with pytest.raises(InputError, match=says):
        load_scenario("asteroid", **changes)


def test_meshes_that_are_no_body(tmp_path: Path) -> None:
    box = trimesh.creation.box()
    trimesh.Trimesh(box.vertices, box.faces[:-2]).export(tmp_path / "open.stl")
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    (tmp_path / "empty.stl").touch()
    for name, says in (("open.stl", "watertight"), ("points.obj", "no faces"), ("empty.stl", "empty.stl")):
        with pytest.raises(InputError, match=says):
            simulate(tmp_path / name, tmp_path / "seq", frames=2, size=(64, 48))
    assert not (tmp_path / "seq").exists()


def test_command_takes_the_lens_and_the_noise(tmp_path: Path) -> None:
    arguments = ["simulate", "asteroid", "-q", "-o", str(tmp_path / "c"), "--frames", "2", "--size", "64x48"]
    assert run([*arguments, "--distortion", "-0.1,0.02", "--noise", "4"]) == 0
    assert np.allclose(read_sequence(tmp_path / "c").cameras[0].distortion, [-0.1, 0.02, 0, 0])
    assert run([*arguments, "--distortion", "wide"]) == 2
    assert run([*arguments, "--hidden-mass", "0.1"]) == 2


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
