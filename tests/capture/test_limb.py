"""The Earth's limb behind a body in orbit: black sky all the same, and no silhouette where it shines."""

from __future__ import annotations

import cv2
import numpy as np

from massprops.capture.limb import always_bright, without
from massprops.capture.motion import judge
from massprops.capture.silhouette import against_sky, sky_level

SHAPE = (90, 120)


def footage(shake: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """(frames, bodies): a bright disc that moves before stars and a limb with clouds that move; `shake` of the camera [px]."""
    rng = np.random.default_rng(2)
    rows, columns = np.mgrid[0 : SHAPE[0], 0 : SHAPE[1]]
    clouds = rng.uniform(90, 220, (SHAPE[0], 400))
    stars = rng.random(SHAPE) > 0.998
    frames, bodies = [], []
    for k in range(24):
        dx, dy = shake * rng.standard_normal(2)
        frame = np.where(stars, 200, 3.0)
        limb = rows + dy > 75 - ((columns + dx - 50) / 40.0) ** 2 * -2.0
        frame[limb] = clouds[:, 5 * k : 5 * k + SHAPE[1]][limb]
        body = np.hypot(columns - 60 - 4 * np.sin(k), rows - 45) < 14 + 2 * np.cos(k)
        frame[body] = 150
        frames.append(np.clip(frame + rng.standard_normal(SHAPE), 0, 255).astype(np.uint8))
        bodies.append(body)
    return np.stack(frames), np.stack(bodies)


def test_a_limb_that_stays_is_black_sky_with_something_beside():
    frames, _ = footage()
    for ordered in (True, False):
        scene = judge(frames, ordered)
        assert (scene.motion, scene.background) == ("tumbling", "black")
    assert judge(footage(shake=6.0)[0], False).motion == "static", "a camera that moves goes round a still object"


def test_a_silhouette_says_nothing_where_the_limb_shines():
    frames, bodies = footage()
    region = always_bright(frames)
    assert region[-1].all() and not region[bodies.all(0)].any(), "the body is bright in all frames too, and stays"
    level, sigma = sky_level(frames)
    for frame, body in zip(frames, bodies, strict=True):
        mask = without(against_sky(np.where(region, np.uint8(level), frame), level, sigma), region)
        seen, own = mask == 255, body & ~region
        about = cv2.dilate(np.uint8(own), np.ones((13, 13), np.uint8)) > 0
        assert seen[own].all() and not (seen & ~about).any()
        assert (mask[region] == 128).all()


def test_a_sky_without_limb_or_stars_is_left_as_it_is():
    frames, bodies = footage()
    bare = np.where(bodies, frames, 3).astype(np.uint8)
    assert not always_bright(bare).any()
