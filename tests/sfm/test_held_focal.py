"""A film whose first images show too little perspective is placed with a focal length that is held at first."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from massprops.errors import NotPossible
from massprops.sfm import reconstruct as module
from massprops.sfm.footage import CameraRecord, FootageRecord
from massprops.sfm.held_focal import with_held_focal

FILM = FootageRecord(Path("x"), "x.mp4", "video", "tumbling", "black", True, (CameraRecord(0, (720, 540)),), ())


def test_a_film_of_a_turning_body_is_held_at_a_usual_focal_length_and_nothing_else_is() -> None:
    held = with_held_focal(FILM)
    assert held is not None
    assert held.cameras[0].focal_px == pytest.approx(1.2 * 720) and held.cameras[0].focal_source == "given"
    known = replace(FILM, cameras=(replace(FILM.cameras[0], focal_px=900.0, focal_source="exif"),))
    assert with_held_focal(known).cameras[0].focal_px == 900.0
    given = replace(FILM, cameras=(replace(FILM.cameras[0], focal_px=900.0, focal_source="given"),))
    assert with_held_focal(given) is None
    assert with_held_focal(replace(FILM, motion="static")) is None
    assert with_held_focal(replace(FILM, kind="images")) is None
    assert with_held_focal(replace(FILM, kind="stereo")) is None


def test_what_is_refused_both_ways_is_refused_for_the_first_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[float | None] = []

    def refused(
        footage: FootageRecord, work: Path, options: object, progress: object, held: FootageRecord | None
    ) -> None:
        assert work.is_dir() and not list(work.iterdir())
        (work / "database.db").touch()
        asked.append(held and held.cameras[0].focal_px)
        raise NotPossible("held" if held else "free")

    monkeypatch.setattr(module, "_reconstruct", refused)
    with pytest.raises(NotPossible, match="free"):
        module.reconstruct(FILM, tmp_path)
    assert asked == [None, pytest.approx(864.0)]
    (tmp_path / "database.db").unlink()
    asked.clear()
    with pytest.raises(NotPossible, match="free"):
        module.reconstruct(replace(FILM, motion="static"), tmp_path)
    assert asked == [None]
