"""What images show before features are matched: noise that is taken out where there is much of it, and objects that are plain."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from massprops.sfm.features import DENOISING_SIGMA, FeatureOptions, extract, is_plain, with_denoising
from massprops.sfm.footage import FootageRecord

SIZE = (200, 160)


class Few:
    """As much of a footage as is asked for."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.frames = [type("Frame", (), {"name": f"{i}.png"})() for i in range(3)]

    def image(self, name: str) -> Path:
        return self.folder / name

    def mask(self, name: str) -> Path:
        return self.folder / f"mask-{name}"

    def size(self, _: object) -> tuple[int, int]:
        return SIZE


def textured() -> np.ndarray:
    rng = np.random.default_rng(0)
    soft = cv2.GaussianBlur(rng.standard_normal(SIZE[::-1]), (0, 0), 2.5)
    return 110 + 20 * soft / soft.std()


def noisy(image: np.ndarray, sigma: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.clip(np.rint(image + sigma * rng.standard_normal(image.shape)), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(("sigma", "calm"), [(1.0, 0.0), (14.0, DENOISING_SIGMA)])
def test_only_noisy_images_are_blurred(tmp_path: Path, sigma: float, calm: float) -> None:
    for i in range(3):
        cv2.imwrite(str(tmp_path / f"{i}.png"), noisy(textured(), sigma, i))
        cv2.imwrite(str(tmp_path / f"mask-{i}.png"), np.full(SIZE[::-1], 255, np.uint8))
    footage: FootageRecord = Few(tmp_path)  # type: ignore[assignment]
    assert with_denoising(footage, FeatureOptions(enlarge=2)) == FeatureOptions(enlarge=2, denoising_sigma=calm)


def test_a_blur_brings_out_features_that_two_noisy_images_share() -> None:
    image = textured()

    def shared(options: FeatureOptions) -> int:
        (a, one), (b, two) = (extract(noisy(image, 14.0, seed), None, options) for seed in (1, 2))
        pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(one.astype(np.float32), two.astype(np.float32), k=2)
        good = [m for m, n in pairs if m.distance < 0.8 * n.distance]
        return sum(np.linalg.norm(a[m.queryIdx, :2] - b[m.trainIdx, :2]) < 1.5 for m in good)

    assert shared(FeatureOptions(denoising_sigma=DENOISING_SIGMA)) > 1.3 * shared(FeatureOptions())


@pytest.mark.parametrize(("count", "plain"), [(20, True), (150, False)])
def test_an_object_with_next_to_no_features_is_plain(tmp_path: Path, count: int, plain: bool) -> None:
    footage = Few(tmp_path)
    mask = np.zeros(SIZE[::-1], np.uint8)
    mask[30:130, 40:160] = 255
    found = {f.name: (np.zeros((count, 4)), np.zeros((count, 128))) for f in footage.frames}
    assert not is_plain(footage, found)  # type: ignore[arg-type]
    for frame in footage.frames:
        cv2.imwrite(str(footage.mask(frame.name)), mask)
    assert is_plain(footage, found) is plain  # type: ignore[arg-type]
