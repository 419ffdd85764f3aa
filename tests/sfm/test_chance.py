"""Pairs whose agreement chance explains are told from pairs that show the same things."""

import itertools

import numpy as np
import pycolmap
import scene
import test_mapping

from massprops.sfm.chance import drop_chance, expected_by_chance
from massprops.sfm.database import write_database
from massprops.sfm.mapping import MappingOptions, quiet, verify


def test_matches_by_chance_make_no_pair_and_right_ones_do(tmp_path):
    quiet()
    rng = np.random.default_rng(0)
    views, points = scene.make(7, 80, focal=820.0, noise=0.3)
    database = tmp_path / "database.db"
    ids = write_database(database, test_mapping.footage(views), test_mapping.features(views, points))
    pairs = list(itertools.combinations(views.names, 2))
    matches = {pair: np.column_stack([rng.permutation(80)[:60], rng.permutation(80)[:60]]) for pair in pairs}
    right = {pairs[0], pairs[3]}
    for pair in right:
        matches[pair][:25] = np.arange(25)[:, None]
    matches = {
        pair: m[np.sort(np.unique(m[:, 1], return_index=True)[1])].astype(np.uint32) for pair, m in matches.items()
    }
    verify(database, ids, matches, MappingOptions(masked=True, least_matches=10, most_trials=3000, threads=1))
    before = agreeing(database, ids)
    assert before > right and len(before) > 5, "chance must have made some pairs, or nothing is tested"
    gone = drop_chance(database, 0)
    assert agreeing(database, ids) == right
    assert gone == len(before) - len(right)


def agreeing(database, ids):
    """Names of the pairs with a geometry."""
    names = {i: n for n, i in ids.items()}
    with pycolmap.Database.open(database) as db:
        pair_ids, geometries = db.read_two_view_geometries()
    found = [
        pycolmap.pair_id_to_image_pair(p) for p, g in zip(pair_ids, geometries, strict=True) if len(g.inlier_matches)
    ]
    return {(names[a], names[b]) for a, b in found}


def test_agreement_at_random_is_expected_and_more_is_not():
    rng = np.random.default_rng(1)
    random = rng.uniform(0, 100, 2000)
    # the distance of every match is as that of random ones
    assert min(expected_by_chance(rng.uniform(0, 100, 60), random) for _ in range(50)) > 0
    few = np.concatenate([rng.uniform(0, 0.5, 18), rng.uniform(0, 100, 42)])
    assert expected_by_chance(few, random) < -10
    # the same where features crowd, so that random matches are near the lines too
    assert expected_by_chance(few, rng.uniform(0, 3, 2000)) > -10
