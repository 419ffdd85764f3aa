"""A made-up tumbling body whose images are read row by row: found, undone, and not found where there is nothing."""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from massprops.sfm.footage import CameraRecord, FootageRecord, FrameRecord, frame_file, frames_folder, mask_file
from massprops.sfm.global_images import GRID, SHIFTS, _places, as_read, grid_shifts, warped, write_global
from massprops.sfm.points import SparsePoints, project, residuals
from massprops.sfm.row_motion import Readout, Seen, motion_of, row_shifts
from massprops.views import Views

FRAMES, POINTS, STEP = 36, 400, 7.0
"""Images, points, and the body's turn from one to the next [deg]."""
SIZE, FOCAL, DISTANCE = (400, 300), 640.0, 5.5
AXIS = np.array([0.5, 0.8, 0.3]) / np.linalg.norm([0.5, 0.8, 0.3])


def pose(time: np.ndarray, shake_deg: float = 0.0, period: float = 7.0) -> tuple[np.ndarray, np.ndarray]:
    """World to camera (k, 3, 3), (k, 3) at times in frames: a body that turns about an axis that itself turns slowly, before a
    camera that may shake."""
    spin = Rotation.from_rotvec(np.deg2rad(STEP) * time[:, None] * AXIS)
    nod = Rotation.from_euler("z", 2.0 * time[:, None], degrees=True)
    t = np.column_stack([0.05 + 0.002 * time, -0.04 + 0.001 * time, np.full(len(time), DISTANCE)])
    phase = 2 * np.pi * time[:, None] / period + np.arange(3)
    shake = Rotation.from_rotvec(np.deg2rad(shake_deg) * np.sin(phase))
    return (shake * nod * spin).as_matrix(), shake.apply(t)


def filmed(
    readout: Readout, noise: float = 0.05, seed: int = 0, *shake: float
) -> tuple[Views, SparsePoints, np.ndarray]:
    """Views, points on a ball as a global shutter sees them, and (k, 2) where the shutter saw them, with noise [px].

    shake: amplitude [deg] and period [frames] of the camera's shaking.
    """
    rng = np.random.default_rng(seed)
    xyz = rng.standard_normal((POINTS, 3))
    xyz /= np.linalg.norm(xyz, axis=1, keepdims=True)
    xyz *= 0.9 + 0.1 * np.sin(4.0 * xyz[:, :1])
    R, t = pose(np.arange(FRAMES, dtype=float), *shake)
    K = np.tile(np.array([[FOCAL, 0, 199.5], [0, FOCAL, 149.5], [0, 0, 1.0]]), (FRAMES, 1, 1))
    names = tuple(f"cam0/{i:06d}.png" for i in range(FRAMES))
    views = Views(names, np.arange(FRAMES) * 10**8, np.tile(SIZE, (FRAMES, 1)), K, np.zeros((FRAMES, 4)), R, t)
    facing = np.einsum("nij,mj->nmi", R, xyz / np.linalg.norm(xyz, axis=1, keepdims=True))[..., 2] < -0.35
    v, p = np.nonzero(facing & (rng.random(facing.shape) < 0.5))
    size, uv = np.tile(SIZE, (len(v), 1)), project(K[v], views.distortion[v], R[v], t[v], xyz[p])
    seen = uv
    for _ in range(6):
        now = pose(v + readout.delays(seen, size), *shake)
        seen = project(K[v], views.distortion[v], *now, xyz[p])
    points = SparsePoints(
        np.arange(1, POINTS + 1), xyz, np.zeros((POINTS, 3), np.uint8), np.zeros(POINTS),
        v.astype(np.int32), p.astype(np.int32), uv,
    )  # fmt: skip
    return views, points, seen + noise * rng.standard_normal(seen.shape)


def model_of(views: Views, points: SparsePoints, seen: np.ndarray):
    """A COLMAP model whose features are where they were seen."""
    import pycolmap

    model = pycolmap.Reconstruction()
    model.add_camera_with_trivial_rig(
        pycolmap.Camera(
            camera_id=1, model="SIMPLE_RADIAL", width=SIZE[0], height=SIZE[1], params=[FOCAL, 200, 150, 0.0]
        )
    )
    tracks = [pycolmap.Track() for _ in points.xyz]
    for i, name in enumerate(views.names):
        own = np.flatnonzero(points.obs_view == i)
        for k, o in enumerate(own):
            tracks[points.obs_point[o]].add_element(i + 1, k)
        image = pycolmap.Image(name=name, camera_id=1, image_id=i + 1, keypoints=seen[own] + 0.5)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pycolmap.Rotation3d(views.R[i]), views.t[i]))
    for x, track in zip(points.xyz, tracks, strict=True):
        if track.length() >= 3:
            model.add_point3D(x, track)
    return model


def times_of(views: Views) -> dict[str, float]:
    return {name: float(i) for i, name in enumerate(views.names)}


@pytest.mark.parametrize("readout", [Readout(0.45), Readout(-0.3), Readout(0.4, axis=0)])
def test_a_readout_is_found_within_its_sigma_and_the_focal_length_is_mended(readout: Readout) -> None:
    from massprops.sfm.mapping import quiet
    from massprops.sfm.refine import RefineOptions
    from massprops.sfm.rolling_shutter import Settings, find_shutter

    quiet()
    views, points, seen = filmed(readout)
    model, settings = model_of(views, points, seen), Settings(RefineOptions(), True)
    bent = settings.adjusted(model_of(views, points, seen)).cameras[1].params[0]
    found, fitted = find_shutter(model, times_of(views), settings)
    assert found.state == "rolling" and found.readout is not None and found.readout.axis == readout.axis
    assert abs(found.readout.duration - readout.duration) < found.sigma < 0.1
    assert fitted is not None
    off, before = (abs(f / FOCAL - 1) for f in (fitted.views.K[0, 0, 0], bent))
    assert off < 0.003 and (readout.duration != 0.45 or off < 0.5 * before)
    assert "one after the other" in found.said() and ("columns" in found.said()) == (readout.axis == 0)
    assert not found.doubtful and 0 < found.focal_sigma_relative < abs(found.focal)
    # nothing of it is left in the features that were moved
    again, _ = find_shutter(model_of(fitted.views, fitted.points, fitted.points.obs_uv), times_of(views), settings)
    assert again.state == "global"


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_nothing_is_found_where_all_rows_are_read_at_once(seed: int) -> None:
    from massprops.sfm.mapping import quiet
    from massprops.sfm.refine import RefineOptions
    from massprops.sfm.rolling_shutter import Settings, find_shutter

    quiet()
    views, points, seen = filmed(Readout(0.0), seed=seed)
    found, fitted = find_shutter(model_of(views, points, seen), times_of(views), Settings(RefineOptions(), True))
    assert found.state == "global" and fitted is None and not found.said() and not found.focal_sigma_relative


@pytest.mark.parametrize(("shake", "state"), [((0.3, 7.0), "rolling"), ((1.0, 3.3), "suspected")])
def test_a_camera_that_shakes_faster_than_images_tell_is_suspected_only(shake: tuple[float, float], state: str) -> None:
    from massprops.sfm.mapping import quiet
    from massprops.sfm.refine import RefineOptions
    from massprops.sfm.rolling_shutter import Settings, find_shutter

    quiet()
    views, points, seen = filmed(Readout(0.5), 0.05, 0, *shake)
    found, _ = find_shutter(model_of(views, points, seen), times_of(views), Settings(RefineOptions(), True))
    assert found.state == state and found.readout is not None and found.doubtful == (state == "suspected")
    assert state == "suspected" or abs(found.readout.duration - 0.5) < 2 * found.sigma


def test_a_body_that_turns_too_far_between_images_is_not_judged() -> None:
    from massprops.sfm.mapping import quiet
    from massprops.sfm.refine import RefineOptions
    from massprops.sfm.rolling_shutter import Settings, find_shutter

    quiet()
    views, points, seen = filmed(Readout(0.45))
    times = times_of(views)
    few = np.arange(0, FRAMES, 10)
    found, _ = find_shutter(model_of(views.take(few), points.of_views(few), seen[np.isin(points.obs_view, few)]), times,
                            Settings(RefineOptions(), True))  # fmt: skip
    assert found.state == "unknown"


def test_shifts_are_those_of_the_body_in_motion() -> None:
    readout = Readout(0.45)
    views, points, seen = filmed(readout, noise=0.0)
    motion = motion_of(views, np.arange(FRAMES, dtype=float), np.zeros(3))
    assert motion.known.all()
    off = row_shifts(views, points, motion, readout, seen) - (seen - points.obs_uv)
    assert np.abs(seen - points.obs_uv).max() > 1.5 and np.abs(off).max() < 0.05


def test_neighbours_are_of_one_stream_and_near() -> None:
    views, *_ = filmed(Readout(0.0))
    times = np.arange(FRAMES, dtype=float)
    two = replace(views, names=(*views.names[:34], "cam1/a.png", "cam1/b.png"))
    assert motion_of(two, times, np.zeros(3)).known.tolist() == [True] * 34 + [False] * 2
    apart = motion_of(views.take(np.arange(0, FRAMES, 10)), times[::10], np.zeros(3))
    assert not apart.known.any() and not apart.turn.any()


def test_images_are_warped_to_what_a_global_shutter_sees(tmp_path: Path) -> None:
    import cv2

    readout = Readout(0.45)
    views, points, seen = filmed(readout, noise=0.0)
    motion = motion_of(views, np.arange(FRAMES, dtype=float), np.zeros(3))
    i = 11
    own = points.obs_view == i
    half = points.observed(points.obs_point % 2 == 0)  # the other half is not known to the map
    where = _places(grid_shifts(views, half, motion, readout, i), GRID, views.size[i])
    test = own & (points.obs_point % 2 == 1)
    at = points.obs_uv[test]
    there = cv2.remap(
        where, at[:, 0].astype(np.float32)[:, None], at[:, 1].astype(np.float32)[:, None], cv2.INTER_LINEAR
    )
    before, after = (np.linalg.norm(x - seen[test], axis=1) for x in (at, there[:, 0]))
    assert np.median(after) < 0.2 * np.median(before) and np.percentile(after, 95) < 0.3 * np.percentile(before, 95)
    # of a ramp the warped image says where each pixel came from
    ramp = np.tile(np.arange(SIZE[0], dtype=np.float32), (SIZE[1], 1))
    np.testing.assert_allclose(warped(ramp, where)[20:-20, 20:-20], where[20:-20, 20:-20, 0], atol=0.05)

    folder = tmp_path / "capture"
    disc = np.zeros(SIZE[::-1], np.uint8)
    cv2.circle(disc, (200, 150), 100, 255, -1)
    for name in views.names:
        for kind, file in (("frames", name), ("masks", f"{name}.png")):
            (folder / kind / "cam0").mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(folder / kind / file), ramp.astype(np.uint8) if kind == "frames" else disc)
    seen_model = Seen(views, list(range(FRAMES)), points, seen, motion)
    assert np.abs(residuals(views, points)).max() < 1e-9
    write_global(_footage(folder, views), seen_model, readout, tmp_path / "sfm")
    assert frames_folder(tmp_path) == tmp_path / "sfm" / "frames"
    assert frame_file(tmp_path, views.names[3]).parts[-4:-2] == ("sfm", "frames")
    assert frame_file(tmp_path, "cam0/other.png").parts[-4:-2] == ("capture", "frames")
    # a silhouette goes back to where it came from, and one of an image that was not placed stays
    mask = np.asarray(cv2.imread(str(mask_file(tmp_path, views.names[i])), 0))
    back = as_read(mask, tmp_path / "sfm" / SHIFTS, views.names[i])
    assert set(np.unique(back)) == {0, 255} and (mask != disc).sum() > 100
    assert (back != disc).sum() < 0.25 * (mask != disc).sum()
    assert as_read(disc, tmp_path / "sfm" / SHIFTS, "cam0/other.png") is disc
    assert as_read(disc, tmp_path / "capture" / SHIFTS, views.names[i]) is disc


def _footage(folder: Path, views: Views) -> FootageRecord:
    frames = tuple(
        FrameRecord(n, 0, int(s), i) for i, (n, s) in enumerate(zip(views.names, views.timestamp_ns, strict=True))
    )
    camera = CameraRecord(0, SIZE, None, None, None, None, "none", "")
    return FootageRecord(folder, "", "video", "tumbling", "black", True, (camera,), frames)


def test_times_are_frames_of_the_source_and_photographs_have_none() -> None:
    from massprops.sfm.rolling_shutter import frame_times

    views, *_ = filmed(Readout(0.0))
    video = _footage(Path(), views)
    thinned = replace(video, frames=tuple(replace(f, index=3 * f.index) for f in video.frames))
    times = frame_times(thinned)
    assert times is not None
    assert np.diff(list(times.values())) == pytest.approx(3.0)
    untimed = replace(video, frames=tuple(replace(f, timestamp_ns=-1) for f in thinned.frames))
    assert frame_times(untimed) == {f.name: float(f.index) for f in untimed.frames}
    assert frame_times(replace(video, kind="images")) is None


def test_a_mapped_model_and_its_images_are_corrected_together(tmp_path: Path) -> None:
    from types import SimpleNamespace

    import cv2

    from massprops.sfm.convert import to_points, to_views
    from massprops.sfm.global_shutter import to_global_shutter
    from massprops.sfm.mapping import quiet

    quiet()
    readout = Readout(0.45)
    views, points, seen = filmed(readout)
    for name in views.names:
        (tmp_path / "frames" / "cam0").mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(tmp_path / "frames" / name), np.zeros(SIZE[::-1], np.uint8))
    model, known = model_of(views, points, seen), np.arange(FRAMES - 2)
    part = points.of_views(known)
    motion = motion_of(views.take(known), known.astype(float), np.zeros(3))
    given = SimpleNamespace(
        found=SimpleNamespace(mapping=SimpleNamespace(fixed_intrinsics=False, constant=frozenset())),
        footage=_footage(tmp_path, views),
        options=SimpleNamespace(threads=1),
        work=tmp_path / "work",
    )
    corrected = to_global_shutter(
        model, Seen(views.take(known), known.tolist(), part, part.obs_uv, motion), readout, given
    )
    assert model.num_reg_images() == len(known)  # the motion of the last two is not known
    assert sorted(p.name for p in (corrected.folder / "frames" / "cam0").iterdir()) == [n[5:] for n in views.names[:-2]]
    found = to_points(model, to_views(model)[1])
    row = np.flatnonzero(np.bincount(points.obs_point) >= 3)  # COLMAP numbers what it was given from 1
    at = {
        (v, p): uv for v, p, uv in zip(points.obs_view.tolist(), points.obs_point.tolist(), points.obs_uv, strict=True)
    }
    there = np.array([at[v, row[found.id[p] - 1]] for v, p in zip(found.obs_view, found.obs_point, strict=True)])
    assert len(there) > 0.9 * len(part.obs_uv) and np.median(np.linalg.norm(found.obs_uv - there, axis=1)) < 0.15
    assert np.median(np.linalg.norm(seen - points.obs_uv, axis=1)) > 0.4


def test_what_the_shutter_leaves_unknown_widens_the_focal_length() -> None:
    from massprops.sfm.rolling_shutter import Shutter

    corrected = Shutter("rolling", Readout(0.4), 0.05, 1.2, -0.04, (0.11, 0.10))
    assert corrected.focal_sigma_relative == pytest.approx(0.04 * 0.05 / 0.4) and not corrected.doubtful
    for doubtful in (replace(corrected, state="suspected"), replace(corrected, remains=True)):
        assert doubtful.doubtful and doubtful.focal_sigma_relative == pytest.approx(0.04)
    assert "too unsure to be corrected" in replace(corrected, state="suspected").said()
    assert "not all of it is gone" in replace(corrected, remains=True).said()
    assert Shutter("global", Readout(0.01), 0.05, focal=-0.04).focal_sigma_relative == 0.0


def test_a_correction_that_tears_the_model_apart_is_not_made(monkeypatch: pytest.MonkeyPatch) -> None:
    from massprops.errors import NotPossible
    from massprops.sfm import last_adjustment as sfm
    from massprops.sfm.precision import Precision
    from massprops.sfm.rolling_shutter import Shutter

    def torn(*_: object) -> None:
        raise NotPossible("nothing holds")

    found = Shutter("rolling", Readout(0.4), 0.05, 1.2, -0.04, (0.11, 0.10))
    precision = Precision(0.1, 0.002, 0.0, np.full(3, 1e-3), 0.001, {1: 0.002})
    result = sfm.SfmResult(None, None, None, (), precision, (), (), shutter=found, seen=object())
    monkeypatch.setattr(sfm, "to_global_shutter", torn)
    left = sfm.with_shutter(sfm.corrected_by_shutter(result, None, None, (), []))
    assert left.shutter.state == "suspected" and left.corrected is None
    assert left.precision.focal_relative == pytest.approx(np.hypot(0.002, 0.04))
    assert left.precision.focal_by_camera == {1: left.precision.focal_relative}
    assert left.warnings == (left.shutter.said(),)
