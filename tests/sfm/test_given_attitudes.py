"""A body of known attitudes is placed by its outlines."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from massprops.errors import NotPossible
from massprops.sequence.data import AttitudeSeries
from massprops.sfm.convert import to_views
from massprops.sfm.footage import CameraRecord, FootageRecord, FrameRecord
from massprops.sfm.given_attitudes import attitudes_at, place_by_attitudes
from massprops.sfm.outline_path import outline_path
from massprops.views import Views

K = np.array([[900.0, 0, 319.5], [0, 900.0, 239.5], [0, 0, 1]])


def filmed(count: int = 40) -> tuple[Views, list[np.ndarray], np.ndarray]:
    """A lump that turns and drifts: its views with true poses, its silhouettes, and the times."""
    rng = np.random.default_rng(3)
    points = rng.standard_normal((60, 3)) * [1.0, 0.7, 0.5] + [0.3, 0.1, 0.0]
    time = np.linspace(0.0, 80.0, count)
    # a coning motion: about one fixed axis, where along it the origin lies would be open
    angles = np.column_stack([5.0 * time / 80.0, np.full(count, 1.1), 7.0 * time / 80.0])
    turns = Rotation.from_euler("ZXZ", angles)
    place = np.array([0.4, -0.3, 12.0]) + np.outer(time / 80.0 - 0.5, [0.6, 0.3, 1.5])
    R = turns.as_matrix()
    masks = []
    for turn, where in zip(R, place, strict=True):
        seen = (points @ turn.T + where) @ K.T
        mask = np.zeros((480, 640), np.uint8)
        corners = cv2.convexHull(np.rint(seen[:, :2] / seen[:, 2:]).astype(np.int32))
        masks.append(cv2.fillConvexPoly(mask, corners, 255))
    names = tuple(f"cam0/{i:06d}.png" for i in range(count))
    size = np.tile([640, 480], (count, 1))
    stamps = np.rint(1e9 * time).astype(np.int64)
    return Views(names, stamps, size, np.tile(K, (count, 1, 1)), np.zeros((count, 4)), R, place), masks, time


def test_the_path_of_a_body_of_known_attitudes_is_found_up_to_its_scale() -> None:
    views, masks, time = filmed()
    path = outline_path(replace(views, t=np.zeros_like(views.t)), masks, masks, time, 0.0, 0)
    true = views.t / views.t[:, 2].mean()
    assert path.error_px < 1.0
    assert np.abs(900 * (path.position - true)[:, :2]).max() < 0.5
    assert np.abs((path.position - true)[:, 2]).max() < 0.003


def footage_of(views: Views, masks: list[np.ndarray], folder: Path, focal: float | None) -> FootageRecord:
    """A capture folder of the film."""
    for name, mask in zip(views.names, masks, strict=True):
        for file in (folder / "frames" / name, folder / "masks" / f"{name}.png"):
            file.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(file), mask)
    camera = CameraRecord(0, (640, 480), focal, (319.5, 239.5), (0.0, 0.0, 0.0, 0.0), focal_source="given")
    frames = tuple(
        FrameRecord(n, 0, int(t), i) for i, (n, t) in enumerate(zip(views.names, views.timestamp_ns, strict=True))
    )
    return FootageRecord(folder, "seq", "sequence", "tumbling", "black", True, (camera,), frames)


def given_at(views: Views, first: int) -> AttitudeSeries:
    """Their attitudes from image `first` on."""
    q = Rotation.from_matrix(views.R[first:]).as_quat()[:, [3, 0, 1, 2]]
    return AttitudeSeries(views.timestamp_ns[first:], q, np.full(len(q), 1e-3))


def test_the_images_of_a_film_are_placed_by_attitudes_and_outlines(tmp_path: Path) -> None:
    views, masks, _ = filmed()
    placed = place_by_attitudes(footage_of(views, masks, tmp_path, 900.0), given_at(views, 2), 0)
    assert placed.views.names == views.names[2:]
    assert placed.warnings == ("2 images have no attitude in attitude0 or no outline: left out",)
    size = placed.views.t[:, 2].mean() / views.t[2:, 2].mean()
    # the camera's centres about the body, over its distance
    assert np.abs(placed.views.centres - size * views.centres[2:]).max() < 0.005 * placed.views.t[:, 2].mean()
    model = to_views(placed.model)[0]
    assert np.allclose(model.t, placed.views.t) and np.allclose(model.R, placed.views.R)
    assert np.allclose(model.K, placed.views.K)


def test_an_image_in_which_nothing_is_lit_is_left_out(tmp_path: Path) -> None:
    views, masks, _ = filmed()
    masks[5] = np.zeros_like(masks[5])
    placed = place_by_attitudes(footage_of(views, masks, tmp_path, 900.0), given_at(views, 0), 0)
    assert views.names[5] not in placed.views.names and len(placed.views) == len(views) - 1


def test_attitudes_need_a_focal_length_and_a_common_clock(tmp_path: Path) -> None:
    views, masks, _ = filmed(12)
    with pytest.raises(NotPossible, match="--focal"):
        place_by_attitudes(footage_of(views, masks, tmp_path, None), given_at(views, 0), 0)
    late = replace(given_at(views, 0), timestamp_ns=views.timestamp_ns + 10**12)
    with pytest.raises(NotPossible, match="covers 0 of the 12 images: both must use one clock"):
        place_by_attitudes(footage_of(views, masks, tmp_path, 900.0), late, 0)


def test_attitudes_of_other_axes_are_refused() -> None:
    views, masks, time = filmed()
    inverse = replace(views, R=views.R.transpose(0, 2, 1), t=np.zeros_like(views.t))
    with pytest.raises(NotPossible, match="do not fit the outlines"):
        outline_path(inverse, masks, masks, time, 0.0, 0)


def test_a_terminator_is_no_outline() -> None:
    views, masks, time = filmed()
    # lit from the left: brightness falls to the right, and the rightmost quarter of the body is dark
    lit, grey = [], []
    for mask in masks:
        columns = np.nonzero(mask.any(0))[0]
        shade = 1 - (np.arange(640) - columns[0]) / (0.75 * np.ptp(columns))
        grey.append(np.uint8(np.clip(255 * shade, 0, 255))[None] * np.uint8(mask > 0))
        lit.append(np.where(grey[-1] > 0, 255, 0).astype(np.uint8))
    path = outline_path(replace(views, t=np.zeros_like(views.t)), lit, grey, time, 0.0, 0)
    true = views.t / views.t[:, 2].mean()
    assert np.abs(900 * (path.position - true)[:, :2]).max() < 1.0


def test_attitudes_are_interpolated_and_not_extrapolated() -> None:
    turns = Rotation.from_rotvec(np.outer(np.arange(5), [0.0, 0.0, 0.2]))
    q = turns.as_quat()[:, [3, 0, 1, 2]]
    q[2] *= -1  # the same attitude
    given = AttitudeSeries(np.arange(5) * 100, q, np.full(5, 0.01))
    R, sigma = attitudes_at(given, np.array([-1, 0, 50, 250, 400, 401]))
    assert np.array_equal(np.isfinite(sigma), [False, True, True, True, True, False])
    angle = Rotation.from_matrix(R[1:5]).as_rotvec()[:, 2]
    assert np.allclose(angle, [0.0, 0.1, 0.5, 0.8])


def test_a_gap_in_which_the_body_turns_far_is_not_bridged() -> None:
    q = Rotation.from_rotvec([[0, 0, 0], [0, 0, 1.0]]).as_quat()[:, [3, 0, 1, 2]]
    sigma = attitudes_at(AttitudeSeries(np.array([0, 100]), q, np.full(2, 0.01)), np.array([0, 50, 100]))[1]
    assert np.array_equal(np.isfinite(sigma), [True, False, True])


def test_one_attitude_is_no_history() -> None:
    one = AttitudeSeries(np.zeros(1, np.int64), np.array([[1.0, 0, 0, 0]]), np.full(1, 0.01))
    assert not np.isfinite(attitudes_at(one, np.array([0, 1]))[1]).any()
