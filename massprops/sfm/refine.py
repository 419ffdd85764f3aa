"""The last adjustment: outliers out, robust loss, and a distortion term only where the images show one.

On a small body in the middle of the image a radial term trades against the focal length and the distance, so that an
unneeded one costs accuracy; it is kept when it is significant beside its own standard deviation and moves features
by a visible amount.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import dataclass

import numpy as np
import pycolmap

from massprops.sfm.convert import to_points, to_views
from massprops.sfm.precision import Precision, precision, residuals


@dataclass(frozen=True)
class RefineOptions:
    """How the last adjustment is done.

    Attributes:
        rounds: adjustments, each after its outliers were removed.
        loss_px: scale of the Cauchy loss [px].
        cut: observations further off than this many robust standard deviations are removed.
        shortest: fewest images of a track.
        least_angle_deg: tracks seen under a smaller angle are removed.
        significance: k1 over its standard deviation from which on it is kept.
        visible_px: movement of the outermost features from which on k1 is kept.
    """

    rounds: int = 2
    loss_px: float = 0.5
    cut: float = 4.0
    shortest: int = 3
    least_angle_deg: float = 2.0
    significance: float = 5.0
    visible_px: float = 0.3


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


def remove_outliers(model: pycolmap.Reconstruction, options: RefineOptions) -> int:
    """Removes observations and tracks that do not fit; gives how many observations went.

    The bound follows the residuals themselves (median absolute deviation), within 1 to 4 px. Tracks of shadow edges,
    which crawl over a turning body, are short, and leave by length or by their residuals.
    """
    views, ids = to_views(model)
    points = to_points(model, ids)
    distance = np.linalg.norm(residuals(views, points), axis=1)
    # the median of a Rayleigh distance is 1.177 standard deviations of one coordinate
    sigma = float(np.median(distance)) / 1.177 if len(distance) else 1.0
    bound = float(np.clip(options.cut * sigma, 1.0, 4.0))
    manager = pycolmap.ObservationManager(model)
    gone = manager.filter_all_points3D(bound, options.least_angle_deg)
    gone += manager.filter_points3D_with_short_tracks(options.shortest)
    return int(gone)


def refine(
    model: pycolmap.Reconstruction,
    options: RefineOptions,
    free_focal: bool,
    test_distortion: bool,
    threads: int,
) -> tuple[Precision, bool]:
    """Adjusts in place; gives the precision and whether a distortion term was estimated."""
    remove_outliers(model, options)
    for _ in range(options.rounds):
        adjust(model, free_focal, False, options.loss_px, threads)
        remove_outliers(model, options)
    keep = False
    if test_distortion:
        # tested on a copy, since going back would need another adjustment
        trial = pycolmap.Reconstruction(model)
        adjust(trial, free_focal, True, options.loss_px, threads)
        keep = _shows_distortion(trial, options, free_focal)
        if keep:
            for camera_id, camera in trial.cameras.items():
                model.cameras[camera_id].params = camera.params
            adjust(model, free_focal, True, options.loss_px, threads)
            remove_outliers(model, options)
    adjust(model, free_focal, keep, options.loss_px, threads)
    model.update_point_3d_errors()
    views, ids = to_views(model)
    return precision(views, to_points(model, ids), free_focal, keep, options.loss_px), keep


def _shows_distortion(model: pycolmap.Reconstruction, options: RefineOptions, free_focal: bool) -> bool:
    views, ids = to_views(model)
    points = to_points(model, ids)
    p = precision(views, points, free_focal, True, options.loss_px)
    k1 = float(views.distortion[0, 0])
    K = views.K[points.obs_view]
    r = np.linalg.norm((points.obs_uv - K[:, :2, 2]) / K[:, 0, 0][:, None], axis=1)
    moved = abs(k1) * np.percentile(r, 98) ** 3 * float(views.K[0, 0, 0])
    return bool(np.isfinite(p.distortion) and abs(k1) > options.significance * p.distortion and moved > options.visible_px)
