"""Which lens model a camera needs, by observations that were held out of the fit.

A term that only soaks up noise lowers the residuals it was fitted to and none else. A fifth of every long track's
observations is set aside, the cameras are adjusted on the rest under each model, and the points so found are projected
into the images that were set aside (cross-validation: Stone 1974). A model with more parameters is taken when that error
falls by more than its own scatter, and when it moves features visibly: what a change of the focal length could do as
well is no distortion.
"""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import pycolmap

from massprops.sfm.convert import image_radius, opencv_camera, to_views
from massprops.sfm.fisheye import fisheye
from massprops.sfm.points import project_camera, projected

MODELS = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE")
"""From few parameters to many: none, k1, k2, p1, p2 with two focal lengths, and a fisheye, which is tried where one of the
others sees a distortion."""

RADIAL_TERMS = {"SIMPLE_PINHOLE": 0, "SIMPLE_RADIAL": 1, "RADIAL": 2, "OPENCV": 2, "OPENCV_FISHEYE": 2}
"""Terms that stand in the statement of precision; a fisheye's are correlated, and two carry what they know."""

HELD_OUT = 0.2
"""Share of a track's observations that is set aside, of tracks that keep three."""

SCATTER = 2.0
"""Standard deviations of the held-out error's fall, over tracks and over images, by which it must exceed zero."""

MOST_TRACKS = 5000
"""Tracks that take part, drawn from all: four adjustments of a long video would cost more than the mapping, and the
scatter of a thousand observations is small enough to tell any lens that can be seen."""

FEWEST = 100
"""Observations set aside without which a camera keeps the simplest model."""

K1_SD = 0.05
"""1-sigma of k1 before anything is seen: of the rendered table-top sets it is up to .06, of phones and cameras of a like size."""

Adjust = Callable[[pycolmap.Reconstruction], None]
"""Bundle adjustment in place, all intrinsics free."""


@dataclass(frozen=True)
class LensChoice:
    """What was chosen for one camera.

    Attributes:
        model: COLMAP's name; `SIMPLE_PINHOLE` for none.
        held_out_px: error of the observations set aside under every model tried [px].
        observations: that were set aside.
    """

    model: str
    held_out_px: dict[str, float] = field(default_factory=dict)
    observations: int = 0

    @property
    def bent(self) -> bool:
        """Whether there is a distortion."""
        return self.model != MODELS[0]

    @property
    def radial_terms(self) -> int:
        """How many radial terms are estimated."""
        return RADIAL_TERMS[self.model]


@dataclass(frozen=True)
class HeldOut:
    """k observations: image and point numbers (k,), uv (k, 2) [px], centres of pixels at whole numbers."""

    image: np.ndarray
    point: np.ndarray
    uv: np.ndarray

    def placed(self, model: pycolmap.Reconstruction, ids: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """(k,) which of the images `ids` each is of, and (k, 3) where its point is."""
        row = {image_id: i for i, image_id in enumerate(ids)}
        xyz = np.array([model.point3D(p).xyz for p in self.point.tolist()]).reshape(-1, 3)
        return np.array([row[i] for i in self.image.tolist()], int), xyz


def converted(camera: pycolmap.Camera, model: str) -> pycolmap.Camera:
    """The camera under another model of `MODELS`; terms that the model lacks are dropped."""
    K, d = opencv_camera(camera)
    fu, fv, cu, cv = K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5
    if model == "OPENCV":
        params = [fu, fv, cu, cv, *d[:4]]
    elif model == "OPENCV_FISHEYE":
        k = np.zeros(4) if len(d) > 4 else fisheye(d, image_radius(camera, fu, cu, cv))
        params = [fu, fv, cu, cv, *k]
    else:
        params = [0.5 * (fu + fv), cu, cv, *d[: RADIAL_TERMS[model]]]
    out = pycolmap.Camera(
        camera_id=camera.camera_id, model=model, width=camera.width, height=camera.height, params=params
    )
    out.has_prior_focal_length = camera.has_prior_focal_length
    return out


def set_models(model: pycolmap.Reconstruction, models: dict[int, str]) -> None:
    """Changes the lens models of cameras in place."""
    for camera_id, name in models.items():
        camera, new = model.cameras[camera_id], converted(model.cameras[camera_id], name)
        if camera.model_name != name:
            camera.model = new.model
            camera.params = new.params


def hold_out(model: pycolmap.Reconstruction, seed: int) -> tuple[pycolmap.Reconstruction, HeldOut]:
    """A copy, of some of the tracks where there are many, without a share of the observations, and those.

    Every track keeps three observations at least.
    """
    rng = np.random.default_rng([seed, 29])
    kept = pycolmap.Reconstruction(model)
    drawn = rng.permutation(sorted(model.point3D_ids()))
    for point_id in drawn[MOST_TRACKS:].tolist():
        kept.delete_point3D(point_id)
    image, point, uv = [], [], []
    for point_id in sorted(drawn[:MOST_TRACKS].tolist()):
        elements = model.point3D(point_id).track.elements
        for i in rng.permutation(len(elements))[: min(int(HELD_OUT * len(elements) + rng.random()), len(elements) - 3)]:
            e = elements[i]
            image.append(e.image_id)
            point.append(point_id)
            uv.append(model.image(e.image_id).points2D[e.point2D_idx].xy)
            kept.delete_observation(e.image_id, e.point2D_idx)
    return kept, HeldOut(np.array(image, int), np.array(point, int), np.array(uv, float).reshape(-1, 2) - 0.5)


def distances(model: pycolmap.Reconstruction, held: HeldOut) -> np.ndarray:
    """(k,) reprojection errors of the observations set aside [px]."""
    views, ids = to_views(model)
    v, xyz = held.placed(model, ids)
    return np.linalg.norm(projected(views, v, xyz) - held.uv, axis=1)


def loss(distance: np.ndarray, scale: float) -> np.ndarray:
    """Cauchy's loss [px^2] of distances (n,) [px]: a wrong match counts little however wrong it is."""
    return scale**2 * np.log1p((distance / scale) ** 2)


def falls(before: np.ndarray, after: np.ndarray, held: HeldOut) -> bool:
    """Whether losses (k,) fall by more than their scatter.

    The scatter is the larger of that over tracks and that over images: neighbours of either kind err together.
    """
    gain = before - after
    mean = float(np.mean(gain))
    spread = 0.0
    for key in (held.point, held.image):
        _, which = np.unique(key, return_inverse=True)
        sums = np.bincount(which, gain - mean)
        spread = max(spread, float(np.sqrt(np.sum(sums**2))) / len(gain))
    return mean > SCATTER * spread


def k1_evidence(k1: float, sigma: float) -> float:
    """Log Bayes factor of a lens with an unknown k1 over one without, from the estimate and its 1-sigma (Jeffreys 1961).

    Errors held out hardly tell them apart, as the focal length stands in for k1. So it is off by 1 % where k1 is left out.
    """
    ratio = (K1_SD / sigma) ** 2
    return float(0.5 * (k1 / sigma) ** 2 * ratio / (1.0 + ratio) - 0.5 * np.log1p(ratio))


def moves(a: pycolmap.Camera, b: pycolmap.Camera, uv: np.ndarray) -> float:
    """How far the lenses differ at the places (k, 2) of features, a change of scale apart: 98th percentile [px]."""
    (K, da), (L, db) = opencv_camera(a), opencv_camera(b)
    ray = np.column_stack([(uv - K[:2, 2]) / [K[0, 0], K[1, 1]], np.ones(len(uv))])
    first, second = (
        project_camera(np.tile(M, (len(uv), 1, 1)), np.tile(d, (len(uv), 1)), ray) - M[:2, 2]
        for M, d in ((K, da), (L, db))
    )
    scale = float(np.sum(first * second) / max(float(np.sum(second**2)), 1e-12))
    return float(np.percentile(np.linalg.norm(first - scale * second, axis=1), 98))


def choose_lenses(
    model: pycolmap.Reconstruction, adjust: Adjust, loss_px: float, visible_px: float, seed: int
) -> dict[int, LensChoice]:
    """The lens model of every camera; the reconstruction is not changed.

    Args:
        adjust: bundle adjustment with free intrinsics.
        loss_px: scale of the loss [px].
        visible_px: movement of features below which a richer model is not taken [px].
        seed: of what is set aside.
    """
    start, held = hold_out(model, seed)
    camera = np.array([model.image(i).camera_id for i in held.image.tolist()], int)
    best = dict.fromkeys(model.cameras, MODELS[0])
    errors: dict[str, np.ndarray] = {}
    fits: dict[str, dict[int, pycolmap.Camera]] = {}
    for before, name in zip((MODELS[0], *MODELS), MODELS, strict=False):
        if name == MODELS[-1] and set(best.values()) == {MODELS[0]}:
            break
        trial = pycolmap.Reconstruction(start)
        set_models(trial, dict.fromkeys(trial.cameras, name))
        adjust(trial)
        errors[name] = loss(distances(trial, held), loss_px)
        fits[name] = {c: pycolmap.Camera(camera.todict()) for c, camera in trial.cameras.items()}
        start = trial
        for c in model.cameras if name != MODELS[0] else ():
            of_camera = camera == c
            part = HeldOut(held.image[of_camera], held.point[of_camera], held.uv[of_camera])
            # against the step before too: the lens of another camera, freed at the same step, may be what helped
            better = of_camera.sum() >= FEWEST and all(
                falls(errors[n][of_camera], errors[name][of_camera], part) for n in {best[c], before}
            )
            if better and moves(fits[name][c], fits[best[c]][c], part.uv) > visible_px:
                best[c] = name
    chosen = {}
    for c in model.cameras:
        of_camera = camera == c
        scores = {n: float(np.sqrt(np.mean(e[of_camera]))) for n, e in errors.items()} if of_camera.any() else {}
        chosen[c] = LensChoice(best[c], scores, int(of_camera.sum()))
    return chosen
