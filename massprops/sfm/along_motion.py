"""A body of repeating cells placed by its free motion: the sides that share next to no points are held together by it.

The attitudes that were found tell the motion (`massprops.sfm.free_motion`), stretches between gaps each by their own axes, since it
is at gaps that they jump. Where the longest stretch is no free motion, its longest run that is one tells it
(`massprops.sfm.free_run`). At the places that the motion predicts all features are matched anew, and motion and points are adjusted
together (`massprops.sfm.free_adjustment`): first in the images that were placed, then farther out, as a motion is known about its own
images, and twice more in all that it reached. On crinkled foil the images of a bright side match each other falsely, and so the rest of
such a film is placed too.

Whether the body moves so is tested: images that follow their own poses must not fit their observations much better. Where they do,
the motion may be a wrong one, found from a side that lay askew: it is looked for once more from these poses. A camera that
shakes, a thruster, a hand that turns the body are then left to their own poses.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pycolmap

from massprops.errors import NotPossible
from massprops.geometry.vectors import turns_apart
from massprops.sfm.at_outlines import drop_outline_points
from massprops.sfm.attempt import FEWEST, ModelInputs
from massprops.sfm.convert import take_out_images, to_points, to_views
from massprops.sfm.database import image_numbers
from massprops.sfm.distinct import unit
from massprops.sfm.footage import FootageRecord
from massprops.sfm.free_adjustment import (
    LINE,
    MOTION,
    Tumble,
    adjust_tumble,
    cauchy_cost,
    fit_line,
    hold_to_tumble,
)
from massprops.sfm.free_motion import Piece, Rotation, fit_centres, fit_rotation
from massprops.sfm.free_run import longest_free_run
from massprops.sfm.guided import Gate, Placed, match_placed, place
from massprops.sfm.lens import LensChoice
from massprops.sfm.loops import NEXT, forget, pairs_to_compare
from massprops.sfm.mapping import retriangulate, verify
from massprops.sfm.motion_precision import tumble_precision
from massprops.sfm.points import SparsePoints
from massprops.sfm.precision import Precision
from massprops.sfm.refine import Effort, Refined, RefineOptions, adjust, honest, remove_outliers, robust_loss
from massprops.sfm.sound import take_out
from massprops.views import Views

GATES = (Gate(0.022, 0.022), Gate(0.0125, 0.006), Gate(0.0125, 0.006))
"""As those of `massprops.sfm.loops`: sides that drifted apart come together in the first round, and are matched in the next."""

CUTS = (4.0, 2.0, 1.0)
"""How near observations must fit as a round's adjustment goes on [px], at least."""

PASSES = 4
"""Times at most that all images are matched anew by each of these gates, until the motion moves nothing by more than the last of `CUTS`.
Of four bodies in foil (Blender) the first pass left attitudes off by up to 1.6 to 10 degrees, three further ones by .5 to 1.6."""

NEAR = 0.25
"""How far a motion leads at a time, in numbers of the images that it was found through. Of a body in foil 39 images told it to 0.7 degrees
four images on, 1.2 after ten, 4 after twenty and 20 after 46, where gates of the first round are some degrees wide. Across 11 images in the
Earth's shadow 22 images told it well enough for the next 11 to be placed."""

MOST_RMS_DEG = 1.0
"""As that of `massprops.sfm.joined_pieces`."""

GAP = 1.5
"""Steps between images from which on the turn across may be anything."""

FOCAL_BY_ALL = 0.02
"""Standard deviation, relative, that is stated of a focal length by all features, and from which on it is taken in place of that by those within
the outline. Of a body in foil (Blender) that of all was .9 % off, that of the others 9 % by a stated 6 %; of two more all were within .3 %."""

WORSE = 4.0
"""How much more the observations may gain by the images' own poses, as the robust loss counts, than independent errors would by so
many numbers. On a path-traced CubeSat 1.8 (errors of a track are alike); with its clock bent so that the middle of the film is half
a frame off 3, by 2 frames 9."""

CONVINCES = 2.0
"""Gain of the images' own poses (`WORSE`) up to which a motion is taken without another start. Of four bodies in foil
motions within 1.5 degrees gained 1.4 to 1.6 and once 2.8, one that was off by 6 degrees 2.1 to 2.8."""

STARTS = 3
"""Times that a motion is looked for. On a path-traced CubeSat that shows two sides without a feature in common the first was off by
4 degrees (4.7 by `WORSE`), the second by 0.3 (1.5)."""

NEARER = 0.9
"""Least change of that gain by which a further start is worth its time: a body that a torque brakes stays where it is (27.6, 27.5)."""


@dataclass(frozen=True)
class Following:
    """A motion, the time of each image by name, the footage, and what the images gain by poses of their own (`WORSE`)."""

    tumble: Tumble
    clock: Callable[[str], float]
    footage: FootageRecord
    gain: float


def follow_free_motion(
    model: pycolmap.Reconstruction, given: ModelInputs
) -> tuple[pycolmap.Reconstruction, Following] | None:
    """The images placed by one free motion, and that motion; None where the body does not move so, or no such motion is found."""
    clock, worst = given.footage.times.__getitem__, np.inf
    try:
        for k in range(STARTS):
            followed = _followed(model, clock, replace(given, work=given.work / f"start{k}"))
            if followed is None:
                return None
            model, tumble = followed
            free_model, worse = _own_poses(model, tumble, clock, given)
            if worse < WORSE:
                return model, Following(tumble, clock, given.footage, worse)
            if not worse < NEARER * worst:
                return None
            model, worst = free_model, worse
    except NotPossible:
        pass
    return None


def _followed(
    model: pycolmap.Reconstruction, clock: Callable[[str], float], given: ModelInputs
) -> tuple[pycolmap.Reconstruction, Tumble] | None:
    """The images placed by the free motion that is nearest to their poses, and that motion; None where there is none.

    Raises:
        NotPossible: too little is left.
    """
    start = _first(model, clock)
    if start is None:
        model = _free_part(model, clock)
        start = _first(model, clock)
    if start is None:
        return None
    # depths of what a stretch did not see are known in the next round
    reached, more, rounds = set[str](), set(start.scale), 0
    while more - reached:
        reached, rounds = reached | more, rounds + 1
        model, start = _round(model, start, reached, GATES[0], replace(given, work=given.work / f"near{rounds}"), clock)
        more = _near(model, given)
    times = np.array([clock(f.name) for f in given.footage.frames if f.name in reached])
    for number in range(PASSES):
        before = start.tumble
        for turn, gate in enumerate(GATES[number == 0 :]):
            work = given.work / f"pass{number}" / f"motion{turn}"
            model, start = _round(model, start, reached, gate, replace(given, work=work), clock)
        if _moved_px(model, before, start.tumble, times) < CUTS[-1]:
            break
    return model, start.tumble


def match_along(
    model: pycolmap.Reconstruction, following: Following, given: ModelInputs
) -> tuple[pycolmap.Reconstruction, Following]:
    """The images of a model matched anew, by the features of `given`, where their motion predicts them, and the motion adjusted to that.

    Raises:
        NotPossible: too little is left.
    """
    clock, start = following.clock, _Start(following.tumble, {})
    names = {model.image(i).name for i in model.reg_image_ids()}
    for turn, gate in enumerate(GATES[1:]):
        model, start = _round(model, start, names, gate, replace(given, work=given.work / f"motion{turn}"), clock)
    return model, replace(following, tumble=start.tumble, gain=_own_poses(model, start.tumble, clock, given)[1])


def _moved_px(model: pycolmap.Reconstruction, before: Tumble, after: Tumble, times: np.ndarray) -> float:
    """How far the outer parts of a body move in any image from one motion to another, whose axes in the body are free [px]."""
    views, ids = to_views(model)
    R, t = after.poses(times)
    largest = float(turns_apart(R, before.turning.attitudes(times)[0]).max())
    depth = float(np.median((R @ after.centre + t)[:, 2]))
    return largest * views.K[0, 0, 0] * _radius(to_points(model, ids)) / depth


def _near(model: pycolmap.Reconstruction, given: ModelInputs) -> set[str]:
    """Names of the images to which the motion through the placed ones leads: no farther from them than by `NEAR` of their number, but for
    those that show nothing."""
    order = given.images_with_features
    there = {model.image(i).name for i in model.reg_image_ids()}
    placed = np.array([k for k, n in enumerate(order) if n in there])
    reach = int(NEAR * len(placed)) + 1
    return {n for k, n in enumerate(order) if len(placed) and np.abs(placed - k).min() <= reach}


def _round(
    model: pycolmap.Reconstruction,
    start: _Start,
    names: set[str],
    gate: Gate,
    given: ModelInputs,
    clock: Callable[[str], float],
) -> tuple[pycolmap.Reconstruction, _Start]:
    """The images `names` matched anew where the motion predicts them, and adjusted together with it.

    Raises:
        NotPossible: too little is left.
    """
    options, free_focal = given.options.refine, not given.found.mapping.fixed_intrinsics
    model = _matched(model, start, names, gate, given, clock)
    return model, _Start(_adjusted(model, start.tumble, clock, options, free_focal, CUTS)[0], {})


def refine_along(
    model: pycolmap.Reconstruction, following: Following, options: RefineOptions, free_focal: bool
) -> Refined:
    """The last adjustment, in place, by a motion. It is adjusted to what does not lie at outlines; images that show little else get their
    poses from it all the same. Where that hardly tells the focal length, it stays as all features had it.

    Raises:
        NotPossible: too little is left.
    """
    clock, inner = following.clock, pycolmap.Reconstruction(model)
    drop_outline_points(inner, following.footage)
    by_all = pycolmap.Reconstruction(inner)

    def stated(names: Sequence[str]) -> Precision:
        return honest(tumble_precision(inner, tumble, clock, loss, free_focal, names), options.on_table)

    rounds = (None,) * options.rounds
    tumble, loss = _adjusted(inner, following.tumble, clock, options, free_focal, rounds)
    held = stated(to_views(inner)[0].names).focal_relative > FOCAL_BY_ALL
    if held:
        inner = by_all
        tumble, loss = _adjusted(inner, following.tumble, clock, options, False, rounds)
    for camera_id, camera in inner.cameras.items():
        model.cameras[camera_id].params = camera.params
    for _ in range(options.rounds):
        hold_to_tumble(model, tumble, clock, loss)
        remove_outliers(model, options)
        take_out(model, options.given_focal)
    hold_to_tumble(model, tumble, clock, loss)
    model.update_point_3d_errors()
    precision = stated(to_views(model)[0].names)
    if held:
        by_camera = dict.fromkeys(precision.focal_by_camera, FOCAL_BY_ALL)
        precision = replace(precision, focal_relative=FOCAL_BY_ALL, focal_by_camera=by_camera)
    return Refined(precision, dict[int, LensChoice]())


def _adjusted(
    model: pycolmap.Reconstruction,
    tumble: Tumble,
    clock: Callable[[str], float],
    options: RefineOptions,
    free_focal: bool,
    cuts: Sequence[float | None],
) -> tuple[Tumble, float]:
    """A model adjusted in place together with its motion: that, and the scale of the loss [px].

    Args:
        cuts: of each adjustment, as `remove_outliers` takes it.
    """
    for cut in cuts:
        loss = remove_outliers(model, options, cut)
        take_out(model, options.given_focal)
        tumble = adjust_tumble(model, tumble, clock, loss, free_focal)
    return tumble, loss


@dataclass(frozen=True)
class _Start:
    """A motion, and how much larger depths are in its frame than in the model, by image."""

    tumble: Tumble
    scale: dict[str, float]


def _first(model: pycolmap.Reconstruction, clock: Callable[[str], float]) -> _Start | None:
    """The motion through a model's own poses, in the axes of its longest stretch; None where there is none."""
    views, ids = to_views(model)
    points = to_points(model, ids)
    middle = np.median(points.xyz, axis=0)
    time = np.array([clock(n) for n in views.names])
    parts = _stretches(time)
    if not parts:
        return None
    pieces = [Piece(time[stretch], views.R[stretch], views.t[stretch] + views.R[stretch] @ middle) for stretch in parts]
    rotation = _turning(pieces)
    if not rotation.rms < np.deg2rad(MOST_RMS_DEG):
        return None
    slimness = _radius(points) / float(np.median(pieces[0].t[:, 2]))
    centres = fit_centres(pieces, rotation, slimness)
    if not np.all(centres.scale > 0):
        return None
    at, scale = [], dict[str, float]()
    for stretch, piece, size, C, shift in zip(parts, pieces, centres.scale, rotation.C, centres.shift, strict=True):
        centre = C.T @ (centres.centre - shift) / size
        at.append(size * (piece.R @ centre + piece.t))
        scale |= dict.fromkeys((views.names[i] for i in stretch), float(size))
    used = time[np.concatenate(parts)]
    shifts = np.concatenate(at) - rotation.motion.attitudes(used)[0] @ centres.centre
    return _Start(fit_line(rotation.motion, used, shifts, slimness), scale)


def strays(views: Views, clock: Callable[[str], float]) -> float:
    """How far one camera's attitudes lie from one free motion [rad], as the median says; 0 of too few."""
    time = np.array([clock(n) for n in views.names])
    parts = _stretches(time)
    if not parts:
        return 0.0
    # stretches that share no point may lie askew to each other, so each is asked in the axes of all
    pieces = [Piece(time[stretch], views.R[stretch], views.t[stretch]) for stretch in parts]
    order = np.argsort(time)
    whole = Piece(time[order], views.R[order], views.t[order])
    return fit_rotation([whole], robust=True, about=_turning(pieces).motion).rms


def _turning(pieces: Sequence[Piece]) -> Rotation:
    """The free rotation through the attitudes of stretches, the longest first, each in axes of its own."""
    # across a gap the rates may be far from straight: the longest stretch tells the motion, and the others about that
    rotation = fit_rotation(pieces[:1], robust=True)
    return fit_rotation(pieces, robust=True, about=rotation.motion)


def _stretches(time: np.ndarray) -> list[np.ndarray]:
    """Numbers of the images of `time` (n,) without a gap between them, in their order, the longest stretch first."""
    order = np.argsort(time)
    if len(order) < FEWEST:
        return []
    cut = np.flatnonzero(np.diff(time[order]) > GAP * np.median(np.diff(time[order]))) + 1
    return sorted((own for own in np.split(order, cut) if len(own) >= FEWEST), key=lambda own: -len(own))


def _free_part(model: pycolmap.Reconstruction, clock: Callable[[str], float]) -> pycolmap.Reconstruction:
    """The model with the longest run of its images that follow one free motion, whatever its gaps; without any where there is none."""
    views, ids = to_views(model)
    time = np.array([clock(n) for n in views.names])
    order = np.argsort(time)
    run = longest_free_run(Piece(time[order], views.R[order], views.t[order]), np.deg2rad(MOST_RMS_DEG))
    out = pycolmap.Reconstruction(model)
    take_out_images(out, set(ids) - {ids[i] for i in order[run]})
    return out


def _radius(points: SparsePoints) -> float:
    return float(np.quantile(np.linalg.norm(points.xyz - np.median(points.xyz, axis=0), axis=1), 0.9))


def _matched(
    model: pycolmap.Reconstruction,
    start: _Start,
    chosen: set[str],
    gate: Gate,
    given: ModelInputs,
    clock: Callable[[str], float],
) -> pycolmap.Reconstruction:
    """The model at the poses of the motion, with tracks from matches where these predict them."""
    attempt = given.found
    views, ids = to_views(model)
    points = to_points(model, ids)
    names = [f.name for f in given.footage.frames if f.name in attempt.features and f.name in chosen]
    R, t = start.tumble.poses(np.array([clock(n) for n in names]))
    moved = replace(views.take(np.zeros(len(names), int)), names=tuple(names), R=R, t=t)
    placed = _depths(views, points, moved, start, given)
    units = {n: unit(attempt.features[n][1]) for n in names}
    row = {n: k for k, n in enumerate(names)}
    middle = replace(points, xyz=start.tumble.centre[None])
    matches = {
        (a, b): match_placed(moved, (row[a], row[b]), (placed[a], placed[b]), (units[a], units[b]), gate)
        for a, b in pairs_to_compare(moved, middle, given.footage, given.options, NEXT + 1)
    }
    number = image_numbers(attempt.database)
    forget(attempt.database, list(number.values()), set(number.values()))
    verify(attempt.database, number, matches, attempt.mapping)
    out = pycolmap.Reconstruction()
    camera_id = model.image(ids[0]).camera_id
    out.add_camera_with_trivial_rig(model.camera(camera_id))
    for name, turned, shift in zip(names, R, t, strict=True):
        places = attempt.features[name][0][:, :2].astype(float)
        image = pycolmap.Image(name=name, camera_id=camera_id, image_id=number[name], keypoints=places)
        out.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pycolmap.Rotation3d(turned), shift))
    return retriangulate(out, attempt.database, given.frames, given.work, attempt.mapping)


def _depths(views: Views, points: SparsePoints, moved: Views, start: _Start, given: ModelInputs) -> dict[str, Placed]:
    """Rays and depths of all features of the images of `moved`; those that were not placed borrow from what others saw, and where
    none saw that side, all of the body's depth is open."""
    out = {}
    row = {n: i for i, n in enumerate(views.names)}
    reach = _radius(points) * np.array([-1.0, 1.0])
    for k, name in enumerate(moved.names):
        uv = given.found.features[name][0][:, :2] - 0.5
        if name in row:
            placed = place(views, points, row[name], uv)
            out[name] = replace(placed, depth=start.scale.get(name, 1.0) * placed.depth)
        else:
            both = Views.joined([views, moved.take(np.array([k]))])
            lent = place(both, points, len(views), uv, lent=True)
            z = float(moved.R[k][2] @ start.tumble.centre + moved.t[k][2])
            unknown = ~np.isfinite(lent.depth).all(1, keepdims=True)
            out[name] = replace(lent, depth=np.where(unknown, z + reach, lent.depth))
    return out


def _own_poses(
    model: pycolmap.Reconstruction, tumble: Tumble, clock: Callable[[str], float], given: ModelInputs
) -> tuple[pycolmap.Reconstruction, float]:
    """The images at poses of their own, and what these gain.

    The gain is how much better the observations fit than by the motion, over what so many more numbers would gain by fitting errors
    alone. Observations that nothing fits within some pixels hardly count.
    """
    mapping, free_focal = given.found.mapping, not given.found.mapping.fixed_intrinsics
    both = [pycolmap.Reconstruction(model), pycolmap.Reconstruction(model)]
    loss = robust_loss(model, given.options.refine)
    adjust_tumble(both[0], tumble, clock, loss, free_focal)
    adjust(both[1], free_focal, False, loss, mapping.threads, Effort(60), mapping.constant)
    bound, unbound = (_cost(m, loss) for m in both)
    poses = 6 * model.num_reg_images()
    degrees_of_freedom = 2 * model.compute_num_observations() - 3 * model.num_points3D() - poses
    gain = (bound / unbound - 1) * degrees_of_freedom / (poses - MOTION - LINE) if degrees_of_freedom > 0 else np.inf
    return both[1], gain


def _cost(model: pycolmap.Reconstruction, loss_px: float) -> float:
    views, ids = to_views(model)
    return cauchy_cost(views, to_points(model, ids), loss_px)
