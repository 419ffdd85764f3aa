"""How far an unmeasured side reaches, by the centre of mass that the motion shows."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from massprops.surface.fill_by_motion import Balance, Cut, balanced, centre_of, fill_centres, tells
from massprops.surface.spread import balancing, with_rivals

USUAL = 1 / 3


def half_measured(reach: float) -> Cut:
    """A ball of which the lower half was not measured: filled to `reach` of its depth, and a membrane across its rim."""
    ball = trimesh.creation.icosphere(3)
    vertices = np.asarray(ball.vertices, float)
    below = vertices[:, 2] < -0.05
    filled, membrane = vertices.copy(), vertices.copy()
    filled[below, 2] *= reach
    membrane[below, 2] = -0.1
    return Cut(filled, np.asarray(ball.faces), ~below, membrane)


def known(cut: Cut, share: float, sigma: float) -> Balance:
    return Balance(centre_of(cut.at(share), cut.faces), sigma**2 * np.eye(3))


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_the_fill_reaches_as_far_as_the_body_balances(share: float) -> None:
    cut = half_measured(1.6)
    (found,) = balanced({0.02: fill_centres(cut)}, USUAL, known(cut, share, 1e-3))
    assert (
        found.pull == 0.02 and found.chance == pytest.approx(1.0) and found.membrane == pytest.approx(share, abs=0.06)
    )


def test_a_centre_that_is_hardly_known_leaves_the_usual_fill() -> None:
    cut = half_measured(1.6)
    balance = known(cut, 1.0, 10.0)
    assert not tells(cut, balance)
    assert balanced({0.02: fill_centres(cut)}, USUAL, balance)[0].membrane == pytest.approx(USUAL, abs=0.1)


def test_another_pull_is_taken_where_only_its_body_balances() -> None:
    wide, narrow = half_measured(3.0), half_measured(0.5)
    wide = Cut(wide.vertices, wide.faces, wide.measured, wide.at(0.2))
    ways = {0.02: fill_centres(wide), 0.0: fill_centres(narrow)}
    for pull, cut in ((0.0, narrow), (0.02, wide)):
        first, second = balanced(ways, USUAL, known(cut, 0.3, 1e-3))
        assert first.pull == pull and second.chance < 0.01 and first.chance + second.chance == pytest.approx(1.0)
    first, second = balanced(ways, USUAL, known(wide, 0.3, 10.0))
    assert second.chance > 0.3


def test_later_steps_that_move_the_centre_are_counted() -> None:
    cut, shift = half_measured(1.6), np.array([0.0, 0.0, 0.12])
    here = known(cut, 0.5, 1e-3)
    moved = Balance(here.place + shift, here.covariance)
    assert balanced({0.02: fill_centres(cut)}, USUAL, moved, shift)[0].membrane == pytest.approx(0.5, abs=0.06)
    assert balanced({0.02: fill_centres(cut)}, USUAL, moved)[0].membrane > 0.6


def test_replicates_are_filled_another_way_as_often_as_that_is_likely() -> None:
    rows, change = np.ones((4000, 10)), 0.1 * np.arange(10)
    drawn = with_rivals(rows, [(0.2, change), (0.1, -change)], np.random.default_rng(3))
    assert np.mean(drawn[:, 9] > 1) == pytest.approx(0.2, abs=0.02)
    assert np.mean(drawn[:, 9] < 1) == pytest.approx(0.1, abs=0.02)
    assert np.array_equal(with_rivals(rows, [], np.random.default_rng(3)), rows)


def test_replicates_that_do_not_balance_did_not_happen() -> None:
    """Bodies that differ by the depth of one side: their centres tell which it is, and so the volume."""
    rng = np.random.default_rng(0)
    own = np.array([1.0, 0.0, 0.0, 0.2, *np.zeros(6)])
    depth = 0.2 * rng.standard_normal(2000)
    rows = own + np.outer(depth, [1.0, 0.0, 0.0, -0.4, *np.zeros(6)])
    lengths = 2.0 + depth
    # a depth of 0.1 moves the centre down by 0.06
    balance = Balance(np.array([0.0, 0.0, 0.14]), 0.006**2 * np.eye(3))
    moved, longer = balancing(rows, lengths, own, balance, rng)
    assert moved[:, 0].mean() == pytest.approx(1.1, abs=0.005) and longer.mean() == pytest.approx(2.1, abs=0.005)
    assert moved[:, 0].std() == pytest.approx(0.01, rel=0.15)
    same, _ = balancing(rows, lengths, own, balance.widened(100.0), rng)
    assert same[:, 0].std() == pytest.approx(0.2, rel=0.1)


def test_replicates_whose_centres_miss_the_motions_are_spread_by_as_much() -> None:
    rng = np.random.default_rng(2)
    own = np.array([1.0, 0.0, 0, 0, 0.2, 0.2, 0.2, 0, 0, 0])
    drawn = 0.01 * rng.standard_normal((4000, 3))
    rows = np.tile(own, (4000, 1))
    rows[:, 1:4] += drawn
    rows[:, 4] += 0.02 * rng.standard_normal(4000)
    lengths = np.full(4000, 2.0)
    for missed, wider in ((0.01, 1.0), (0.06, 0.06 / 0.01 / np.sqrt(3))):
        balance = Balance(np.array([missed, 0, 0]), 1e-8 * np.eye(3))
        moved, _ = balancing(rows, lengths, own, balance, np.random.default_rng(3))
        assert moved[:, 4].std() == pytest.approx(0.02 * wider, rel=0.05)
        assert moved[:, 4].mean() == pytest.approx(0.2, abs=0.005)
