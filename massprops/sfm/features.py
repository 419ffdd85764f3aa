"""SIFT features on the object's pixels.

The image is cut to the silhouette's box before extraction: a body that fills a tenth of black sky costs a tenth of
the time. COLMAP's own mask folder is not used, because it drops an image whose mask is missing and accepts a mask of
the wrong size without a word. OpenCV's SIFT finds the same places as COLMAP's to 0.04 px in a quarter of the time.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import cv2
import numpy as np

from massprops.core.parts import Arrays, Parts
from massprops.core.processes import silenced_stderr
from massprops.core.progress import Progress, silent
from massprops.dense.noise import DENOISING_SIGMA, image_noise
from massprops.errors import InputError
from massprops.geometry.pixels import grown
from massprops.sfm.footage import FootageRecord, FrameRecord
from massprops.sfm.turned import turn_keypoints

NOISY = 8.0
"""Noise on the object from which on it hides features [grey levels], if too few images were placed without a blur. Of an asteroid and
a spacecraft 120 px wide at a noise of 7, 10 and 14 levels (measured as 8 to 18, with the texture) a blur of 1 px leaves 1.6 to 2.3 times
as many right matches of neighbouring images, no less exact; 1.5 px leave fewer. Non-local means leave no more than no blur."""
NOISE_IMAGES = 12
"""Images whose noise is measured."""


@dataclass(frozen=True)
class FeatureOptions:
    """How features are found.

    Attributes:
        most: features kept per image, the largest scales first.
        peak: contrast threshold of the difference of Gaussians, per layer.
        margin: silhouettes are grown by this many pixels, so that features on their very edge stay.
        enlarge: times by which the image is enlarged, beside the doubling that SIFT begins with. Where a body of 100 px shows detail
            in every pixel, most of it is finer than the first scale of the doubled image: twice as large it has five to seven
            times as many features.
        denoising_sigma: 1-sigma of the blur that noise is taken out with before features are looked for [px]; 0 for none.
    """

    most: int = 4096
    peak: float = 0.005
    margin: int = 2
    enlarge: int = 1
    denoising_sigma: float = 0.0


def object_region(mask: np.ndarray, margin: int) -> np.ndarray:
    """Boolean (h, w): pixels whose features are used. Every value but 0 counts as object; grown by `margin` [px]."""
    return grown(mask > 0, margin) if margin > 0 else mask > 0


PLAIN = 3.0
"""Features on a thousand pixels of the object below which it is called plain. A smooth white body had 1.8, mostly on edges of its
shading; a CubeSat and an asteroid of stone in heavy H.264 have 10 or more."""


def is_plain(footage: FootageRecord, features: dict[str, tuple[np.ndarray, np.ndarray]]) -> bool:
    """Whether next to no features lie on the object, for its size in the median image; features: by image, on it alone."""
    density = []
    frames = {f.name: f for f in footage.frames}
    for name in sorted(features)[:: max(1, len(features) // 8)]:
        mask = read_mask(footage, name, footage.size(frames[name]))
        if mask is not None and (mask > 0).any():
            density.append(1000.0 * len(features[name][0]) / np.count_nonzero(mask))
    return bool(density) and float(np.median(density)) < PLAIN


def read_mask(footage: FootageRecord, name: str, size: tuple[int, int]) -> np.ndarray | None:
    """The frame's silhouette (h, w) uint8, or None when there is none.

    Raises:
        InputError: the mask cannot be read or its size (w, h) is not the image's.
    """
    path = footage.mask(name)
    if not path.is_file():
        return None
    with silenced_stderr():
        mask: np.ndarray | None = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if mask is None:
        raise InputError(f"{path}: not a readable mask; write an 8-bit PNG with black where there is no object")
    if mask.shape != (size[1], size[0]):
        raise InputError(
            f"{path}: mask is {mask.shape[1]}x{mask.shape[0]} but its image is {size[0]}x{size[1]}; make them equal"
        )
    return mask


def extract(gray: np.ndarray, region: np.ndarray | None, options: FeatureOptions) -> tuple[np.ndarray, np.ndarray]:
    """SIFT of one image.

    Args:
        gray: (h, w) uint8.
        region: (h, w) bool, pixels whose features are kept; None for all.

    Returns:
        keypoints (k, 4) float32: x, y in COLMAP's pixels (centre of the first one at 0.5), scale, angle; descriptors (k, 128) uint8.
    """
    x0 = y0 = 0
    if region is not None:
        ys, xs = np.flatnonzero(region.any(1)), np.flatnonzero(region.any(0))
        if len(ys) < 16 or len(xs) < 16:
            return np.zeros((0, 4), np.float32), np.zeros((0, 128), np.uint8)
        pad = 12
        y0, x0 = max(0, ys[0] - pad), max(0, xs[0] - pad)
        gray = gray[y0 : ys[-1] + pad + 1, x0 : xs[-1] + pad + 1]
    if options.denoising_sigma > 0:
        gray = cv2.GaussianBlur(gray, (0, 0), options.denoising_sigma)
    # features, layers, contrast, edge, sigma, descriptor type, exact doubling of the image
    if options.enlarge > 1:
        gray = cv2.resize(gray, None, fx=options.enlarge, fy=options.enlarge, interpolation=cv2.INTER_CUBIC)
    sift = cv2.SIFT_create(options.most, 3, 3 * options.peak, 10, 1.6, cv2.CV_32F, True)  # type: ignore[attr-defined]
    keypoints, raw = sift.detectAndCompute(np.ascontiguousarray(gray), None)
    if not keypoints:
        return np.zeros((0, 4), np.float32), np.zeros((0, 128), np.uint8)
    xy = np.array([(*k.pt, k.size / 2, np.deg2rad(k.angle)) for k in keypoints], np.float32)
    if options.enlarge > 1:
        # centre of pixel i at enlarge * (i + 1/2) - 1/2 of the enlarged image
        xy[:, :2] = (xy[:, :2] + 0.5) / options.enlarge - 0.5
        xy[:, 2] /= options.enlarge
    xy[:, 0] += x0 + 0.5
    xy[:, 1] += y0 + 0.5
    data = root_sift(raw)
    if region is not None:
        h, w = region.shape
        col = np.clip(xy[:, 0].astype(int), 0, w - 1)
        row = np.clip(xy[:, 1].astype(int), 0, h - 1)
        keep = region[row, col]
        xy, data = xy[keep], data[keep]
    return xy, data


def with_denoising(footage: FootageRecord, options: FeatureOptions) -> FeatureOptions:
    """The options with a blur where the images are noisy on the object, as those of a few of them show."""
    noise = []
    for frame in footage.frames[:: max(1, len(footage.frames) // NOISE_IMAGES)]:
        gray = cv2.imread(str(footage.image(frame.name)), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
        mask = read_mask(footage, frame.name, footage.size(frame))
        if gray is not None and mask is not None and (mask == 255).any():
            noise.append(image_noise(gray, mask == 255))
    return replace(options, denoising_sigma=DENOISING_SIGMA) if noise and np.median(noise) > NOISY else options


def root_sift(descriptors: np.ndarray) -> np.ndarray:
    """Square roots of descriptors (k, 128) of unit sum (Arandjelović and Zisserman 2012), as COLMAP stores them: uint8."""
    d = descriptors / np.maximum(descriptors.sum(1, keepdims=True), 1e-9)
    return np.clip(np.round(512 * np.sqrt(d)), 0, 255).astype(np.uint8)


def extract_all(
    footage: FootageRecord,
    options: FeatureOptions,
    masked: bool,
    threads: int,
    progress: Progress = silent,
    parts: Parts | None = None,
    frames: Sequence[FrameRecord] | None = None,
) -> tuple[dict[str, tuple[np.ndarray, np.ndarray]], list[str]]:
    """Features of every frame, by name, and the names of those that lack a silhouette; places are those of the frames turned as
    their camera's are.

    With `masked`, a frame without a silhouette is used whole before black sky and left out otherwise, where a still
    background would hold the solver. `parts` keeps each frame's as soon as they are found. `frames` are those of the footage that
    are looked at, all by default.
    """
    unmasked: list[str] = []
    parts, frames = parts or Parts(), footage.frames if frames is None else frames

    def one(frame: FrameRecord) -> tuple[str, np.ndarray, np.ndarray] | None:
        gray = cv2.imread(str(footage.image(frame.name)), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
        if gray is None:
            raise InputError(f"{footage.image(frame.name)}: not a readable image; run the capture stage again")
        region = None
        if masked:
            mask = read_mask(footage, frame.name, footage.size(frame))
            if mask is None:
                unmasked.append(frame.name)
                if footage.background != "black":
                    return None
            else:
                region = object_region(mask, options.margin)

        def found_in_it() -> Arrays:
            keypoints, descriptors = extract(gray, region, options)
            return {"keypoints": keypoints, "descriptors": descriptors}

        part = parts.made(f"features {frame.name} {masked} {options}", found_in_it)
        return frame.name, turn_keypoints(part["keypoints"], footage.size(frame), frame.turn), part["descriptors"]

    features: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    cv2.setNumThreads(1)  # one thread an image, and the same features every time
    with ThreadPoolExecutor(max(1, threads)) as pool:
        for i, result in enumerate(pool.map(one, frames)):
            progress(i + 1, len(frames), "features")
            if result is not None:
                features[result[0]] = (result[1], result[2])
    return features, unmasked


def unmasked_warning(footage: FootageRecord, unmasked: list[str]) -> list[str]:
    """What to say of frames that lack a silhouette, if there are any."""
    what = "used whole" if footage.background == "black" else "left out"
    return [f"{len(unmasked)} frames have no silhouette and were {what}"] if unmasked else []
