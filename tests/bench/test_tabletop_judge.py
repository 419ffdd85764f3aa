"""The judge of the table-top scenes, on small bodies whose errors are known."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from tabletop.judge import fit_cameras, judge_intervals, judge_masks, judge_mesh, run_masks
from tabletop.silhouettes import intersection_over_union, silhouette
from tabletop.truth import SceneTruth

WORLD = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [0.1, 0.2, 0.3])


def poses_round(count: int = 12, distance: float = 0.6) -> np.ndarray:
    """(count, 3, 4) cameras on a rising circle that look at the origin."""
    out = []
    for angle in np.linspace(0, 2 * np.pi, count, endpoint=False):
        centre = distance * np.array([np.cos(angle), np.sin(angle), 0.5 + 0.3 * np.sin(3 * angle)])
        z = -centre / np.linalg.norm(centre)
        x = np.cross(z, [0, 0, 1.0])
        R = np.stack([x / np.linalg.norm(x), np.cross(z, x / np.linalg.norm(x)), z])
        out.append(np.column_stack([R, -R @ centre]))
    return np.stack(out)


def box_truth(names: tuple[str, ...] | None = None) -> SceneTruth:
    mesh = trimesh.creation.box((0.06, 0.1, 0.16))
    mesh = mesh.subdivide().subdivide()
    poses = poses_round()
    moments = np.sort(np.linalg.eigvalsh(mesh.moment_inertia))
    return SceneTruth(
        names=names or ("",) * len(poses),
        poses=poses,
        K=np.array([[700.0, 0, 160], [0, 700, 120], [0, 0, 1]]),
        size=np.tile([320, 240], (len(poses), 1)),
        distortion=np.zeros(2),
        placement=np.zeros(len(poses), int),
        mesh=mesh,
        volume=float(mesh.volume),
        moments=moments,
    )


def in_run_axes(points: np.ndarray, scale: float = 3.0) -> np.ndarray:
    """The same points in a run's arbitrary axes and unit."""
    return scale * trimesh.transform_points(points, WORLD)


def run_mesh(truth: SceneTruth, larger: float = 1.0) -> trimesh.Trimesh:
    return trimesh.Trimesh(in_run_axes(larger * truth.mesh.vertices), truth.mesh.faces, process=False)


def test_a_perfect_run_has_no_errors() -> None:
    truth = box_truth()
    fit = fit_cameras(in_run_axes(truth.centres), truth.centres)
    assert fit is not None and fit.agree.all() and fit.scale == pytest.approx(1 / 3)
    found = judge_mesh(run_mesh(truth), truth, fit)
    assert found["closed"]
    assert found["volume"] == pytest.approx(0, abs=1e-9)
    assert np.allclose(found["shape"], 0, atol=1e-9) and np.allclose(found["k"], 0, atol=1e-9)
    assert found["centre"] < 1e-9 and found["strays"] < 1e-6


def test_a_larger_mesh_is_an_error_of_volume_only_if_the_cameras_say_so() -> None:
    truth = box_truth()
    fit = fit_cameras(in_run_axes(truth.centres), truth.centres)
    grown = judge_mesh(run_mesh(truth, 1.1), truth, fit)
    assert grown["volume"] == pytest.approx(0.331) and np.allclose(grown["shape"], 0, atol=1e-9)
    wider = fit_cameras(in_run_axes(1.1 * truth.centres), truth.centres)
    assert judge_mesh(run_mesh(truth, 1.1), truth, wider)["volume"] == pytest.approx(0, abs=1e-9)


def test_stretching_shows_in_shape_and_k() -> None:
    truth = box_truth()
    mesh = trimesh.Trimesh(truth.mesh.vertices * [1, 1, 1.05], truth.mesh.faces, process=False)
    found = judge_mesh(mesh, truth, fit_cameras(truth.centres, truth.centres))
    assert found["volume"] == pytest.approx(0.05)
    a, b, c = 0.06**2, 0.1**2, 0.16**2
    stretched, true = (np.array([a + b, a + h, b + h]) for h in (c * 1.05**2, c))
    assert np.allclose(found["k"], np.log(stretched[:2] / stretched[1:]) - np.log(true[:2] / true[1:]))


def test_an_open_mesh_is_not_closed() -> None:
    truth = box_truth()
    mesh = trimesh.Trimesh(truth.mesh.vertices, truth.mesh.faces[1:], process=False)
    assert judge_mesh(mesh, truth, fit_cameras(truth.centres, truth.centres)) == {"closed": False}


def test_something_beside_the_object_shows_as_strays() -> None:
    truth = box_truth()
    crumb = trimesh.creation.box((0.01, 0.01, 0.01))
    crumb.apply_translation([0.15, 0, 0])
    both = trimesh.util.concatenate([truth.mesh, crumb])
    found = judge_mesh(both, truth, fit_cameras(truth.centres, truth.centres))
    assert found["strays"] == pytest.approx((0.155 - 0.03) / 0.16, rel=0.01)


def test_the_cameras_of_one_placement_outvote_the_others() -> None:
    truth = box_truth()
    ours = in_run_axes(truth.centres)
    turned = trimesh.transformations.rotation_matrix(2.0, [1, 0, 0])
    ours[8:] = in_run_axes(trimesh.transform_points(truth.centres[8:], turned))
    fit = fit_cameras(ours, truth.centres)
    assert fit is not None and list(np.flatnonzero(fit.agree)) == list(range(8))
    assert fit.scale == pytest.approx(1 / 3)


def test_cameras_without_a_common_similarity_have_no_fit() -> None:
    truth = box_truth()
    assert fit_cameras(np.random.default_rng(1).normal(size=truth.centres.shape), truth.centres) is None
    assert fit_cameras(truth.centres[:3], truth.centres[:3]) is None


def test_silhouettes_of_the_cad_agree_with_themselves_only() -> None:
    truth = box_truth()
    masks = {
        i: silhouette(truth.mesh.vertices, truth.mesh.faces, truth.poses[i], truth.K, truth.distortion, truth.size[i])
        for i in range(4)
    }
    assert judge_masks(masks, truth) == {"masks": 4, "iou_median": 1.0, "iou_worst": 1.0}
    masks[2] = np.roll(masks[2], 30, axis=1)
    found = judge_masks(masks, truth)
    assert found["iou_median"] == 1.0 and found["iou_worst"] < 0.7


def test_masks_of_a_reduced_image_are_compared_in_their_own_size() -> None:
    truth = box_truth()
    half = np.diag([0.5, 0.5, 1]) @ truth.K
    mesh = truth.mesh
    mask = silhouette(mesh.vertices, mesh.faces, truth.poses[0], half, truth.distortion, truth.size[0] // 2)
    assert judge_masks({0: mask}, truth)["iou_worst"] == 1.0


def test_a_silhouette_covers_what_it_should() -> None:
    """A square of 0.1 m at 1 m, focal length 200: exactly 20 px wide, from pixel edge to pixel edge."""
    vertices = np.array([[-0.05, -0.05, 0], [0.05, -0.05, 0], [0.05, 0.05, 0], [-0.05, 0.05, 0]])
    pose = np.column_stack([np.eye(3), [0, 0, 1]])
    K = np.array([[200.0, 0, 30], [0, 200, 20], [0, 0, 1]])
    found = silhouette(vertices, np.array([[0, 1, 2], [0, 2, 3]]), pose, K, np.zeros(2), np.array([60, 40]))
    expected = np.zeros((40, 60), bool)
    expected[10:30, 20:40] = True
    assert intersection_over_union(found, expected) == 1.0


def test_barrel_distortion_draws_the_silhouette_in() -> None:
    truth = box_truth()
    v, f = truth.mesh.vertices, truth.mesh.faces
    areas = [
        silhouette(v, f, truth.poses[0], truth.K, np.array([k, 0.0]), truth.size[0]).sum() for k in (-0.5, 0.0, 0.5)
    ]
    assert areas[0] < areas[1] < areas[2]


def test_intervals_are_compared_in_units_of_the_greatest_length() -> None:
    truth = box_truth()
    unit = np.linalg.norm(truth.mesh.extents)
    v, moments = truth.volume / unit**3, truth.moments / unit**5 * 1000.0
    k = np.log(truth.moments[:2] / truth.moments[1:])
    document = {
        "density": 1000.0,
        "units": {"length": "model", "mass": "model"},
        "volume": v,
        "interval_90": {
            "volume": [0.9 * v, 1.1 * v],
            "principal_moments": [[0.9 * m, 1.1 * m] for m in moments],
            "k1": [k[0] - 0.1, k[0] + 0.1],
            "k2": [k[1] + 0.1, k[1] + 0.2],
        },
    }
    found = judge_intervals(document, truth)
    assert found["half_width"] == pytest.approx(0.1)
    assert found["holds"] == {"volume": True, "I1": True, "I2": True, "I3": True, "k1": True, "k2": False}
    metric = judge_intervals({**document, "units": {"length": "m", "mass": "kg"}}, truth)
    assert metric["holds"] == {"volume": False, "I1": False, "I2": False, "I3": False, "k1": True, "k2": False}


def test_images_are_found_by_the_name_a_run_gives_them() -> None:
    names = ("a photo.jpg", "b.heic", *(f"{i}.jpg" for i in range(10)))
    photos = box_truth(names)
    assert (
        photos.row("cam0/a photo.jpg") == 0 and photos.row("cam0/b.heic.png") == 1 and photos.row("other.jpg") is None
    )
    video = box_truth()
    assert video.row("cam0/000007.png") == 7 and video.row("cam0/000099.png") is None


def test_an_image_that_was_left_out_is_no_silhouette(tmp_path: Path) -> None:
    (tmp_path / "masks").mkdir()
    for name, level in (("a.jpg", 128), ("b.jpg", 0), ("c.jpg", 255)):
        cv2.imwrite(str(tmp_path / "masks" / f"{name}.png"), np.full((24, 32), level, np.uint8))
    truth = box_truth(names=("a.jpg", "b.jpg", "c.jpg", *(f"{i}.jpg" for i in range(9))))
    found = run_masks(tmp_path, truth)
    assert {row: bool(mask.all()) for row, mask in found.items()} == {1: False, 2: True}
