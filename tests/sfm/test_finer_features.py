"""A film that shows few features, matched anew by finer ones along its motion."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scene
import test_mapping
from scipy.spatial.transform import Rotation
from test_free_motion import tumbling
from test_joined_pieces import pieces

from massprops.sfm import finer_features
from massprops.sfm.along_motion import follow_free_motion
from massprops.sfm.convert import to_views
from massprops.sfm.film_starts import MappedFootage
from massprops.sfm.finer_features import with_finer_features
from massprops.sfm.points import project

IMAGES = 16


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """The truth, and a film of 160 features that follows a free motion."""
    given, truth = pieces(tmp_path_factory.mktemp("few"), tumbling(40), which=range(IMAGES))
    (given.footage.folder / "frames").mkdir(exist_ok=True)
    model, following = follow_free_motion(given.found.models[0], given)
    refine = replace(given.options.refine, following=following)
    found = replace(given.found, repeats=True)
    given = replace(given, found=found, options=replace(given.options, refine=refine))
    return truth, MappedFootage(model, given, Path(), [])


def finer(truth, count, turned_deg=0.0):
    """Features of `count` further points at the film's poses, of which every other image is turned by as much."""
    views, points = scene.make(IMAGES, count, seed=8)
    off = Rotation.from_euler("z", turned_deg * (np.arange(IMAGES) % 2)[:, None], degrees=True).as_matrix()
    views = replace(views, R=off @ truth.R, t=np.einsum("nij,nj->ni", off, truth.t))
    v, p = points.obs_view, points.obs_point
    uv = project(views.K[v], views.distortion[v], views.R[v], views.t[v], points.xyz[p])
    uv = uv + 0.1 * np.random.default_rng(3).standard_normal(uv.shape)
    return test_mapping.features(views, replace(points, obs_uv=uv), seed=2)


def looked_for(monkeypatch, found):
    """Numbers of images whose finer features were looked for."""
    asked = []

    def extracted(footage, options, *_):
        assert options.enlarge == 2
        asked.append(len(footage.frames))
        return found, []

    monkeypatch.setattr(finer_features, "extract_all", extracted)
    monkeypatch.setattr(finer_features, "with_denoising", lambda footage, options: options)
    return asked


def fresh(mapped, folder):
    return replace(mapped, given=replace(mapped.given, work=folder / "work"))


def test_finer_features_make_the_attitudes_surer(film, tmp_path, monkeypatch):
    truth, mapped = film
    asked = looked_for(monkeypatch, finer(truth, 480))
    found = with_finer_features(fresh(mapped, tmp_path))
    assert asked == [IMAGES]
    assert found.model.compute_num_observations() > 2 * mapped.model.compute_num_observations()
    before, after = (test_mapping.attitude_error(to_views(m.model)[0], truth) for m in (mapped, found))
    assert after < before < 0.005
    assert found.given.found.database.parent == tmp_path / "work" / "finer"
    assert found.given.options.refine.following.tumble is not mapped.given.options.refine.following.tumble
    assert found.convinces


@pytest.mark.parametrize("turned_deg", [0.3, 20.0])
def test_features_that_follow_another_motion_are_not_taken(film, tmp_path, monkeypatch, turned_deg):
    """Those of a reflection, say: they move from image to image as the motion does not."""
    truth, mapped = film
    asked = looked_for(monkeypatch, finer(truth, 480, turned_deg))
    same = fresh(mapped, tmp_path)
    assert with_finer_features(same) is same and asked


def test_they_are_not_looked_for_without_a_motion_or_where_there_are_many_or_none_repeat(film, tmp_path, monkeypatch):
    truth, mapped = film
    asked = looked_for(monkeypatch, finer(truth, 480))
    given = mapped.given
    alone = replace(
        mapped,
        given=replace(given, options=replace(given.options, refine=replace(given.options.refine, following=None))),
    )
    many = replace(mapped, given=replace(given, found=replace(given.found, features=finer(truth, 520))))
    varied = replace(mapped, given=replace(given, found=replace(given.found, repeats=False)))
    for other in (alone, many, varied):
        assert with_finer_features(other) is other and not asked
