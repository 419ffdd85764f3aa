"""Small bodies: features of enlarged images lie where they were, are more, and the mapper is kept from wrong focal lengths."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from massprops.errors import NotPossible
from massprops.sfm import attempt, best_attempt
from massprops.sfm.attempt import Attempt, SfmOptions
from massprops.sfm.features import FeatureOptions, extract
from massprops.sfm.mapping import MappingOptions


def test_an_enlarged_image_has_more_features_at_the_same_places():
    """Blobs of 3 px, between whole pixels; the region's corner is not the image's."""
    rng = np.random.default_rng(0)
    places = np.stack(np.meshgrid(np.arange(60, 160, 14.0), np.arange(50, 140, 14.0)), axis=-1).reshape(-1, 2)
    places += rng.uniform(-0.5, 0.5, places.shape)
    x, y = np.meshgrid(np.arange(220), np.arange(180))
    image = np.full(x.shape, 60.0)
    for u, v in places:
        image += 120 * np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * 1.5**2))
    region = np.zeros(x.shape, bool)
    region[35:155, 45:175] = True
    for options in (FeatureOptions(), FeatureOptions(enlarge=2)):
        found, words = extract(np.clip(image, 0, 255).astype(np.uint8), region, options)
        away = np.linalg.norm(found[:, None, :2] - 0.5 - places[None], axis=2)
        assert len(found) == len(words)
        # every blob has its feature; scale is in pixels of the image as it is
        assert away.min(0).max() < 0.25
        assert np.median(found[away.argmin(0), 2]) == pytest.approx(1.5, rel=0.2)


def test_fine_detail_gives_more_features_enlarged():
    rng = np.random.default_rng(1)
    image = cv2.GaussianBlur(rng.uniform(0, 255, (100, 120)).astype(np.float32), (0, 0), 1.0)
    image = np.clip(127 + 3 * (image - 127), 0, 255).astype(np.uint8)
    usual, _ = extract(image, None, FeatureOptions())
    enlarged, _ = extract(image, None, FeatureOptions(enlarge=2))
    assert len(enlarged) > 2 * len(usual)


def model(*ids):
    return SimpleNamespace(num_reg_images=lambda: len(ids), reg_image_ids=lambda: ids)


@pytest.mark.parametrize(
    ("free", "held", "wanted"),
    [
        ([model(*range(20))], None, [20]),  # all are placed: nothing is held
        ([model(*range(9))], [model(*range(9)), model(*range(9, 18))], [9, 9]),
        ([model(*range(12))], [model(*range(9))], [12]),
        ([model(99, *range(9))], [model(*range(9))], [9]),  # of the first an image is wrong
        ([model(99, *range(9))], [model(99, *range(9))], [10]),  # nothing better is found
    ],
)
def test_the_focal_length_is_held_where_that_gives_more_sound_pieces(monkeypatch, tmp_path, free, held, wanted):
    asked = []

    def mapped(database, frames, out, options, total, progress):
        asked.append(options.fixed_intrinsics)
        if held is None:
            raise NotPossible("")
        return held

    monkeypatch.setattr(attempt, "mapped", lambda *_: free)
    monkeypatch.setattr(attempt, "depth_reversal_resolved", lambda m, mapping: m)
    monkeypatch.setattr(attempt, "map_images", mapped)
    monkeypatch.setattr(attempt, "steady", lambda m, *_: 99 not in m.reg_image_ids())
    shown = SimpleNamespace(folder=tmp_path)
    found = attempt.mapped_in_pieces(tmp_path, shown, tmp_path, MappingOptions(), 20, lambda *_: None)
    assert [m.num_reg_images() for m in found] == wanted
    assert asked == ([] if held is None else [True])


@pytest.mark.parametrize(
    ("pictures", "enlarged", "ways", "placed"),
    [
        (True, [20], ["usual", "enlarged"], 20),
        (True, [10, 9], ["usual", "enlarged"], 10),  # pieces: they are joined later
        (True, [8], ["usual", "enlarged", "faint"], 9),
        (False, [20], ["usual", "faint"], 9),
    ],
)
def test_small_bodies_of_films_are_enlarged_before_fainter_features_are_asked(
    monkeypatch, tmp_path, pictures, enlarged, ways, placed
):
    tried = []

    def one(footage, work, options, masked, way="usual", progress=None):
        tried.append(way)
        sizes = {"usual": [9], "enlarged": enlarged, "faint": [5]}[way]
        models = [model(*range(100 * k, 100 * k + n)) for k, n in enumerate(sizes)]
        return Attempt(work, MappingOptions(masked=True), models, {}, lambda pairs: None, True, False, [])

    monkeypatch.setattr(best_attempt, "attempt", one)
    monkeypatch.setattr(attempt, "steady", lambda *_: True)
    footage = SimpleNamespace(
        frames=range(20), mask_features=True, has_masks=True, room_stood=False, moving_pictures=pictures
    )
    found = best_attempt._best(footage, tmp_path, SfmOptions(), lambda *_: None)
    assert tried == ways
    assert found.registered == placed
