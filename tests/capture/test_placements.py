"""Which image shows which placement of an object, in a room that stayed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from massprops.capture.placements import (
    agreed_between_pauses,
    divide,
    divide_at_pauses,
    fill_undecided,
    find_placements,
    small_ones_filled,
    without_return,
)
from massprops.dense.region import Region


def ring(n: int, phase: float = 0.0) -> np.ndarray:
    turn = np.linspace(0, 2 * np.pi, n, endpoint=False) + phase
    d = np.column_stack([np.cos(turn), np.sin(turn), np.full(n, 0.7)])
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def shared(direction: np.ndarray, placement: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Features in common: many between neighbours of one placement, none from afar or across."""
    angle = np.degrees(np.arccos(np.clip(direction @ direction.T, -1, 1)))
    mean = np.where(placement[:, None] == placement[None], 30 * np.exp(-((angle / 18) ** 2)), 0.02)
    count = rng.poisson(mean)
    return np.triu(count, 1) + np.triu(count, 1).T


def test_two_placements_are_told_apart() -> None:
    rng = np.random.default_rng(0)
    direction = np.concatenate([ring(24), ring(18, 0.1)])
    placement = np.repeat([0, 1], [24, 18])
    label = divide(shared(direction, placement, rng), direction)
    assert np.array_equal(label, placement), "the larger one is first"


def test_a_placement_with_few_features_beside_one_with_many() -> None:
    """What 28 + 28 images (Blender) of a machined part share: its flat base shows many features, its other side few."""
    with np.load(Path(__file__).parent / "data" / "turned_part.npz", allow_pickle=False) as z:
        counts, direction = z["shared"].astype(int), z["direction"].astype(float)
    label = divide(counts, direction)
    told, first = label >= 0, np.arange(56) < 28
    assert told.mean() > 0.8 and set(label[told]) == {0, 1}
    assert np.array_equal(label[told] == label[0], first[told])


def test_three_placements_too_and_an_image_of_none() -> None:
    rng = np.random.default_rng(1)
    direction = np.concatenate([ring(24), ring(20, 0.1), ring(16, 0.2), ring(1, 0.3)])
    placement = np.repeat([0, 1, 2, 3], [24, 20, 16, 1])
    label = divide(shared(direction, placement, rng), direction)
    assert np.array_equal(label, np.where(placement == 3, -1, placement))


def test_one_placement_is_not_divided() -> None:
    """The two halves of a ring share little, but they are not seen from the same directions."""
    rng = np.random.default_rng(2)
    for n in (16, 24, 50):
        direction = ring(n)
        assert not divide(shared(direction, np.zeros(n, int), rng), direction).any()


def test_a_placement_of_a_few_images_from_one_side() -> None:
    """Seven images of one face against a whole ring: most of the ring has no partner among them."""
    rng = np.random.default_rng(4)
    direction = np.concatenate([ring(60)[:7], ring(36, 0.05)])
    placement = np.repeat([1, 0], [7, 36])
    assert np.array_equal(divide(shared(direction, placement, rng), direction), placement)


def test_a_side_that_shares_little_is_no_placement() -> None:
    """Few features at a corner: images on both sides of it share little, and still the nearest share most."""
    rng = np.random.default_rng(5)
    for n in (24, 40, 60):
        direction = ring(n)
        count = shared(direction, np.zeros(n, int), rng)
        side = np.arange(n) < n // 4
        across = side[:, None] != side[None]
        count[across] = count[across] // 3
        assert not divide(count, direction).any()


def test_undecided_images_follow_the_order_of_capture() -> None:
    label = np.array([1, 1, -1, 1, -1, 0, -1, 0, 0, 0])
    clock = np.cumsum([1, 4, 4, 5, 3, 90, 5, 4, 6, 4]) * 10**9
    assert fill_undecided(label, clock).tolist() == [1, 1, 1, 1, 1, 0, 0, 0, 0, 0]
    # without a pause nobody knows on which side of the turn it was taken
    assert fill_undecided(label, np.arange(1, 11) * 10**9).tolist() == [1, 1, 1, 1, -1, 0, 0, 0, 0, 0]
    assert fill_undecided(label).tolist() == [1, 1, 1, 1, -1, 0, 0, 0, 0, 0]
    # at the ends nothing says that it was set down anew, but a pause may
    ends = np.array([-1, -1, 1, 1, 0, 0, 0, -1])
    assert fill_undecided(ends, np.arange(1, 9) * 10**9).tolist() == [1, 1, 1, 1, 0, 0, 0, 0]
    assert fill_undecided(ends, np.array([1, 60, 61, 62, 63, 64, 65, 66]) * 10**9).tolist() == [
        -1,
        -1,
        1,
        1,
        0,
        0,
        0,
        0,
    ]
    assert fill_undecided(ends).tolist() == ends.tolist()
    # placements that come and go say nothing of what lies between
    assert fill_undecided(np.array([1, 0, 1, -1, 0, 1, 0])).tolist() == [1, 0, 1, -1, 0, 1, 0]


def test_images_between_two_pauses_stay_together() -> None:
    """What each image hides of its support is not sure of every image; hands come in pauses only."""
    label, other = np.repeat([0, 1], 5), np.array([0, 0, 1, 0, -1, 1, 1, 0, 1, 1])
    clock = np.cumsum([1, 4, 4, 5, 3, 90, 5, 4, 6, 4]) * 10**9
    assert agreed_between_pauses(label, other, clock).tolist() == label.tolist()
    assert agreed_between_pauses(label, 1 - label, clock).tolist() == (1 - label).tolist(), "most of them may be right"
    assert agreed_between_pauses(label, np.full(10, -1), clock).tolist() == label.tolist()
    for unknown in (None, np.arange(1, 11) * 10**9):
        assert agreed_between_pauses(label, other, unknown).tolist() == other.tolist()
    mixed = np.array([0, 0, 1, 0, 0, 1, 1, 1, 1, 1])
    assert agreed_between_pauses(mixed, other, clock).tolist() == [0, 0, 1, 0, -1, 1, 1, 1, 1, 1], (
        "what had no one label may change"
    )


def test_the_room_casts_no_vote() -> None:
    """All images share the table's features; only those above it belong to the object."""
    rng = np.random.default_rng(3)
    n = 24
    direction = np.concatenate([ring(n), ring(n, 0.1)])
    placement = np.repeat([0, 1], n)
    ground = np.column_stack([rng.uniform(-1, 1, (400, 2)), np.zeros(400)])
    own = rng.uniform(-0.15, 0.15, (240, 3)) + [0, 0, 0.2]
    view, point = [], []
    for i, d in enumerate(direction):
        seen = np.flatnonzero(rng.random(400) < 0.5)
        facing = np.flatnonzero((own[:, :2] @ d[:2] > 0.03) & (np.arange(240) % 2 == placement[i]))
        view += [i] * (len(seen) + len(facing))
        point += [*seen, *(400 + facing)]
    found = find_placements(
        np.concatenate([ground, own]),
        np.array(view),
        np.array(point),
        3 * direction,
        Region(np.array([0, 0, 0.1]), 0.8),
    )
    assert found.count == 2 and np.array_equal(found.label, placement)


def test_a_long_pause_divides_what_has_few_features_and_only_where_they_are_not_shared() -> None:
    turn = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    direction = np.tile(np.column_stack([np.cos(turn), np.sin(turn), np.full(20, 0.5)]), (2, 1))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    angle = np.degrees(np.arccos(np.clip(direction @ direction.T, -1, 1)))
    seconds = np.arange(40) * 10 + np.where(np.arange(40) >= 20, 300, 0)
    times = (1_000_000_000 * (1 + seconds)).astype(np.int64)
    stood = np.where(angle < 35, 2.0, 0.0)
    second = np.arange(40) >= 20
    moved = np.where(second[:, None] == second[None], stood, 0.0)
    assert np.array_equal(divide_at_pauses(moved, direction, times), second.astype(int))
    assert not divide_at_pauses(stood, direction, times).any()
    assert not divide_at_pauses(moved, direction, np.full(40, -1)).any(), "nobody knows when"
    assert not divide_at_pauses(moved * second[:, None], direction, times).any(), "one side shows nothing"


def test_a_plain_thing_that_shows_each_image_little_is_divided_at_a_pause() -> None:
    """A rock of one colour: 125 features in 56 images, of which next to each other share two (Blender)."""
    rng = np.random.default_rng(5)
    direction = np.concatenate([ring(28), ring(28, 0.1)])
    ground = np.column_stack([rng.uniform(-1, 1, (400, 2)), np.zeros(400)])
    own = rng.uniform(-0.15, 0.15, (112, 3)) + [0, 0, 0.25]
    pairs = [(28 * k + i, 28 * k + (i + 1) % 28) for k in (0, 1) for i in range(28) for _ in (0, 1)]
    view, point = np.array([(i, 400 + p) for p, pair in enumerate(pairs) for i in pair]).T
    room = np.repeat(np.arange(56), 400), np.tile(np.arange(400), 56)
    seen = np.concatenate([room[0], view]), np.concatenate([room[1], point])
    there = np.concatenate([ground, own]), *seen, 3 * direction, Region(np.array([0, 0, 0.1]), 0.8)
    seconds = np.arange(56) * 11 + np.where(np.arange(56) >= 28, 431, 0)
    clock = (1_000_000_000 * (1 + seconds)).astype(np.int64)
    found = find_placements(*there, timestamp_ns=clock)
    assert found.known and found.label.tolist() == [0] * 28 + [1] * 28
    assert found.turned_between(np.arange(3, 28), np.arange(28, 50)) and not found.turned_between(
        np.arange(9), np.arange(9, 28)
    )
    assert not found.turned_between(np.arange(30), np.arange(30, 56)), "images after the pause are in both"
    untimed = find_placements(*there)
    assert not untimed.label.any(), "nobody knows when"
    assert not untimed.turned_between(np.arange(28), np.arange(28, 56))


def test_what_comes_back_had_not_been_moved() -> None:
    clock = np.arange(15) * 10**9  # a film begins at nought
    film = np.array([1, 1, 1, -1, 0, 0, 0, 0, 0, 0, -1, 1, 1, 1, -1])
    assert without_return(film, clock).tolist() == [0, 0, 0, -1, 0, 0, 0, 0, 0, 0, -1, 0, 0, 0, -1]
    assert without_return(film, np.full(15, -1)).tolist() == film.tolist(), "nobody knows the order"
    assert without_return(film, None).tolist() == film.tolist()
    turned = np.array([0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 1, 0, 1, 1, 1])
    assert without_return(turned, clock).tolist() == turned.tolist(), "one image in a row tells nothing"
    plain_side = np.array([0, 0, 0, 2, 2, 2, 0, 0, 0, 1, 1, 1, 1, 1, 1])
    assert without_return(plain_side, clock).tolist() == [0] * 9 + [1] * 6
    crossed = np.array([0, 0, 0, 1, 1, 1, 0, 0, 0, 1, 1, 1, 2, 2, 2])
    assert without_return(crossed, clock).tolist() == [0] * 12 + [1] * 3


def test_a_few_images_between_others_are_no_placement() -> None:
    plain = np.array([0, 0, 0, 0, 2, 2, 0, 0, 0, 1, 1, 1, 0, 0, 0])
    assert small_ones_filled(plain, None, 4).tolist() == [0] * len(plain)
    turned = np.array([0, 0, 0, 0, 2, 2, 0, 0, 0, 1, 1, 1, 1, 1, 1])
    assert small_ones_filled(turned, None, 4).tolist() == [0] * 9 + [1] * 6


def test_a_few_images_stay_apart_where_their_neighbours_differ() -> None:
    label = np.array([0, 0, 0, 0, 2, 2, 1, 1, 1, 1])
    assert small_ones_filled(label, None, 4).tolist() == label.tolist()
    alone = np.array([0, 0, 1, 1, 2, 2])
    assert small_ones_filled(alone, None, 4).tolist() == alone.tolist()
