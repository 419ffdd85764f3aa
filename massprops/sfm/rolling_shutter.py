"""Whether the shutter reads the rows one after the other, and how long that takes: from the reconstruction itself.

One number, the readout's duration, is adjusted with poses, points and focal length. Features alone do not tell it: their tracks
are short, and over a short track a rolling shutter is a little more perspective. Pieces of surface, followed over many views
(`massprops.sfm.surface_tracks`), do. A readout is believed when it is far from zero by its own standard deviation, which
knows that a track's errors hang together (`massprops.sfm.precision`), and when it does not raise the error of observations
that were held out of the fit. (That error alone decides little: poses and shape bend to fit all but the last hundredth.)
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import dataclass, field, replace

import numpy as np
import pycolmap

from massprops.sfm.convert import HALF, to_points, to_views
from massprops.sfm.footage import FootageRecord
from massprops.sfm.lens import FEWEST, HeldOut, distances, hold_out, loss
from massprops.sfm.points import residuals
from massprops.sfm.precision import Adjusted, further_parameters
from massprops.sfm.refine import Effort, RefineOptions, adjust, robust_loss
from massprops.sfm.row_motion import Readout, Seen, motion_of, moved_on, roughness, row_jacobian, row_shifts

INFLATION = 2.5
"""As the focal length's: two bodies, filmed with readouts of 0 and of 44 % of a frame's time, came out 0.7 to 1.3 of the
standard deviations that this states."""

SUSPECTED, CERTAIN = 2.0, 3.0
"""Standard deviations from zero at which a readout is worth a second look, and from which on it is corrected if held-out
observations agree."""

LONGEST = 1.0
"""Rows of one image are read before the next image begins: a longer readout [frames] is something else."""

ROUGH = 0.08
"""Roughness of the motion (`massprops.sfm.row_motion.roughness`) from which on speeds are not known well enough to correct. It
is 0.001 for a body that tumbles by 7 degrees an image. Of a made-up camera that shakes by 0.3 degrees besides, with a
readout of 0.5 frames, it was 0.03, 0.07 and 0.12 with periods of 7, 5 and 3.3 images; found were 0.50, 0.52 and 0.66."""

ROUNDS = 5
RESTS = 0.2
"""The readout rests when a step is below this many of its standard deviations."""


@dataclass(frozen=True)
class Shutter:
    """What was found.

    Attributes:
        state: `rolling`, corrected; `suspected`, neither sure enough to be corrected nor to be left out of account;
            `global`, nothing was found; `unknown`, it could not be judged.
        readout: duration in frames, and the axis along which rows follow each other; None where nothing was found.
        sigma: of the duration [frames].
        moved_px: how far it moves what is seen from where a global shutter would see it, 98th percentile [px].
        focal: what it would change the focal length by, relative.
        held_out_px: error of observations held out, without and with the readout [px].
        remains: of a readout that was corrected, something is still seen in the corrected images.
    """

    state: str
    readout: Readout | None = None
    sigma: float = float("nan")
    moved_px: float = 0.0
    focal: float = 0.0
    held_out_px: tuple[float, float] = (float("nan"), float("nan"))
    remains: bool = False

    @property
    def doubtful(self) -> bool:
        """Whether it may have done harm that was not mended."""
        return self.state == "suspected" or self.remains

    @property
    def focal_sigma_relative(self) -> float:
        """Relative 1-sigma by which the focal length is less sure for it."""
        if not self.said() or self.readout is None:
            return 0.0
        relative_sigma = 1.0 if self.doubtful else self.sigma / max(abs(self.readout.duration), 1e-9)
        return abs(self.focal) * relative_sigma

    def said(self) -> str:
        """One line for the user; empty where there is nothing to say."""
        if self.state not in ("rolling", "suspected") or self.readout is None:
            return ""
        rows = "rows" if self.readout.axis == 1 else "columns"
        share = f"{100 * abs(self.readout.duration):.0f} ± {100 * self.sigma:.0f} % of a frame's time"
        if self.state == "rolling":
            line = f"the shutter reads the {rows} of an image one after the other, in {share}; images and cameras were corrected"
            return line + (", but not all of it is gone" if self.remains else "")
        return (
            f"the shutter may read the {rows} of an image one after the other, in {share}: too unsure to be corrected; "
            "film with a shorter readout (a lower resolution, or a global shutter), or so that less moves from frame to frame"
        )


@dataclass(frozen=True)
class Settings:
    """How a model is adjusted here: as in its last adjustment.

    Attributes:
        options: of that.
        free_focal: whether focal lengths are estimated.
        radial_terms: estimated terms of the distortion by camera number.
        seed: of what is held out.
        threads: processor threads.
    """

    options: RefineOptions
    free_focal: bool
    radial_terms: dict[int, int] = field(default_factory=dict)
    seed: int = 0
    threads: int = 1

    def adjusted(self, model: pycolmap.Reconstruction) -> pycolmap.Reconstruction:
        """The model, adjusted in place."""
        bent = any(self.radial_terms.values())
        scale = self.options.least_loss_px
        adjust(model, self.free_focal, bent, scale, self.threads, Effort(20), self.options.constant)
        return model


def frame_times(footage: FootageRecord) -> dict[str, float] | None:
    """When each frame was taken, in frames of the source; None where images do not follow each other in time."""
    if not footage.moving_pictures or any(f.turn for f in footage.frames):
        return None
    by_index = {f.name: float(f.index) for f in footage.frames}
    if any(f.timestamp_ns < 0 for f in footage.frames):
        return by_index
    steps, lasting = [], []
    for a, b in zip(footage.frames, footage.frames[1:], strict=False):
        if a.name.split("/", 1)[0] == b.name.split("/", 1)[0] and b.index > a.index and b.timestamp_ns > a.timestamp_ns:
            steps.append(b.index - a.index)
            lasting.append(b.timestamp_ns - a.timestamp_ns)
    if not steps:
        return by_index
    frame = float(np.median(np.array(lasting) / np.array(steps)))
    return {f.name: f.timestamp_ns / frame for f in footage.frames}


class Keypoints:
    """Where the features of a model were seen, before any of them is moved."""

    def __init__(self, model: pycolmap.Reconstruction) -> None:
        self.xy = {i: np.array([p.xy for p in model.image(i).points2D]).reshape(-1, 2) for i in model.reg_image_ids()}

    def seen(self, model: pycolmap.Reconstruction, times: dict[str, float]) -> Seen:
        """The model, perhaps with moved features, beside where they were seen."""
        views, ids = to_views(model)
        points = to_points(model, ids)
        uv = np.concatenate([self.xy[i][_observed(model.image(i))] for i in ids]) - HALF
        taken = np.array([times[name] for name in views.names])
        return Seen(views, ids, points, uv, motion_of(views, taken, np.median(points.xyz, axis=0)))

    def correct(self, model: pycolmap.Reconstruction, times: dict[str, float], readout: Readout) -> None:
        """Moves the features in place to where a global shutter would have seen them, by the model's own motion."""
        seen = self.seen(model, times)
        xy = seen.uv - row_shifts(seen.views, seen.points, seen.motion, readout, seen.uv) + HALF
        for row, i in enumerate(seen.ids):
            corrected, places = xy[seen.points.obs_view == row], model.image(i).points2D
            for k, place in zip(_observed(model.image(i)), corrected, strict=True):
                places[int(k)].xy = place


def _observed(image: pycolmap.Image) -> np.ndarray:
    """Numbers of an image's features that belong to points, in the order in which `to_points` lists them."""
    point_and_feature = [(p.point3D_id, k) for k, p in enumerate(image.points2D) if p.has_point3D()]
    return np.array([k for _, k in sorted(point_and_feature, key=lambda o: o[0])], int)


def find_shutter(
    model: pycolmap.Reconstruction, times: dict[str, float], settings: Settings
) -> tuple[Shutter, Seen | None]:
    """The shutter by a model whose tracks are long; see the module.

    Args:
        model: is not changed.
        times: of its images by name, in frames (`frame_times`).

    Returns:
        what was found, and where there is a readout the model adjusted with it.
    """
    start = settings.adjusted(pycolmap.Reconstruction(model))
    seen_at = Keypoints(start)
    first = seen_at.seen(start, times)
    if first.motion.known.mean() < 0.5 or len(first.uv) < 12 * len(first.views):
        return Shutter("unknown"), None
    step, sigma = np.concatenate([_steps(start, first, [Readout(0.0, axis)], settings) for axis in (0, 1)], axis=1)
    if not np.all(np.isfinite(step / sigma)):
        return Shutter("unknown"), None
    if np.all(np.abs(step) < SUSPECTED * INFLATION * sigma):
        return Shutter("global"), None
    kept, held = hold_out(start, settings.seed)
    without = settings.adjusted(kept)
    # far from the answer one axis may pass for the other: both are fitted, and what was held out decides
    fits = []
    for axis in (0, 1):
        fitted, readout, deviation = _fitted(pycolmap.Reconstruction(without), seen_at, times, axis, settings)
        seen = seen_at.seen(fitted, times)
        fits.append((_judged(without, fitted, readout, deviation, held, seen), seen))
    judged, seen = min(fits, key=lambda fit: fit[0].held_out_px[1])
    rough = roughness(seen.views, seen.points, np.array([times[name] for name in seen.views.names]))
    if judged.state == "rolling" and rough > ROUGH:
        judged = replace(judged, state="suspected")
    return judged, seen


def _fitted(
    model: pycolmap.Reconstruction, seen_at: Keypoints, times: dict[str, float], axis: int, settings: Settings
) -> tuple[pycolmap.Reconstruction, Readout, float]:
    """The model adjusted in place with a readout along one axis; the readout and its stated standard deviation.

    Each Gauss-Newton step falls short, since the loss is nearly flat far out. The secant through two steps does not, and its
    slope turns the steps' standard deviation into the estimate's.
    """
    duration, slope = 0.0, -1.0
    before: tuple[float, float] | None = None
    for _ in range(ROUNDS):
        readout = Readout(duration, axis)
        steps, sigmas = _steps(model, seen_at.seen(model, times), [readout], settings)
        step, sigma = float(steps[0]), float(sigmas[0])
        if before is not None and duration != before[0]:
            # a step takes at most itself and at least a quarter of what is left
            slope = float(np.clip((step - before[1]) / (duration - before[0]), -1.0, -0.25))
        if before is not None and abs(step) < RESTS * sigma:
            break
        before = (duration, step)
        duration = float(np.clip(duration - step / slope, -1.5 * LONGEST, 1.5 * LONGEST))
        for _ in range(2):  # the shifts follow the poses, which follow the shifts
            seen_at.correct(model, times, Readout(duration, axis))
            settings.adjusted(model)
    return model, Readout(duration, axis), INFLATION * sigma / -slope


def _steps(
    model: pycolmap.Reconstruction, seen: Seen, readouts: list[Readout], settings: Settings
) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Newton steps of durations, together, with their standard deviations."""
    how = Adjusted(
        settings.free_focal,
        settings.radial_terms,
        robust_loss(model, settings.options),
        np.array([model.image(i).camera_id for i in seen.ids], int),
        settings.options.constant,
    )
    columns = [row_jacobian(seen.views, seen.points, seen.motion, r, seen.uv) for r in readouts]
    return further_parameters(seen.views, seen.points, how, columns)


def _judged(
    without: pycolmap.Reconstruction,
    fitted: pycolmap.Reconstruction,
    readout: Readout,
    sigma: float,
    held: HeldOut,
    seen: Seen,
) -> Shutter:
    """What the fit and the observations held out say of a readout."""
    scale = max(float(np.median(np.linalg.norm(residuals(seen.views, seen.points), axis=1))), 0.05)
    before, after = distances(without, held), _held_distances(fitted, held, seen, readout)
    shifts = row_shifts(seen.views, seen.points, seen.motion, readout, seen.uv)
    focal = np.mean([c.mean_focal_length() for c in fitted.cameras.values()])
    focal /= np.mean([c.mean_focal_length() for c in without.cameras.values()])
    errors = float(np.sqrt(np.mean(loss(before, scale)))), float(np.sqrt(np.mean(loss(after, scale))))
    far = abs(readout.duration) / sigma
    possible = (
        len(before) >= FEWEST
        and errors[1] < errors[0]
        and far > SUSPECTED
        and abs(readout.duration) < LONGEST + 2 * sigma
    )
    return Shutter(
        ("rolling" if far > CERTAIN else "suspected") if possible else "global",
        readout,
        sigma,
        float(np.percentile(np.linalg.norm(shifts, axis=1), 98)),
        float(focal - 1.0),
        errors,
    )


def _held_distances(model: pycolmap.Reconstruction, held: HeldOut, seen: Seen, readout: Readout) -> np.ndarray:
    """(k,) errors of the observations held out when their rows were exposed [px]."""
    view, xyz = held.placed(model, seen.ids)
    uv = moved_on(seen.views, seen.motion, view, xyz, readout.delays(held.uv, seen.views.size[view]))
    return np.linalg.norm(uv - held.uv, axis=1)
