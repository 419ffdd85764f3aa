"""The last adjustment: outliers out, robust loss, and a distortion term only where the images show one.

On a small body in the middle of the image a radial term trades against the focal length and the distance, so that an
unneeded one costs accuracy; it is kept when it is significant beside its own standard deviation and moves features
by a visible amount.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import dataclass, replace

import numpy as np
import pycolmap

from massprops.sfm.convert import to_points, to_views
from massprops.sfm.points import residuals
from massprops.sfm.precision import Precision, precision


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
        visible_px: movement of the outermost features from which on k1 is kept.
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


FOCAL_INFLATION = 2.5
"""Simulated footage with known truth: errors of the focal length were 2.5 (root mean square) standard deviations of the clusters'
covariance, since features that follow the light are wrong together."""

ATTITUDE_INFLATION = 3.0
"""As above; median attitude errors were 2.5 to 4 times the covariance's."""


def adjust(
    model: pycolmap.Reconstruction,
    free_focal: bool,
    free_distortion: bool,
    loss_px: float | None,
    threads: int,
    iterations: int = 40,
) -> None:
    """One global bundle adjustment in place; rigs and principal points stay as they are."""
    o = pycolmap.BundleAdjustmentOptions()
    o.refine_focal_length = free_focal
    o.refine_extra_params = free_distortion
    o.refine_principal_point = False
    o.refine_sensor_from_rig = False
    o.print_summary = False
    if loss_px is not None:
        o.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
        o.ceres.loss_function_scale = loss_px
    o.ceres.solver_options.max_num_iterations = iterations
    o.ceres.solver_options.function_tolerance = 1e-7
    o.ceres.solver_options.num_threads = threads
    pycolmap.bundle_adjustment(model, o)


def robust_sigma(distance: np.ndarray) -> float:
    """Standard deviation of one coordinate from residual lengths (k,) [px]: a Rayleigh median is 1.177 of it."""
    return float(np.median(distance)) / 1.177 if len(distance) else 1.0


def remove_outliers(model: pycolmap.Reconstruction, options: RefineOptions, least_cut_px: float | None = None) -> float:
    """Removes observations and tracks that do not fit; gives the scale for the next adjustment's loss [px].

    The bound follows the residuals themselves. Tracks of shadow edges,
    which crawl over a turning body, are short, and leave by length or by their residuals.
    """
    sigma = _residual_sigma(model)
    bound = float(np.clip(options.cut * sigma, least_cut_px or options.least_cut_px, 4.0))
    manager = pycolmap.ObservationManager(model)
    manager.filter_all_points3D(bound, options.least_angle_deg)
    manager.filter_points3D_with_short_tracks(options.shortest)
    return _loss(sigma, options)


def refine(
    model: pycolmap.Reconstruction,
    options: RefineOptions,
    free_focal: bool,
    test_distortion: bool,
    threads: int,
) -> tuple[Precision, bool]:
    """Adjusts in place; gives the precision and whether a distortion term was estimated."""
    # wide at first: an image whose pose is still poor must not lose the observations that would mend it
    loss = remove_outliers(model, options, 2.0)
    adjust(model, free_focal, False, loss, threads, iterations=20)
    loss = remove_outliers(model, options, 1.0)
    for _ in range(options.rounds - 1):
        adjust(model, free_focal, False, loss, threads)
        loss = remove_outliers(model, options)
    keep = False
    if test_distortion:
        # tested on a copy, since going back would need another adjustment
        trial = pycolmap.Reconstruction(model)
        adjust(trial, free_focal, True, loss, threads, iterations=15)
        keep = _shows_distortion(trial, options, free_focal, loss)
        if keep:
            for camera_id, camera in trial.cameras.items():
                model.cameras[camera_id].params = camera.params
            adjust(model, free_focal, True, loss, threads)
            loss = remove_outliers(model, options)
    adjust(model, free_focal, keep, loss, threads)
    _drop_weak(model, options)
    model.update_point_3d_errors()
    views, ids = to_views(model)
    raw = precision(views, to_points(model, ids), free_focal, keep, loss)
    if _drop_loose(model, ids, raw.attitude, options):
        model.update_point_3d_errors()
        views, ids = to_views(model)
        raw = precision(views, to_points(model, ids), free_focal, keep, loss)
    return _honest(raw), keep


def robust_loss(model: pycolmap.Reconstruction, options: RefineOptions) -> float:
    """Scale of the next adjustment's loss [px], from the residuals."""
    return _loss(_residual_sigma(model), options)


def _residual_sigma(model: pycolmap.Reconstruction) -> float:
    views, ids = to_views(model)
    return robust_sigma(np.linalg.norm(residuals(views, to_points(model, ids)), axis=1))


def _loss(sigma: float, options: RefineOptions) -> float:
    return float(np.clip(options.loss * sigma, options.least_loss_px, options.most_loss_px))


def model_precision(model: pycolmap.Reconstruction, free_focal: bool, free_distortion: bool, loss: float) -> Precision:
    """Precision of an adjusted model, as stated to the user."""
    views, ids = to_views(model)
    return _honest(precision(views, to_points(model, ids), free_focal, free_distortion, loss))


def _honest(raw: Precision) -> Precision:
    return replace(raw, focal_relative=FOCAL_INFLATION * raw.focal_relative, attitude=ATTITUDE_INFLATION * raw.attitude)


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
    frames = {model.image(i).frame_id for i, s in zip(ids, attitude, strict=True) if bound < s}
    if len(ids) - len(frames) < 3:
        return False
    manager = pycolmap.ObservationManager(model)
    for frame_id in sorted(frames):
        manager.deregister_frame(frame_id)
    return bool(frames)


def _shows_distortion(model: pycolmap.Reconstruction, options: RefineOptions, free_focal: bool, loss: float) -> bool:
    views, ids = to_views(model)
    points = to_points(model, ids)
    p = precision(views, points, free_focal, True, loss)
    k1 = float(views.distortion[0, 0])
    K = views.K[points.obs_view]
    r = np.linalg.norm((points.obs_uv - K[:, :2, 2]) / K[:, 0, 0][:, None], axis=1)
    moved = abs(k1) * np.percentile(r, 98) ** 3 * float(views.K[0, 0, 0])
    sure = np.isfinite(p.distortion) and abs(k1) > options.significance * p.distortion
    return bool(sure and moved > options.visible_px)
