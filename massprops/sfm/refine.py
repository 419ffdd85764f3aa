"""The last adjustment: outliers out, robust loss, and the lens model that the images ask for.

On a small body in the middle of the image a radial term trades against the focal length and the distance, so that an
unneeded one costs accuracy. There a distortion is thought of only when k1 is significant beside its own standard
deviation and moves features by a visible amount; then, as for images full of features, held-out observations decide
(`massprops.sfm.lens`).
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pycolmap

from massprops.sfm.convert import take_out_images, to_points, to_views
from massprops.sfm.lens import MODELS, LensChoice, choose_lenses, k1_evidence, set_models
from massprops.sfm.points import SparsePoints, residuals
from massprops.sfm.precision import (
    Adjusted,
    Precision,
    derivatives,
    determined,
    further_parameters,
    precision,
    radial_column,
)
from massprops.sfm.sound import require_sound, take_out
from massprops.views import Views

if TYPE_CHECKING:
    from massprops.sfm.along_motion import Following


@dataclass(frozen=True)
class RefineOptions:
    """How the last adjustment is done.

    The loss follows the residuals: on simulated bodies (sun fixed, shadows crawling over them) a scale of one robust
    standard deviation left 0.07 to 0.2 % of error in the focal length, where 0.5 px left 0.3 to 0.4 % and least
    squares 0.6 %; the attitude gained as much.

    Attributes:
        rounds: adjustments, each after its outliers were removed.
        loss: scale of the Cauchy loss in robust standard deviations of the residuals.
        least_loss_px, most_loss_px: bounds of that scale [px].
        cut: observations further off than this many robust standard deviations are removed.
        least_cut_px: but never closer than this [px].
        shortest: fewest images of a track.
        least_angle_deg: tracks seen under a smaller angle are removed.
        fewest: observations that an image must keep, else it is taken out.
        loose, loose_deg: an image is taken out when its attitude's standard deviation is beyond this many medians and
            beyond this many degrees.
        significance: k1 over its standard deviation from which on it is kept.
        visible_px: movement of the outermost features from which on a distortion of one object's images is kept; of
            images full of features, half a standard deviation of their residuals is enough.
        constant: numbers of cameras whose focal length was given.
        given_focal: a focal length was given, which may be any.
        moving: what has to move, for a message.
        following: the free motion that all images were found to follow, and are held to.
        on_table: the object is no body before a black sky, whose limb bends what k1 would be: k1 is taken where it is likelier.
    """

    rounds: int = 2
    loss: float = 1.0
    least_loss_px: float = 0.1
    most_loss_px: float = 1.0
    cut: float = 4.0
    least_cut_px: float = 0.3
    shortest: int = 3
    least_angle_deg: float = 2.0
    fewest: int = 15
    loose: float = 6.0
    loose_deg: float = 0.2
    significance: float = 5.0
    visible_px: float = 0.3
    constant: frozenset[int] = frozenset()
    given_focal: bool = False
    moving: str = "the camera moves around the object"
    following: Following | None = None
    on_table: bool = False


FOCAL_INFLATION, FREE_FOCAL_INFLATION = 2.0, 3.5
"""By how much errors of the focal length exceed the covariance, of things on tables and of bodies before a black sky. Eleven films of the latter with
known truth, filmed badly (`tests/bench/poor_footage.py`, asteroid 0 and spacecraft 1), were off by 2.1 (root mean square) standard deviations, 3.1 and
4.0 where the body goes away; three path-traced ones (Blender), whose cells and foil shine, by 2.8, 6.8 and 8.3: 3.5 of all fourteen. Of 26 things on
tables (Blender) it was 0.8, and 5.5 in one more of which images were placed wrongly. With tracks alone as clusters and a factor of 2.5 the eleven
were 2.9, and up to 6.2."""

K1_INFLATION = 2.5
"""The same of k1, whose covariance has tracks alone as clusters: of 60 made-up models of eight images without distortion it was
2.7 (root mean square) standard deviations, 6.2 at most, and three take one for likelier."""

ATTITUDE_INFLATION = 3.0
"""Simulated footage with known truth: median attitude errors were 2.5 to 4 times those of the covariance with tracks as clusters."""


COMPARED, LAST, FOLLOWED = 1e-7, 1e-5, 1e-4
"""Tolerances of an adjustment that a model grows from or whose cost is compared with another's, of the last one, and of those that lead to it.
On an asteroid of 150 images, of which outliers are removed between adjustments, the first in all five took 31 s of CPU, the others 17 s. Its attitudes came out .005 degrees
from those, its focal length .004 %, where their standard deviations are .011 degrees and .14 %."""


class Effort(NamedTuple):
    """When an adjustment ends: after so many iterations, or with a step whose relative gain is below the tolerance."""

    iterations: int = 40
    tolerance: float = COMPARED


def adjust(
    model: pycolmap.Reconstruction,
    free_focal: bool,
    free_distortion: bool,
    loss_px: float | None,
    threads: int,
    effort: Effort,
    constant: frozenset[int] = frozenset(),
) -> None:
    """One global bundle adjustment in place; rigs, principal points and the cameras `constant` stay as they are."""
    o = pycolmap.BundleAdjustmentOptions()
    o.refine_focal_length = free_focal
    o.refine_extra_params = free_distortion
    o.refine_principal_point = False
    o.refine_sensor_from_rig = False
    o.print_summary = False
    if loss_px is not None:
        o.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
        o.ceres.loss_function_scale = loss_px
    o.ceres.solver_options.max_num_iterations = effort.iterations
    o.ceres.solver_options.function_tolerance = effort.tolerance
    o.ceres.solver_options.num_threads = threads
    constant &= set(model.cameras)
    if not constant:
        pycolmap.bundle_adjustment(model, o)
        return
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in sorted(model.reg_image_ids()):
        config.add_image(image_id)
    for camera_id in sorted(constant):
        config.set_constant_cam_intrinsics(camera_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    pycolmap.create_default_bundle_adjuster(o, config, model).solve()


def robust_sigma(distance: np.ndarray) -> float:
    """Standard deviation of one coordinate from residual lengths (k,) [px]: a Rayleigh median is 1.177 of it."""
    return float(np.median(distance)) / 1.177 if len(distance) else 1.0


def remove_outliers(model: pycolmap.Reconstruction, options: RefineOptions, least_cut_px: float | None = None) -> float:
    """Removes observations and tracks that do not fit; gives the scale for the next adjustment's loss [px].

    What cannot be computed with goes first (`massprops.sfm.sound`).

    The bound follows the residuals themselves. Tracks of shadow edges,
    which crawl over a turning body, are short, and leave by length or by their residuals.

    Raises:
        NotPossible: too little is left.
    """
    views, points, soundness = take_out(model, options.given_focal)
    require_sound(soundness, options.moving)
    sigma = robust_sigma(np.linalg.norm(residuals(views, points.observed(soundness.observations)), axis=1))
    bound = float(np.clip(options.cut * sigma, least_cut_px or options.least_cut_px, 4.0))
    manager = pycolmap.ObservationManager(model)
    manager.filter_all_points3D(bound, options.least_angle_deg)
    manager.filter_points3D_with_short_tracks(options.shortest)
    return _loss(sigma, options)


@dataclass(frozen=True)
class Refined:
    """What the last adjustment came to: its precision, and the lens model of every camera number."""

    precision: Precision
    lenses: dict[int, LensChoice]

    @property
    def bent(self) -> bool:
        """Whether any distortion is estimated."""
        return any(c.bent for c in self.lenses.values())

    @property
    def radial_terms(self) -> dict[int, int]:
        """Estimated radial terms by camera number."""
        return {c: lens.radial_terms for c, lens in self.lenses.items()}


def refine(
    model: pycolmap.Reconstruction,
    options: RefineOptions,
    free_focal: bool,
    test_distortion: bool,
    threads: int,
    small: bool = True,
    seed: int = 0,
) -> Refined:
    """Adjusts in place.

    Args:
        test_distortion: whether the lens is unknown.
        small: the features are on one object, which may fill little of the images.
        seed: of the observations held out.

    Raises:
        NotPossible: the images do not hold together.
    """

    def again(free_distortion: bool, iterations: int = 40, tolerance: float = FOLLOWED) -> None:
        adjust(model, free_focal, free_distortion, loss, threads, Effort(iterations, tolerance), options.constant)

    # wide at first: an image whose pose is still poor must not lose the observations that would mend it
    loss = remove_outliers(model, options, 2.0)
    again(False, 20)
    lenses: dict[int, LensChoice] = {}
    if test_distortion and not small:
        # before the corners' observations go as outliers of a lens too simple
        lenses = _lenses(model, options, free_focal, threads, seed, 0.5 * loss)
        _take(model, lenses)
        again(_bent(lenses), 20)
    loss = remove_outliers(model, options, 1.0)
    for _ in range(options.rounds - 1):
        again(_bent(lenses))
        loss = remove_outliers(model, options)
    if test_distortion and small and _shows_distortion(model, options, free_focal, loss, threads):
        lenses = _lenses(model, options, free_focal, threads, seed, options.visible_px)
        _take(model, lenses)
        if _bent(lenses):
            again(True)
            loss = remove_outliers(model, options)
    if test_distortion and (options.on_table or not small) and not _bent(lenses):
        lenses = _likelier_bent(model, lenses, options, free_focal, loss, threads)
        if _bent(lenses):
            _take(model, lenses)
            again(True)
            loss = remove_outliers(model, options)
    again(_bent(lenses), tolerance=LAST)
    _drop_weak(model, options)
    require_sound(take_out(model, options.given_focal)[2], options.moving)
    model.update_point_3d_errors()
    terms = {c: lens.radial_terms for c, lens in lenses.items()}
    refined = Refined(model_precision(model, free_focal, terms, loss, options.constant), lenses)
    if _drop_loose(model, to_views(model)[1], refined.precision.attitude, options):
        require_sound(take_out(model, options.given_focal)[2], options.moving)
        model.update_point_3d_errors()
        refined = replace(refined, precision=model_precision(model, free_focal, terms, loss, options.constant))
    return replace(refined, precision=honest(refined.precision, options.on_table))


def _bent(lenses: dict[int, LensChoice]) -> bool:
    return any(c.bent for c in lenses.values())


def _lenses(
    model: pycolmap.Reconstruction,
    options: RefineOptions,
    free_focal: bool,
    threads: int,
    seed: int,
    visible_px: float,
) -> dict[int, LensChoice]:
    loss = robust_loss(model, options)

    def fit(trial: pycolmap.Reconstruction) -> None:
        adjust(trial, free_focal, True, loss, threads, Effort(20), options.constant)

    return choose_lenses(model, fit, loss, visible_px, seed)


def _take(model: pycolmap.Reconstruction, lenses: dict[int, LensChoice]) -> None:
    """Changes the cameras; where none is bent they keep COLMAP's simplest model with k1 = 0, which stays fixed."""
    if _bent(lenses):
        set_models(model, {c: lens.model for c, lens in lenses.items()})
    else:
        set_models(model, dict.fromkeys(lenses, "SIMPLE_PINHOLE"))
        set_models(model, dict.fromkeys(lenses, "SIMPLE_RADIAL"))


def robust_loss(model: pycolmap.Reconstruction, options: RefineOptions) -> float:
    """Scale of the next adjustment's loss [px], from the residuals."""
    return _loss(_residual_sigma(model), options)


def _residual_sigma(model: pycolmap.Reconstruction) -> float:
    views, ids = to_views(model)
    return robust_sigma(np.linalg.norm(residuals(views, to_points(model, ids)), axis=1))


def _loss(sigma: float, options: RefineOptions) -> float:
    return float(np.clip(options.loss * sigma, options.least_loss_px, options.most_loss_px))


def model_precision(
    model: pycolmap.Reconstruction,
    free_focal: bool,
    radial_terms: int | dict[int, int],
    loss: float,
    constant: frozenset[int] = frozenset(),
) -> Precision:
    """Precision of an adjusted model, by its residuals alone (`honest`)."""
    views, ids = to_views(model)
    camera = np.array([model.image(i).camera_id for i in ids], int)
    return precision(views, to_points(model, ids), free_focal, radial_terms, loss, camera, constant)


def honest(raw: Precision, on_table: bool = False) -> Precision:
    """The same as stated to the user, with what errors were beyond it; on_table: as of `RefineOptions`."""
    focal = FOCAL_INFLATION if on_table else FREE_FOCAL_INFLATION
    return replace(
        raw,
        focal_relative=focal * raw.focal_relative,
        focal_by_camera={c: focal * s for c, s in raw.focal_by_camera.items()},
        attitude=ATTITUDE_INFLATION * raw.attitude,
        shown=raw.shown and replace(raw.shown, covariance=ATTITUDE_INFLATION**2 * raw.shown.covariance),
    )


def _drop_weak(model: pycolmap.Reconstruction, options: RefineOptions) -> None:
    """Takes out images that hold on to the body by too few points, such as a panel seen edge-on."""
    manager = pycolmap.ObservationManager(model)
    for frame_id in list(model.reg_frame_ids()):
        held = sum(model.image(i.id).num_points3D for i in model.frame(frame_id).image_ids)
        if held < options.fewest:
            manager.deregister_frame(frame_id)


def _drop_loose(model: pycolmap.Reconstruction, ids: list[int], attitude: np.ndarray, options: RefineOptions) -> bool:
    """Takes out images whose attitude is far less certain than the others': few points, perhaps the wrong ones."""
    if not np.all(np.isfinite(attitude)):
        return False
    bound = max(options.loose * float(np.median(attitude)), np.deg2rad(options.loose_deg))
    loose = [i for i, s in zip(ids, attitude, strict=True) if bound < s]
    if len(ids) - len({model.image(i).frame_id for i in loose}) < 3:
        return False
    take_out_images(model, loose)
    return bool(loose)


def _likelier_bent(
    model: pycolmap.Reconstruction,
    lenses: dict[int, LensChoice],
    options: RefineOptions,
    free_focal: bool,
    loss: float,
    threads: int,
) -> dict[int, LensChoice]:
    """The lenses, with a k1 of the camera with most views where that is likelier: images full of features know it."""
    tried = _k1(model, options, free_focal, loss, threads)
    sigma = K1_INFLATION * tried.sigma
    if not (np.isfinite(sigma) and sigma > 0 and k1_evidence(tried.k1, sigma) > 0):
        return lenses
    straight = {c: LensChoice(MODELS[0]) for c in model.cameras} | lenses
    return straight | {tried.camera: replace(straight[tried.camera], model="SIMPLE_RADIAL")}


class _K1(NamedTuple):
    """k1 of a camera, with its 1-sigma and how far it moves the outermost features [px]."""

    camera: int
    k1: float
    sigma: float
    moved_px: float

    def shown(self, least_sigmas: float, least_px: float) -> bool:
        """Whether it is so many standard deviations from 0, and moves features by so much."""
        return bool(np.isfinite(self.sigma) and abs(self.k1) > least_sigmas * self.sigma and self.moved_px > least_px)


def _k1(model: pycolmap.Reconstruction, options: RefineOptions, free_focal: bool, loss: float, threads: int) -> _K1:
    """Of the camera with most views; tried on a copy."""
    trial = pycolmap.Reconstruction(model)
    adjust(trial, free_focal, True, loss, threads, Effort(15), options.constant)
    p = model_precision(trial, free_focal, 1, loss, options.constant)
    views, ids = to_views(trial)
    camera, main = _cameras(trial, ids)
    k1 = float(views.distortion[np.flatnonzero(camera == main)[0], 0])
    return _K1(main, k1, p.distortion, _moved_px(views, to_points(trial, ids), camera == main, k1))


def _k1_expected(model: pycolmap.Reconstruction, options: RefineOptions, free_focal: bool, loss: float) -> _K1:
    """The same to first order, without an adjustment."""
    views, ids = to_views(model)
    points = to_points(model, ids)
    camera, main = _cameras(model, ids)
    if not determined(views, points):
        return _K1(main, np.nan, np.nan, np.nan)
    of_main = (camera[points.obs_view] == main)[:, None]
    column = np.where(of_main, radial_column(derivatives(views, points), 1), 0.0)
    how = Adjusted(free_focal, 0, loss, camera, options.constant)
    (k1,), (sigma,) = further_parameters(views, points, how, [column])
    return _K1(main, float(k1), float(sigma), _moved_px(views, points, camera == main, float(k1)))


def _cameras(model: pycolmap.Reconstruction, ids: list[int]) -> tuple[np.ndarray, int]:
    """Numbers (n,) of the images' cameras, and that of most of them."""
    camera = np.array([model.image(i).camera_id for i in ids], int)
    return camera, int(np.argmax(np.bincount(camera)))


def _moved_px(views: Views, points: SparsePoints, of_camera: np.ndarray, k1: float) -> float:
    """How far k1 moves the outermost features of the views `of_camera` (n,) [px]."""
    seen = of_camera[points.obs_view]
    K = views.K[points.obs_view[seen]]
    r = np.linalg.norm((points.obs_uv[seen] - K[:, :2, 2]) / K[:, 0, 0][:, None], axis=1)
    return float(abs(k1) * np.percentile(r, 98) ** 3 * K[0, 0, 0])


PROMISING = 0.5
"""Share of what shows a distortion that k1 must reach to first order to be worth an adjustment."""


def _shows_distortion(
    model: pycolmap.Reconstruction, options: RefineOptions, free_focal: bool, loss: float, threads: int
) -> bool:
    """Whether k1 of the camera with most views is significant and visible."""
    bounds = np.array([options.significance, options.visible_px])
    if not _k1_expected(model, options, free_focal, loss).shown(*(PROMISING * bounds)):
        return False
    return _k1(model, options, free_focal, loss, threads).shown(*bounds)
