"""Photographs whose matches contradict each other: an object moved in its room, sides that look alike."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pycolmap
import pytest
import scene
from scipy.spatial.transform import Rotation
from sfm.test_sound import to_model

from massprops.core.progress import silent
from massprops.sfm import contradicted
from massprops.sfm.alike_sides import lacking
from massprops.sfm.attempt import Attempt, SfmOptions
from massprops.sfm.contradictions import Contradictions
from massprops.sfm.mapping import MappingOptions
from massprops.sfm.own_features import FeaturePlaces, Motion, label, motions

IMAGES, OWN, ROOM = 6, 60, 90


def photographs(rng: np.random.Generator) -> tuple[FeaturePlaces, np.ndarray]:
    """Features of an object below the middle of each image, in front of a room, and which are its own."""
    place = [
        np.concatenate([rng.normal((0.02 * i, 0.12), 0.07, (OWN, 2)), rng.uniform(-0.5, 0.5, (ROOM, 2))])
        for i in range(IMAGES)
    ]
    for of_image in place:  # the object hides the room behind it
        room = of_image[OWN:]
        room[np.linalg.norm(room - (0.05, 0.12), axis=1) < 0.15] += (0.0, 0.35)
    own = np.tile(np.arange(OWN + ROOM) < OWN, IMAGES)
    return FeaturePlaces(np.concatenate(place), np.repeat(np.arange(IMAGES), OWN + ROOM)), own


def seen_by_two(first: int, second: int, kind: slice, every: int) -> np.ndarray:
    """Matches of two images: every so manieth feature of the object or the room."""
    index = np.arange(OWN + ROOM)[kind][::every]
    return np.column_stack([first * (OWN + ROOM) + index, second * (OWN + ROOM) + index])


def test_an_object_that_was_moved_is_told_from_its_room() -> None:
    """Three images show it so, three moved: the room has more matches across."""
    features, own = photographs(np.random.default_rng(0))
    found, pair = [], 0
    for i in range(IMAGES):
        for j in range(i + 1, IMAGES):
            of_object, of_room = seen_by_two(i, j, slice(OWN), 2), seen_by_two(i, j, slice(OWN, None), 1)
            if i // 3 == j // 3:
                found.append(Motion(pair, np.concatenate([of_object, of_room])))
            else:
                found += [Motion(pair, of_room), Motion(pair, of_object)]
            pair += 1
    told = label(features, found)
    assert told is not None and np.mean(told == own) > 0.95


def test_an_object_that_stood_still_shows_one_motion() -> None:
    features, _ = photographs(np.random.default_rng(1))
    assert label(features, [Motion(0, seen_by_two(0, 1, slice(None), 1))]) is None


def test_two_motions_of_a_pair_are_found() -> None:
    rng = np.random.default_rng(2)
    camera = pycolmap.Camera.create_from_model_id(1, pycolmap.CameraModelId.SIMPLE_PINHOLE, 1000.0, 1280, 960)
    own, room = rng.uniform(-0.5, 0.5, (80, 3)) + (0, 0, 6), rng.uniform(-3, 3, (160, 3)) + (0, 0, 9)
    turn = Rotation.from_euler("y", 25, degrees=True).as_matrix()

    def seen(x: np.ndarray) -> np.ndarray:
        return 1000 * x[:, :2] / x[:, 2:] + (640, 480)

    before = seen(np.concatenate([own, room]))
    after = seen(np.concatenate([(own - (0, 0, 6)) @ turn.T + (0, 0, 6), room + (0.6, 0.1, 0.0)]))
    index = np.arange(240)
    matches = np.column_stack([index, index])
    options = MappingOptions()
    both = motions(matches, matches[80:], [(camera, before), (camera, after)], options)
    assert len(both) == 2 and set(both[1][:, 0].tolist()) <= set(range(80)) and len(both[1]) > 70
    still = motions(matches[80:], matches[80:], [(camera, before), (camera, after)], options)
    assert len(still) == 1
    assert motions(matches, matches[:5], [(camera, before), (camera, after)], options) == []


def model_of(images: int) -> Any:
    """A model of so many images."""
    ids = range(images)
    return SimpleNamespace(
        num_reg_images=lambda: images, reg_image_ids=lambda: ids, image=lambda i: SimpleNamespace(name=str(i))
    )


def prints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, true_from: int) -> tuple[Attempt, Any]:
    """An attempt of 20 images that is contradicted as long as pairs with fewer matches are believed."""
    database = tmp_path / "all.db"
    database.write_text("0")

    def least(path: Path) -> int:
        return int(path.read_text())

    def dropped(path: Path, pairs: list[tuple[int, int]]) -> None:
        if pairs:
            path.write_text(str(pairs[0][0]))

    def against(_: object, path: Path) -> Contradictions:
        wrong = least(path) < true_from
        return Contradictions(0.2 * wrong, (("0", "1"),) * wrong, (0.2,) * wrong)

    for name, stub in {
        "_weak": lambda path, n: [(n, n)],
        "drop_pairs": dropped,
        "own_features": lambda *_: {},
        "wrongly_joined": lambda *_: set(),
        "_unchanged": lambda *_: False,
        "mapped": lambda path, *_: [model_of(20 - least(path) // 10)],
        "contradictions": against,
    }.items():
        monkeypatch.setattr(contradicted, name, stub)
    features = {str(i): (np.zeros((1, 4)), np.zeros((1, 128))) for i in range(20)}
    found = Attempt(database, MappingOptions(), [model_of(20)], features, lambda pairs: None, False, False, [])
    return found, least


def in_order(images: int) -> Any:
    """Footage of images named by their numbers."""
    return SimpleNamespace(frames=[SimpleNamespace(name=str(i)) for i in range(images)])


def test_an_object_that_was_turned_over_once_is_left_to_its_placements() -> None:
    across = Contradictions(0.2, (("3", "12"), ("2", "11")), (0.15, 0.05))
    assert contradicted._turned_once(across, in_order(20))
    assert not contradicted._turned_once(Contradictions(0.2, (("3", "12"), ("2", "5")), (0.15, 0.05)), in_order(20))
    late = Contradictions(0.2, (("3", "18"), ("17", "18")), (0.1, 0.1))
    assert not contradicted._turned_once(late, in_order(20))


def test_pairs_with_few_matches_are_given_up_until_nothing_contradicts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, least = prints(tmp_path, monkeypatch, 45)
    settled = contradicted.without_contradictions(found, in_order(20), tmp_path / "work", SfmOptions(), silent)
    assert settled.matches_required == 45 and settled.registered == 16
    assert settled.warnings == [
        "sides of the object look alike: pairs of images with fewer than 45 matches were given up, as they contradict the rest"
    ]
    assert least(found.database) == 0  # what was found before stays as it was


@pytest.mark.parametrize("true_from", [0, 1000])
def test_what_is_borne_out_stays_and_so_does_what_never_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, true_from: int
) -> None:
    found, _ = prints(tmp_path, monkeypatch, true_from)
    assert contradicted.without_contradictions(found, in_order(20), tmp_path / "work", SfmOptions(), silent) is found


@pytest.mark.parametrize(("turned", "lost", "same"), [(0, 0, True), (2, 1, True), (8, 0, False), (0, 8, False)])
def test_what_leaves_the_cameras_where_they_were_changes_nothing(turned: int, lost: int, same: bool) -> None:
    """Of 12 images, of which the last are contradicted, some turned or lost; the rest lie in other axes."""
    views, points = scene.make(12, 40)
    other = Rotation.from_euler("xyz", (20, 50, 10), degrees=True).as_matrix()
    R = views.R @ other
    R[:turned] = (
        Rotation.from_euler("y", np.arange(40, 40 + 30 * turned, 30)[:, None], degrees=True).as_matrix() @ R[:turned]
    )
    moved = replace(views, R=R, t=views.t)
    shown = moved.take(np.arange(lost, 12))
    kept = points.observed(points.obs_view >= lost)
    kept = replace(kept, obs_view=kept.obs_view - lost)
    against = Contradictions(0.2, ((views.names[7], views.names[8]),), (0.2,))
    before, after = (
        Attempt(Path(), MappingOptions(), [to_model(v, p)], {}, lambda pairs: None, False, False, [])
        for v, p in ((views, points), (shown, kept))
    )
    assert contradicted._unchanged(before, after, against) is same


def round_of(images: int, step_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """Matches of images that went round a body, and the angles at which they were taken."""
    at = step_deg * np.arange(images)
    away = np.abs((at[:, None] - at + 180) % 360 - 180)
    return np.where(away < 60, np.round(300 * np.exp(-away / 20)), 0) * (away > 0), at


def likely(at: np.ndarray) -> np.ndarray:
    """Which of images taken at some angles look from like directions."""
    away = np.abs((at[:, None] - at + 180) % 360 - 180)
    return (away < 25) & ~np.eye(len(at), dtype=bool)


def test_a_branch_that_lacks_what_its_neighbours_share_shows_another_side() -> None:
    """Of 24 images all round, five of the far side laid on the near one by a print of 35 matches."""
    count, at = round_of(24, 15.0)
    assert lacking(list(range(24)), count, likely(at)) == set()
    folded = at.copy()
    folded[10:15] -= 180
    for i in range(10, 15):
        count[i, :10], count[i, 15:] = 0, 0
        count[:10, i], count[15:, i] = 0, 0
    count[12, 0] = count[0, 12] = 35
    assert lacking(list(range(24)), count, likely(folded)) == {10, 11, 12, 13, 14}


def test_a_weak_link_to_another_direction_is_none_the_worse() -> None:
    """Two series that share one pair across an edge, where nothing else could be shared."""
    count, at = round_of(12, 10.0)
    both = np.zeros((24, 24))
    both[:12, :12] = both[12:, 12:] = count
    both[11, 12] = both[12, 11] = 25
    assert lacking(list(range(24)), both, likely(np.concatenate([at, at + 160]))) == set()
