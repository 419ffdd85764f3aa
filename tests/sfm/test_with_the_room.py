"""Where the object's own features hold too few images together, those of the room may."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from massprops.core.progress import silent
from massprops.sfm import best_attempt
from massprops.sfm.attempt import Attempt, SfmOptions
from massprops.sfm.mapping import MappingOptions


def attempts(monkeypatch: pytest.MonkeyPatch, contradicted: float) -> None:
    """The object alone places 25 of 32 images, the room all."""

    def attempt(
        footage: Any, work: Path, options: Any, masked: bool, way: str = "usual", progress: Any = None
    ) -> Attempt:
        model: Any = SimpleNamespace(num_reg_images=lambda: 25 if masked else 32)
        return Attempt(work, MappingOptions(masked=masked), [model], {}, lambda pairs: None, False, False, [])

    monkeypatch.setattr(best_attempt, "attempt", attempt)
    monkeypatch.setattr(best_attempt, "contradictions", lambda *_: SimpleNamespace(share=contradicted))


@pytest.mark.parametrize(
    ("room_stood", "contradicted", "masked"), [(True, 0.0, False), (True, 0.2, True), (False, 0.0, True)]
)
def test_the_room_places_what_the_object_does_not(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, room_stood: bool, contradicted: float, masked: bool
) -> None:
    """But not where it turned with the camera, or against what the object shows."""
    attempts(monkeypatch, contradicted)
    footage: Any = SimpleNamespace(frames=range(32), mask_features=True, has_masks=True, room_stood=room_stood)
    found = best_attempt._best(footage, tmp_path, SfmOptions(), silent)
    assert found.mapping.masked is masked and found.registered == (25 if masked else 32)
    assert any("surroundings" in line for line in found.warnings) is not masked


def test_faint_features_of_the_room_place_what_its_usual_ones_do_not(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A toy on a plain table, turned over (Blender): 13 of 56 images by itself, 4 with the room, 54 with the room's faint features."""
    places = {(True, "usual"): 13, (False, "usual"): 4, (True, "faint"): 15, (False, "faint"): 54}

    def attempt(
        footage: Any, work: Path, options: Any, masked: bool, way: str = "usual", progress: Any = None
    ) -> Attempt:
        model: Any = SimpleNamespace(num_reg_images=lambda: places[masked, way])
        return Attempt(work, MappingOptions(masked=masked), [model], {}, lambda pairs: None, True, False, [])

    monkeypatch.setattr(best_attempt, "attempt", attempt)
    monkeypatch.setattr(best_attempt, "contradictions", lambda *_: SimpleNamespace(share=0.0))
    footage: Any = SimpleNamespace(
        frames=range(56), mask_features=True, has_masks=True, room_stood=True, moving_pictures=False
    )
    found = best_attempt._best(footage, tmp_path, SfmOptions(), silent)
    assert not found.mapping.masked and found.registered == 54
