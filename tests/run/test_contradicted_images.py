"""Matches that contradict a model lower the trust where they are the object's and their images are taken for one placement."""

import itertools
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from massprops.run.stages.mass import _contradicted
from massprops.sfm.verified_matches import NEAR_IN_TIME, Film, VerifiedMatches, said_against

NAMES = ("cam0/a.jpg", "cam0/b.jpg", "cam0/c.jpg")
OBJECT, TABLE = 10.0, 40.0


def a_run(folder: Path, *counts: tuple[str, str, float, int, int]) -> SimpleNamespace:
    """A run whose images show the object in their left half. Counts: two images, where their matches lie, how many there are,
    and how many of them lie where the model says."""
    job = SimpleNamespace(work=lambda stage: folder / stage)
    (folder / "sfm").mkdir()
    masks = folder / "silhouettes" / "masks"
    mask = np.zeros((30, 60), np.uint8)
    mask[:, :30] = 255
    for name in NAMES:
        (masks / name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(masks / f"{name}.png"), mask)
    pairs = tuple(dict.fromkeys((a, b) for a, b, *_ in counts))
    pair = [i for a, b, _, n, _ in counts for i in [pairs.index((a, b))] * n]
    places = [[x, 10.0, x, 10.0] for *_, x, n, _ in counts for _ in range(n)]
    near = [k < right for *_, n, right in counts for k in range(n)]
    VerifiedMatches(pairs, np.array(pair), np.array(places), np.array(near)).save(folder / "sfm" / "matches.npz")
    return job


A, B, C = NAMES
ONE = {"placements": [{"images": list(NAMES)}]}


def test_the_objects_own_contradictions_count(tmp_path: Path) -> None:
    job = a_run(tmp_path, (A, B, OBJECT, 100, 100), (B, C, OBJECT, 100, 10), (A, C, OBJECT, 100, 90))
    assert _contradicted(job, ONE) == (pytest.approx(1 / 3), "b.jpg and c.jpg")
    assert _contradicted(job, {"placements": []}) == (pytest.approx(1 / 3), "b.jpg and c.jpg")


def test_an_object_that_was_turned_over_contradicts_itself_rightly(tmp_path: Path) -> None:
    job = a_run(tmp_path, (A, B, OBJECT, 100, 0), (A, C, OBJECT, 100, 100))
    two = {"placements": [{"images": [A, C]}, {"images": [B]}]}
    assert _contradicted(job, two) == (0.0, "")


def test_a_pattern_that_repeats_about_the_object_says_nothing_of_it(tmp_path: Path) -> None:
    """Tiles, a period off, beside matches of a shoe that bear the model out (Blender)."""
    own = [(A, B, OBJECT, 60, 60), (B, C, OBJECT, 60, 60)]
    job = a_run(tmp_path, *own, (A, C, TABLE, 200, 0), (A, B, TABLE, 200, 0))
    assert _contradicted(job, ONE) == (0.0, "")


def test_surroundings_that_alone_place_an_image_count(tmp_path: Path) -> None:
    job = a_run(tmp_path, (A, B, OBJECT, 60, 60), (A, C, TABLE, 100, 0), (B, C, TABLE, 40, 40))
    assert _contradicted(job, ONE) == (pytest.approx(0.5), "a.jpg and c.jpg")


def test_a_handful_of_matches_on_the_object_is_no_opinion_of_all_images(tmp_path: Path) -> None:
    job = a_run(tmp_path, (A, B, OBJECT, 30, 0), (A, B, TABLE, 500, 500), (B, C, TABLE, 500, 500))
    assert _contradicted(job, ONE)[0] == pytest.approx(1 / 3)


def test_a_model_without_contradictions_keeps_no_matches(tmp_path: Path) -> None:
    assert _contradicted(SimpleNamespace(work=lambda stage: tmp_path / stage), ONE) == (0.0, "")


def test_sides_that_look_alike_do_not_speak_against_a_film_that_leads_from_one_to_the_other(tmp_path: Path) -> None:
    """Of a figure on a turntable each image matched the fifth after it as well, a turn of 45 degrees on (Blender)."""
    steps = [(A, B, OBJECT, 60, 60), (B, C, OBJECT, 60, 60)]
    job = a_run(tmp_path, *steps, (A, C, OBJECT, 40, 4))
    assert _contradicted(job, ONE) == (pytest.approx(0.25), "a.jpg and c.jpg")
    assert _contradicted(job, ONE, Film(NAMES)) == (0.0, "")
    assert _contradicted(job, ONE, Film((A, C)))[0] == pytest.approx(0.25), "nothing leads from one to the other"


def test_a_step_that_is_not_borne_out_leads_nowhere(tmp_path: Path) -> None:
    job = a_run(tmp_path, (A, B, OBJECT, 60, 60), (B, C, OBJECT, 60, 6), (A, C, OBJECT, 40, 4))
    assert _contradicted(job, ONE, Film(NAMES))[0] == pytest.approx(100 / 160)


@pytest.mark.parametrize("turning", [True, False])
def test_a_turntables_plate_leads_past_a_plain_side(tmp_path: Path, turning: bool) -> None:
    """Of another figure neighbours shared two features of its own, and 200 of its plate; the fifth image after each, 35 of its own."""
    steps = [(A, B, TABLE, 200, 200), (A, B, OBJECT, 2, 2), (B, C, TABLE, 200, 200), (B, C, OBJECT, 60, 60)]
    job = a_run(tmp_path, *steps, (A, C, OBJECT, 40, 4))
    share, worst = _contradicted(job, ONE, Film(NAMES, turning))
    assert (share, worst) == ((0.0, "") if turning else (pytest.approx(0.4), "a.jpg and c.jpg"))


@pytest.mark.parametrize(("steps", "share"), [(NEAR_IN_TIME, 0.0), (NEAR_IN_TIME + 1, 0.1)])
def test_the_errors_of_many_steps_may_add_up(steps: int, share: float) -> None:
    film = [f"{i:02d}.png" for i in range(steps + 1)]
    pairs = (*itertools.pairwise(film), (film[0], film[-1]))
    pair = np.repeat(np.arange(steps + 1), 50)
    matches = VerifiedMatches(pairs, pair, np.zeros((len(pair), 4)), pair < steps)
    assert said_against(matches, np.ones(len(pair), bool), Film(tuple(film)))[0] == pytest.approx(share)
