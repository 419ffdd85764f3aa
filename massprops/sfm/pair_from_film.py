"""A pair of cameras placed by the film of its first one.

Much can be asked of one camera's film alone: from where the mapper begins, whether its motion jumps, which free motion leads on
(`massprops.sfm.grown_film`, `massprops.sfm.film_starts`). A pair of which images are left out, or whose attitudes stray from any free
motion, is placed as that film is. The mounting then places the second camera, and features that both show at one moment tell how large
the film's unit is.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pycolmap

from massprops.errors import NotPossible
from massprops.sfm.convert import HALF, opencv_camera, to_points, to_views
from massprops.sfm.database import image_numbers, rig_pose
from massprops.sfm.film_starts import MappedFootage
from massprops.sfm.footage import FootageRecord, FrameRecord
from massprops.sfm.guided import rays
from massprops.sfm.loops import close_loops, match_predicted
from massprops.sfm.mapping import retriangulate

FEWEST = 30
"""Points that a second camera must show at their moment for the unit of a film to be told."""

SAME_PX = 0.5
"""Distance between two places that are one feature's [px]."""


def film_of_first(footage: FootageRecord) -> FootageRecord:
    """The film of a pair's first camera."""
    first = footage.cameras[0]
    frames = tuple(f for f in footage.frames if f.camera == first.id)
    return replace(footage, kind="sequence", cameras=(first,), frames=frames)


def asks_for_film(pair: MappedFootage) -> bool:
    """Whether a flying body's pair does not convince: it leaves images out, its matches contradict it, or it strays from a free motion."""
    footage = pair.given.footage
    flies = footage.rig and footage.motion == "tumbling" and footage.background == "black"
    return flies and not pair.convinces


def by_film(pair: MappedFootage, film: MappedFootage) -> MappedFootage:
    """A pair's images as its first camera's film places them, where that convinces or places more moments; else as they are.

    Raises:
        NotPossible: the second camera shows too few of the film's points.
    """
    if not film.convinces and film.model.num_reg_frames() <= pair.model.num_reg_frames():
        return pair.doubted() if film.unsure and not pair.convinces else pair
    given = replace(pair.given, work=pair.given.work / "by_film")
    model, found = _with_other_cameras(film.model, pair), given.found
    model = retriangulate(model, found.database, given.frames, given.work / "first", found.mapping)
    model = match_predicted(model, given, given.work) if found.special else close_loops(model, given)
    return MappedFootage(model, given, pair.first, film.warnings, film.unsure)


def _with_other_cameras(film: pycolmap.Reconstruction, pair: MappedFootage) -> pycolmap.Reconstruction:
    """All images of the moments that a film has placed, without points, in metres."""
    unit, features = _metres_per_unit(film, pair), pair.given.found.features
    views, ids = to_views(film)
    row = {name: i for i, name in enumerate(views.names)}
    out = pycolmap.Reconstruction()
    for camera in pair.model.cameras.values():
        out.add_camera(film.camera(camera.camera_id) if film.exists_camera(camera.camera_id) else camera)
    with pycolmap.Database.open(pair.given.found.database) as db:
        for rig in db.read_all_rigs():
            out.add_rig(rig)
        images = {image.image_id: image for image in db.read_all_images()}
        for frame in db.read_all_frames():
            taken = [images[data.id] for data in frame.data_ids]
            placed = next((row[image.name] for image in taken if image.name in row), None)
            if placed is None:
                continue
            pose = np.column_stack([views.R[placed], unit * views.t[placed]])
            frame.rig_from_world = pycolmap.Rigid3d(pose)
            out.add_frame(frame)
            for image in taken:
                places = features[image.name][0][:, :2].astype(float)
                new = pycolmap.Image(
                    name=image.name, camera_id=image.camera_id, image_id=image.image_id, keypoints=places
                )
                new.frame_id = frame.frame_id
                out.add_image(new)
            out.register_frame(frame.frame_id)
    return out


def _metres_per_unit(film: pycolmap.Reconstruction, pair: MappedFootage) -> float:
    """How long a film's unit is: that by which its points fall where the other cameras show them.

    Raises:
        NotPossible: these show too few of them.
    """
    each = np.concatenate([np.zeros(0), *(_units(*both) for both in _seen_by_two(film, pair))])
    each = each[np.isfinite(each)]
    if len(each) < FEWEST:
        raise NotPossible("the second camera shows too few features of the first one's film")
    return float(np.median(each))


def _seen_by_two(
    film: pycolmap.Reconstruction, pair: MappedFootage
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Of each image of a film and another camera's of that moment the points that both show: (k, 3) in the first camera, in the film's
    unit, (k, 3) rays in the other, and (4, 4) that takes the first camera to the other [m]."""
    from scipy.spatial import cKDTree

    footage, found = pair.given.footage, pair.given.found
    mounted, numbers = rig_pose(footage.cameras), image_numbers(found.database)
    views, ids = to_views(film)
    points = to_points(film, ids)
    moments = {f.name: f.moment for f in footage.frames}
    others: dict[str, list[FrameRecord]] = {}
    for f in footage.frames:
        if f.camera != footage.cameras[0].id and f.name in numbers:
            others.setdefault(f.moment, []).append(f)
    with pycolmap.Database.open(found.database) as db:
        for i, name in enumerate(views.names):
            of_view = points.obs_view == i
            xyz = points.xyz[points.obs_point[of_view]] @ views.R[i].T + views.t[i]
            for other in others.get(moments[name], []) if len(xyz) and name in numbers else []:
                geometry = db.read_two_view_geometry(numbers[name], numbers[other.name])
                matches = np.asarray(geometry.inlier_matches, int).reshape(-1, 2)
                uv = [found.features[n][0][matches[:, k], :2] - HALF for k, n in enumerate((name, other.name))]
                far, nearest = cKDTree(points.obs_uv[of_view]).query(uv[0])
                same = far < SAME_PX
                K, distortion = opencv_camera(pair.model.camera(other.camera + 1))
                yield xyz[nearest[same]], rays(uv[1][same], K, distortion), mounted[other.camera]


def _units(xyz: np.ndarray, ray: np.ndarray, to_other: np.ndarray) -> np.ndarray:
    """(k,) metres in a unit, of points (k, 3) in a first camera, seen along rays (k, 3) by another: what is at x in the first is at
    s R x + t in the other, and the unit s is where r x (s R x + t) is least."""
    turned, shifted = np.cross(ray, xyz @ to_other[:3, :3].T), np.cross(ray, to_other[:3, 3])
    with np.errstate(all="ignore"):
        return np.asarray(-np.einsum("ki,ki->k", turned, shifted) / np.einsum("ki,ki->k", turned, turned))
