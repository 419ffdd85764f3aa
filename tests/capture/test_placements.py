"""Which image shows which placement of an object, in a room that stayed."""

from __future__ import annotations

import numpy as np

from massprops.capture.placements import divide, find_placements


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
        np.concatenate([ground, own]), np.array(view), np.array(point), 3 * direction, np.array([0, 0, 0.1]), 0.8
    )
    assert found.count == 2 and np.array_equal(found.label, placement)
