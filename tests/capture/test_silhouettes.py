"""Silhouettes, doubt, the object of a still scene, and masks that users bring."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from massprops.capture.colours import agrees, learn
from massprops.capture.given import GivenMasks, load_mask
from massprops.capture.motion import judge
from massprops.capture.silhouette import against_background, against_plain, against_sky, main_object, sky_level
from massprops.capture.unknown_pixels import predicted_silhouette, with_unknown
from massprops.errors import InputError
from massprops.views import AMBIGUOUS


def disc(shape: tuple[int, int], x: float, y: float, r: float) -> np.ndarray:
    v, u = np.mgrid[0 : shape[0], 0 : shape[1]]
    return (u - x) ** 2 + (v - y) ** 2 < r**2


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


def noisy(grey: np.ndarray, sigma: float, seed: int = 0) -> np.ndarray:
    return np.clip(grey + sigma * np.random.default_rng(seed).standard_normal(grey.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("sigma", [1.0, 4.0])
def test_sky_threshold_follows_the_noise(sigma: float) -> None:
    body = disc((120, 160), 80, 60, 30)
    frame = noisy(np.where(body, 90.0, 6.0), sigma)
    frame[10, 10] = frame[100, 140] = 250  # stars
    level, noise = sky_level(frame[None])
    mask = against_sky(frame, level, noise) == 255
    assert iou(mask, body) > 0.9, "at most about a pixel wide all round"
    assert not mask[:20, :20].any()


def test_still_background_is_subtracted() -> None:
    rng = np.random.default_rng(1)
    back = cv2.resize(rng.integers(40, 200, (30, 40, 3), dtype=np.uint8), (160, 120), interpolation=cv2.INTER_CUBIC)
    frames, bodies = [], []
    for k in range(9):
        body = disc((120, 160), 40 + 10 * k, 60, 16)
        image = back.copy()
        image[body] = [250, 30, 60]
        frames.append(noisy(image.astype(float), 1.5, k))
        bodies.append(body)
    stack = np.stack(frames)
    middle = np.median(stack, axis=0).astype(np.uint8)
    spread = np.median(np.abs(stack.astype(int) - middle), axis=0).astype(np.uint8)
    assert iou(against_background(frames[0], middle, spread) == 255, bodies[0]) > 0.8


def test_shadow_and_small_things_are_not_the_object_before_a_plain_backdrop() -> None:
    image = np.full((240, 320, 3), 235, np.uint8)
    image[disc((240, 320), 190, 140, 60)] = 175  # soft shadow, colourless
    body = disc((240, 320), 150, 120, 55)
    image[body] = [60, 90, 110]
    image[205:215, 20:120] = [40, 40, 200]  # a scale bar
    mask = against_plain(noisy(image.astype(float), 2)) == 255
    assert iou(mask, body) > 0.85


def test_two_bodies_are_said() -> None:
    two = np.where(disc((120, 160), 40, 60, 15) | disc((120, 160), 120, 60, 14), 255, 0).astype(np.uint8)
    one = np.where(disc((120, 160), 40, 60, 15), 255, 0).astype(np.uint8)
    main_object([one] * 10 + [two] * 3, "v")
    with pytest.raises(InputError, match="several objects"):
        main_object([two] * 10 + [one] * 2, "v")


def test_kinds_of_footage() -> None:
    rng = np.random.default_rng(0)
    texture = rng.integers(30, 220, (60, 400), dtype=np.uint8)
    black = np.stack([np.where(disc((60, 80), 30 + k, 30, 12), 150, 3).astype(np.uint8) for k in range(10)])
    still = np.stack(
        [np.where(disc((60, 80), 30 + k, 30, 12), 250, texture[:, :80]).astype(np.uint8) for k in range(10)]
    )
    moving = np.stack([texture[:, 9 * k : 9 * k + 80] for k in range(10)])
    white = np.stack([np.where(disc((60, 80), 30 + k, 30, 12), 90, 240).astype(np.uint8) for k in range(10)])
    assert [judge(f, True).motion for f in (black, still, moving)] == ["tumbling", "tumbling", "static"]
    assert [judge(f, True).background for f in (black, still, moving)] == ["black", "still", "moving"]
    assert judge(white, False).plain and judge(white, False).motion == "static"


def test_an_unlit_side_is_doubt_not_emptiness() -> None:
    lit = np.where(disc((120, 160), 70, 60, 30) & (np.arange(160) < 75), 255, 0).astype(np.uint8)
    rng = np.random.default_rng(0)
    uv = rng.uniform([40, 30], [100, 90], (900, 2))
    uv = uv[np.hypot(uv[:, 0] - 70, uv[:, 1] - 60) < 30]
    mask = with_unknown(lit, predicted_silhouette(uv, (120, 160)))
    assert mask[60, 85] == AMBIGUOUS and mask[60, 60] == 255 and mask[10, 10] == 0
    assert (mask[disc((120, 160), 70, 60, 27)] > 0).all(), "no pixel of the body may carve"


def test_given_masks_are_checked(tmp_path: Path) -> None:
    names = [("cam0/a.jpg", "a.jpg"), ("cam0/b.jpg", "b.jpg")]
    with pytest.raises(InputError, match="no mask for 2 of 2"):
        GivenMasks(tmp_path).check(names)
    cv2.imwrite(str(tmp_path / "a.jpg.png"), np.full((120, 160), 255, np.uint8))
    (tmp_path / "cam0").mkdir()
    cv2.imwrite(str(tmp_path / "cam0" / "b.jpg.png"), np.zeros((120, 160), np.uint8))
    a, b = GivenMasks(tmp_path).check(names)
    assert load_mask(a, (160, 120), (80, 60)).shape == (60, 80)
    with pytest.raises(InputError, match="must agree"):
        load_mask(a, (200, 120), (100, 60))
    assert not load_mask(b, (160, 120), (160, 120)).any(), "the object is not to be seen there"


def test_colours_of_all_frames_correct_one_silhouette() -> None:
    rng = np.random.default_rng(4)
    images, rough, bodies = [], [], []
    for k in range(8):
        image = np.full((240, 320, 3), 235.0)
        body = disc((240, 320), 130 + 6 * k, 110, 50)
        image[body] = [60, 100, 130]
        pale = body & disc((240, 320), 130 + 6 * k, 70, 22)
        image[pale] = [120, 160, 185]
        bar = np.zeros((240, 320), bool)
        bar[150:175, 20 + 10 * k : 110 + 10 * k] = True
        bar &= ~body
        image[bar] = [40, 40, 210]
        guess = body & ~pale if k in (2, 5) else body.copy()
        if k == 4:
            guess = guess | bar
        images.append(np.clip(image + 2 * rng.standard_normal(image.shape), 0, 255).astype(np.uint8))
        rough.append(np.where(guess, 255, 0).astype(np.uint8))
        bodies.append(body)
    colours = learn(images, rough)
    for k in (2, 4, 5):
        before, after = iou(rough[k] > 0, bodies[k]), iou(colours.segment(images[k]), bodies[k])
        assert before < 0.9 and after > 0.96, (k, before, after)
    assert agrees(bodies[0], rough[0] > 0)
    assert not agrees(~bodies[0], rough[0] > 0)


def test_a_small_second_thing_is_a_warning() -> None:
    body = disc((120, 160), 40, 60, 20)
    with_small = np.where(body | disc((120, 160), 130, 60, 6), 255, 0).astype(np.uint8)
    alone = np.where(body, 255, 0).astype(np.uint8)
    assert "second" in (main_object([with_small] * 10, "v") or "")
    assert main_object([alone] * 10, "v") is None
