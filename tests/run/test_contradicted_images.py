"""Matches that contradict a model lower the trust where the images that they are in are taken for one placement."""

import pytest

from massprops.run.stages.mass import _contradicted

SFM = {
    "contradicted_pairs": [
        {"images": ["cam0/a.jpg", "cam0/b.jpg"], "share": 0.2},
        {"images": ["cam0/a.jpg", "cam0/c.jpg"], "share": 0.1},
    ]
}


def test_images_of_one_placement_that_contradict_each_other_count():
    one = {"placements": [{"images": ["cam0/a.jpg", "cam0/b.jpg", "cam0/c.jpg"]}]}
    assert _contradicted(SFM, one) == (pytest.approx(0.3), "a.jpg and b.jpg")
    assert _contradicted(SFM, {"placements": []}) == (pytest.approx(0.3), "a.jpg and b.jpg")


def test_an_object_that_was_turned_over_contradicts_itself_rightly():
    two = {"placements": [{"images": ["cam0/a.jpg", "cam0/c.jpg"]}, {"images": ["cam0/b.jpg"]}]}
    assert _contradicted(SFM, two) == (pytest.approx(0.1), "a.jpg and c.jpg")
    assert _contradicted({"models": []}, two) == (0.0, "")
