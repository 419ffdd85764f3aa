"""A still camera that was moved in the middle of a video."""

from __future__ import annotations

import numpy as np
import pytest

from massprops.capture.motion import camera_places, judge


def room(seed: int, size: tuple[int, int] = (60, 80)) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.kron(rng.integers(60, 220, (size[0] // 4, size[1] // 4)), np.ones((4, 4))).astype(np.uint8)


def turning(background: np.ndarray, frames: int, seed: int) -> np.ndarray:
    """Something that changes in the middle of a room that stays, with noise."""
    rng = np.random.default_rng(seed)
    out = np.tile(background, (frames, 1, 1)).astype(int)
    out[:, 20:40, 25:55] = rng.integers(0, 255, (frames, 20, 30))
    return np.clip(out + rng.integers(-3, 4, out.shape), 0, 255).astype(np.uint8)


def test_one_place_of_a_camera_that_stays() -> None:
    assert not camera_places(turning(room(1), 30, 2)).any()


def test_each_place_of_a_camera_that_is_moved_is_told() -> None:
    parts = [turning(room(k), n, k) for k, n in ((1, 14), (2, 9), (3, 12))]
    frames = np.concatenate(parts)
    assert camera_places(frames).tolist() == [0] * 14 + [1] * 9 + [2] * 12
    scene = judge(frames, True, camera_places(frames))
    assert (scene.motion, scene.background) == ("tumbling", "still")


@pytest.mark.parametrize("frames", [4, 40])
def test_a_hand_held_camera_has_one_place(frames: int) -> None:
    moving = np.concatenate([turning(room(k), 1, k) for k in range(frames)])
    assert not camera_places(moving).any()


def test_a_flash_is_no_move() -> None:
    frames = turning(room(1), 30, 2)
    frames[12] = 255
    assert not camera_places(frames).any()
