from dataclasses import replace

import numpy as np
import pytest
import scene

from massprops.errors import InputError
from massprops.sequence.data import RangeSeries
from massprops.sfm.scale import ScaleEstimate, ScaleInputs, choose, find_scale, marker, sources


def test_every_source_stays_silent_when_not_asked():
    scale = find_scale(ScaleInputs(length=2.0))
    assert set(sources()) >= {"baseline", "distance", "given", "marker", "range"}
    assert scale.source == "none" and scale.metres_per_unit is None
    assert scale.unit_per_sfm == 0.5


def test_given_is_the_greatest_length():
    scale = find_scale(ScaleInputs(length=2.0, given=3.35))
    assert scale.source == "given"
    assert scale.metres_per_unit == pytest.approx(3.35)
    with pytest.raises(InputError, match="above 0"):
        find_scale(ScaleInputs(length=2.0, given=-1.0))


def test_distance_between_points_names_and_features():
    _, points = scene.make(3, 20)
    inputs = dict(length=2.0, points=points, named={"tip": np.array([0.5, 0, 0])})
    scale = find_scale(ScaleInputs(distance=("tip", "0,0,0", 4.0), **inputs))
    assert scale.metres_per_unit == pytest.approx(8.0)
    apart = np.linalg.norm(points.xyz[0] - points.xyz[5]) / 2.0
    scale = find_scale(ScaleInputs(distance=("1", "6", 1.0), **inputs))
    assert scale.metres_per_unit == pytest.approx(1 / apart)
    for bad in (("nose", "tip", 1.0), ("tip", "tip", 1.0), ("tip", "0,0,0", 0.0), ("a,b,c", "tip", 1.0)):
        with pytest.raises(InputError, match="--distance"):
            find_scale(ScaleInputs(distance=bad, **inputs))


def test_range_is_the_median_over_distance():
    views, _ = scene.make(12)
    com = np.array([0.1, 0.05, -0.2])
    true = 7.5 * np.linalg.norm(views.centres - com, axis=1)
    rng = np.random.default_rng(0)
    measured = true * (1 + 0.002 * rng.normal(size=12))
    measured[4] *= 1.3
    series = RangeSeries(views.timestamp_ns, measured, 0.1)
    scale = find_scale(ScaleInputs(length=2.0, views=views, centre_of_mass=com, range=series))
    assert scale.source == "range"
    assert scale.metres_per_unit == pytest.approx(15.0, rel=4 * scale.relative_sigma)
    assert scale.relative_sigma < 0.002
    by_estimated_focal = find_scale(
        ScaleInputs(length=2.0, views=views, centre_of_mass=com, range=series, focal_sigma=0.01)
    )
    assert by_estimated_focal.relative_sigma == pytest.approx(np.hypot(0.01, scale.relative_sigma))
    late = RangeSeries(views.timestamp_ns + 10**12, measured, 0.1)
    with pytest.raises(InputError, match="clock"):
        find_scale(ScaleInputs(length=2.0, views=views, centre_of_mass=com, range=late))


def test_the_most_precise_wins_and_conflicts_are_said():
    a, b = ScaleEstimate("given", 1.0, 0.05), ScaleEstimate("range", 1.3, 0.001)
    scale = choose([a, b], 2.0)
    assert scale.source == "range" and scale.metres_per_unit == pytest.approx(2.6)
    assert any("given differs" in w for w in scale.warnings)
    assert not choose([a, ScaleEstimate("range", 1.02, 0.001)], 2.0).warnings


def test_rig_scale_carries_the_focal_length():
    scale = find_scale(ScaleInputs(length=2.0, rig_metres=1.0, focal_sigma=0.01))
    assert scale.source == "baseline" and scale.metres_per_unit == pytest.approx(2.0)
    assert scale.relative_sigma == pytest.approx(0.01, rel=0.1)


def marker_frames(folder, board=None):
    """A flat marker of side 0.5 units at the world's middle, drawn into every view by its homography."""
    import cv2

    views, _ = scene.make(6, 5, focal=1100, step_deg=7)
    d = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    if board:
        sheet = cv2.aruco.CharucoBoard(board, 1.0, 0.75, d).generateImage((board[0] * 80, board[1] * 80))
        square, side = 80, 1.6 / board[0]
    else:
        sheet, square, side = cv2.aruco.generateImageMarker(d, 7, 400), 400, 1.2
    per_pixel = side / square
    sheet = np.pad(sheet, 60, constant_values=255)
    middle = np.array([sheet.shape[1] / 2, sheet.shape[0] / 2]) - 0.5
    plane = np.array(
        [[per_pixel, 0, -per_pixel * middle[0]], [0, per_pixel, -per_pixel * middle[1]], [0, 0, 0], [0, 0, 1]]
    )
    for i, name in enumerate(views.names):
        P = views.K[i] @ np.column_stack([views.R[i], views.t[i]])
        image = cv2.warpPerspective(sheet, P @ plane, (640, 480), flags=cv2.INTER_AREA, borderValue=128)
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / name), image)
    return views, side


@pytest.mark.parametrize(("board", "text"), [(None, "4X4_50:0.06"), ((5, 4), "4X4_50:5x4:0.06")])
def test_marker_gives_the_scale(tmp_path, board, text):
    views, side = marker_frames(tmp_path, board)
    scale = find_scale(ScaleInputs(length=2.0, views=views, frames=tmp_path, marker=text))
    assert scale.source == "marker"
    assert scale.metres_per_unit == pytest.approx(0.06 / side * 2.0, rel=0.01)


def test_corners_of_a_small_blurred_marker_lie_where_the_edges_meet():
    """32 px a side: OpenCV's corners lie 0.25 px inside, which is 1.3 % of the side."""
    import cv2

    d = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    sheet = cv2.copyMakeBorder(cv2.aruco.generateImageMarker(d, 7, 600), *[100] * 4, cv2.BORDER_CONSTANT, value=255)
    on_sheet = np.array([[99.5, 99.5], [699.5, 99.5], [699.5, 699.5], [99.5, 699.5]])
    rng = np.random.default_rng(5)
    drawn, short = [], []
    for _ in range(12):
        angle, lean = rng.uniform(0, 2 * np.pi), rng.uniform(0.6, 1.0)
        A = 0.053 * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ np.diag([1, lean])
        move = 60 + rng.uniform(0, 1, 2) - A @ [399.5, 399.5]
        big = cv2.warpAffine(sheet, 4 * np.column_stack([A, move + 0.375]), (480, 480), borderValue=90)
        image = cv2.resize(big, (120, 120), interpolation=cv2.INTER_AREA)
        image = np.clip(image * 0.7 + 20 + rng.normal(0, 1.5, image.shape), 0, 255).astype(np.uint8)
        found = marker.detect(image, marker.parse("4X4_50:0.05"))
        corners = np.array([found[7, k] for k in range(4)])
        true = on_sheet @ A.T + move
        drawn.append(np.linalg.norm(corners - true, axis=1))
        sides = [np.linalg.norm(np.diff(c[[0, 1, 2, 3, 0]], axis=0), axis=1) for c in (corners, true)]
        short.append(sides[0] / sides[1] - 1)
    assert np.median(drawn) < 0.06 and abs(np.mean(short)) < 0.002


@pytest.mark.parametrize(
    "text", ["4X4_50", "9X9_1:0.05", "4X4_50:big", "4X4_50:-1", "4X4_50:1x1:0.05", "4X4_50:5:0.05"]
)
def test_marker_option_that_cannot_be_read(text):
    with pytest.raises(InputError, match="--marker"):
        find_scale(ScaleInputs(length=2.0, marker=text))


def test_marker_that_is_not_in_view(tmp_path):
    import cv2

    views, _ = scene.make(3, 5)
    (tmp_path / "cam0").mkdir()
    for name in views.names:
        cv2.imwrite(str(tmp_path / name), np.full((480, 640), 90, np.uint8))
    with pytest.raises(InputError, match="not seen"):
        find_scale(ScaleInputs(length=2.0, views=views, frames=tmp_path, marker="4X4_50:0.05"))


def everything(folder):
    """Inputs that ask every source, each for another length."""
    views, side = marker_frames(folder)
    points = scene.make(6, 20)[1]
    com = np.array([0.1, 0.05, -0.2])
    series = RangeSeries(views.timestamp_ns, 7.5 * np.linalg.norm(views.centres - com, axis=1), 0.1)
    return ScaleInputs(
        length=2.0, views=views, points=points, centre_of_mass=com, frames=folder, range=series, rig_metres=5.0,
        focal_sigma=0.01, given=3.0, given_sigma=0.02, distance=("1", "6", 1.0), marker=f"4X4_50:{3 * side}",
    )  # fmt: skip


def in_other_units(inputs, factor):
    """The same body and footage, reconstructed in a unit that is `factor` times smaller."""
    points = replace(inputs.points, xyz=factor * inputs.points.xyz)
    return replace(
        inputs, length=factor * inputs.length, views=replace(inputs.views, t=factor * inputs.views.t), points=points,
        centre_of_mass=factor * inputs.centre_of_mass, rig_metres=inputs.rig_metres / factor,
    )  # fmt: skip


@pytest.mark.parametrize("name", sorted(sources()))
def test_what_every_source_keeps_to(name, tmp_path):
    """A new source of scale adds what it asks for to `everything`."""
    source, inputs = sources()[name], everything(tmp_path)
    found = source.estimate(inputs)
    assert isinstance(found, ScaleEstimate) and found.source == name
    assert found.metres_per_sfm > 0 and 0 <= found.relative_sigma < 0.5
    assert all(w and "\n" not in w for w in found.warnings)
    smaller = source.estimate(in_other_units(inputs, 3.0))
    # the marker is triangulated step by step, and stops where a step no longer counts
    assert smaller.metres_per_sfm * 3.0 == pytest.approx(found.metres_per_sfm, rel=1e-5)
    assert smaller.relative_sigma == pytest.approx(found.relative_sigma, rel=1e-3, abs=1e-9)
    assert source.estimate(ScaleInputs(length=2.0)) is None
