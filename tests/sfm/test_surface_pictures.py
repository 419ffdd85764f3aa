"""Which images show a surface that stands with the model, for the last adjustment."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from massprops.sfm import surface_pictures
from massprops.sfm.surface_tracks import PIXELS, ROOM_PIXELS
from massprops.views import Views

WIDTH, HEIGHT, FOCAL = 80, 60, 100.0


def orbit(n: int = 6) -> Views:
    """Cameras two units from the origin that look at it."""
    turn = np.linspace(0, 2 * np.pi, n, endpoint=False)
    forward = -np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    down = np.tile([0.0, 0.0, -1.0], (n, 1))
    R = np.stack([np.cross(down, forward), down, forward], axis=1)
    K = np.array([[FOCAL, 0, (WIDTH - 1) / 2], [0, FOCAL, (HEIGHT - 1) / 2], [0, 0, 1]])
    return Views(
        tuple(f"{i}.png" for i in range(n)), np.full(n, -1), np.tile([WIDTH, HEIGHT], (n, 1)), np.tile(K, (n, 1, 1)),
        np.zeros((n, 4)), R, np.tile([0.0, 0.0, 2.0], (n, 1)),
    )  # fmt: skip


def footage(folder: Path, views: Views, stood: bool, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Grey frames on disk; the silhouettes are their upper halves."""
    for name in views.names:
        cv2.imwrite(str(folder / name), np.full((HEIGHT, WIDTH, 3), 128, np.uint8))
    half = np.repeat(np.array([255, 0], np.uint8), HEIGHT // 2)[:, None] * np.ones((1, WIDTH), np.uint8)
    monkeypatch.setattr(surface_pictures, "read_mask", lambda *_: half)
    frames = [SimpleNamespace(name=name, turn=0) for name in views.names]
    return SimpleNamespace(
        frames=frames, room_stood=stood, size=lambda _: (WIDTH, HEIGHT), image=lambda name: folder / name
    )


def test_a_still_scene_shows_all_that_the_cameras_look_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    views = orbit()
    image, pixels = surface_pictures.surface_pictures(footage(tmp_path, views, True, monkeypatch), views, masked=False)
    assert image is not None and pixels == ROOM_PIXELS
    for i in range(len(views)):
        colour, mask = image(i)
        assert colour.shape == (HEIGHT, WIDTH, 3)
        # a disc about the middle that reaches to the longer sides' middles, and not into the corners
        assert mask[HEIGHT // 2, WIDTH // 2] == mask[2, WIDTH // 2] == mask[HEIGHT - 3, WIDTH // 2] == 255
        assert not mask[0, 0] and not mask[HEIGHT // 2, 2]


def test_where_the_objects_own_features_were_used_its_silhouettes_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    views = orbit()
    image, pixels = surface_pictures.surface_pictures(footage(tmp_path, views, True, monkeypatch), views, masked=True)
    assert image is not None and pixels == PIXELS
    mask = image(0)[1]
    assert mask[: HEIGHT // 2].all() and not mask[HEIGHT // 2 :].any()


def test_before_a_room_that_did_not_stand_nothing_is_looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    views = orbit()
    assert (
        surface_pictures.surface_pictures(footage(tmp_path, views, False, monkeypatch), views, masked=False)[0] is None
    )
