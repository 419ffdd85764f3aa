"""The Earth's limb behind a body in orbit: black sky all the same, and no silhouette where it shines."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from massprops.capture.limb import always_bright, without
from massprops.capture.motion import judge
from massprops.capture.silhouette import against_sky, sky_level
from massprops.run.job import Job, ReconstructOptions
from massprops.run.stage_images import mask_for_stereo
from massprops.views import Views

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


def test_stereo_does_not_measure_the_limb(tmp_path: Path):
    views = Views(
        names=("cam0/a.png", "cam0/b.png"), timestamp_ns=np.arange(2), size=np.tile([120, 90], (2, 1)),
        K=np.tile(np.eye(3), (2, 1, 1)), distortion=np.zeros((2, 4)), R=np.tile(np.eye(3), (2, 1, 1)), t=np.zeros((2, 3)),
    )  # fmt: skip
    region = np.zeros(SHAPE, np.uint8)
    region[70:] = 255
    mask = np.full(SHAPE, 255, np.uint8)
    mask[70:] = mask[:5] = 128
    (tmp_path / "work/capture/beside").mkdir(parents=True)
    (tmp_path / "work/silhouettes/masks/cam0").mkdir(parents=True)
    cv2.imwrite(str(tmp_path / "work/capture/beside/0.png"), region)
    for name in views.names:
        cv2.imwrite(str(tmp_path / "work/silhouettes/masks" / f"{name}.png"), mask)
    frames = [{"name": "cam0/a.png", "beside": "beside/0.png"}, {"name": "cam0/b.png"}]
    job = Job(tmp_path, ReconstructOptions(), tmp_path / "out")
    found = [mask_for_stereo(job, views, i, {"frames": frames}) for i in range(2)]
    assert (found[0] == np.where(region > 0, 0, mask)).all(), "the body's unlit parts stay unknown, and are measured"
    assert (found[1] == mask).all()
