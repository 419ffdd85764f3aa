"""Candidate places, most of them wrong, that agree on one small motion of a model, or on none."""

from dataclasses import replace

import numpy as np
import pytest
import scene
from scipy.spatial.transform import Rotation

from massprops.sfm.consensus import Agreement, Candidates, Spread, agreement, is_significant
from massprops.sfm.points import project

SPREAD = Spread(np.deg2rad(1.5), 0.01, 0.06)


def moved_apart(right, seed=0):
    """Two models of 6 views each, the second 1.5 degrees, 1 % and some hundredths off, and candidates of which a share is right;
    also how the second must be moved."""
    rng = np.random.default_rng(seed)
    views, points = scene.make(12, 200, seed=seed)
    second = np.arange(12) >= 6
    of_second = np.arange(200) >= 100
    turn = Rotation.from_rotvec(np.deg2rad(1.5) * np.array([0.6, -0.64, 0.48])).as_matrix()
    scale, shift = 1.01, np.array([0.05, -0.04, 0.06])
    # x -> scale turn x + shift brings the second model to where it belongs; it lies at the inverse of that
    R, t = views.R.copy(), views.t.copy()
    R[second] = views.R[second] @ turn
    t[second] = (views.t[second] + views.R[second] @ shift) / scale
    xyz = points.xyz.copy()
    xyz[of_second] = (points.xyz[of_second] - shift) @ turn / scale
    seen = of_second[points.obs_point] == second[points.obs_view]
    v, p, uv = points.obs_view[~seen], points.obs_point[~seen], points.obs_uv[~seen]
    kept = rng.permutation(len(v))[:400]
    v, p, uv = v[kept], p[kept], uv[kept]
    laid, own = replace(views, R=R, t=t), replace(points.observed(seen), xyz=xyz)
    thought = project(views.K[v], views.distortion[v], R[v], t[v], xyz[p])
    wrong = thought + rng.uniform(-15, 15, (len(v), 2))
    is_right = rng.random(len(v)) < right
    uv = np.where(is_right[:, None], uv + 0.7 * rng.standard_normal(uv.shape), wrong)
    return laid, own, second, Candidates(p, v, uv), (scale, turn, shift), is_right


@pytest.mark.parametrize("right", [0.25, 0.6])
def test_the_right_ones_are_found_and_believed(right):
    views, points, second, candidates, (scale, turn, shift), is_right = moved_apart(right)
    found = agreement(views, points, second, candidates, SPREAD, np.random.default_rng(1))
    assert found is not None and found.beyond_chance
    assert np.rad2deg(Rotation.from_matrix(turn.T @ found.R).magnitude()) < 0.4
    assert abs(found.scale / scale - 1) < 0.004
    assert np.linalg.norm(found.t - shift) < 0.04
    assert found.agree[is_right].mean() > 0.85
    assert found.agree[~is_right].mean() < 0.15


def test_places_that_agree_on_nothing_are_not_believed():
    for seed in range(5):
        views, points, second, candidates, *_ = moved_apart(0.0, seed)
        found = agreement(views, points, second, candidates, SPREAD, np.random.default_rng(seed))
        assert found is not None and not found.beyond_chance


def test_few_points_say_nothing():
    views, points, second, candidates, *_ = moved_apart(1.0)
    few = candidates.take(np.flatnonzero(np.isin(candidates.point, np.unique(candidates.point)[:10])))
    assert agreement(views, points, second, few, SPREAD, np.random.default_rng(0)) is None


def agreed(tried, found, chance=0.0):
    return Agreement(1.0, np.eye(3), np.zeros(3), np.zeros(0, bool), tried, found, chance, -100.0)


@pytest.mark.parametrize(
    ("found", "wrong", "wanted"),
    [
        # a cratered body: 0.10 of the points, and 0.055 where it is turned by 25 degrees
        (agreed(865, 89, 28.1), [agreed(400, n) for n in (23, 29, 11, 22, 25)], True),
        # the same turned by 10 and by 40 degrees: chance alone would believe both, at -21 and -20
        (agreed(1179, 76, 35.0), [agreed(400, n) for n in (23, 29, 11, 22, 25)], False),
        (agreed(1781, 117, 65.4), [agreed(400, n) for n in (23, 29, 11, 22, 25)], False),
        (agreed(197, 54, 6.9), [agreed(305, 7), None, agreed(330, 19)], True),
        (agreed(60, 30, 1.0), [None] * 5, True),  # elsewhere nothing is a candidate
        (agreed(60, 6, 3.0), [None] * 5, False),
    ],
)
def test_a_placement_must_stand_out_from_wrong_ones(found, wrong, wanted):
    assert is_significant(found, wrong) is wanted
