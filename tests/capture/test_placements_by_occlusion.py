"""Placements of an object without features, told by what it hides of its support."""

import numpy as np
import pytest

from massprops.capture.occlusion import LEAST_AGREEMENT, Occlusion, Voxels
from massprops.capture.placements_by_occlusion import divide_by_occlusion, predicted_agreement

SIDE, VIEWS = 12, 24


def scene(places: list[tuple[slice, slice]], seed: int = 0, wrong_share: float = 0.1) -> tuple[Voxels, Occlusion]:
    """A block at a place for each view, seen along the three axes in turn; a part of what the views say is wrong."""
    rng = np.random.default_rng(seed)
    at = np.stack(np.meshgrid(*3 * [np.arange(SIDE)], indexing="ij"), axis=-1)
    states, cells = [], []
    for i, place in enumerate(places):
        block = np.zeros((SIDE, SIDE, SIDE), bool)
        block[(*place, slice(0, 6))] = True
        across = [k for k in range(3) if k != i % 3]
        state = np.where(block.any(axis=i % 3), -1, 1).astype(np.int8)
        wrong = rng.random(state.shape) < wrong_share
        states.append(np.where(wrong, -state, state).astype(np.int8))
        cells.append((at[..., across[0]] * SIDE + at[..., across[1]]).astype(np.int32))
    cell = np.stack(cells)
    said = np.stack([s.ravel()[c] for s, c in zip(states, cell, strict=True)])
    return Voxels(at.astype(float), 1.0, said == 1, said == -1, cell), Occlusion(states, np.ones(len(places)))


HERE, THERE = (slice(1, 6), slice(1, 6)), (slice(5, 10), slice(4, 9))


def test_an_object_that_stays_is_one_placement():
    assert not divide_by_occlusion(*scene(VIEWS * [HERE])).any()


def test_an_object_set_down_anew_is_two():
    label = divide_by_occlusion(*scene(14 * [HERE] + 10 * [THERE]))
    assert label.tolist() == 14 * [0] + 10 * [1]


def test_a_long_pause_says_when_it_was_moved():
    grid, maps = scene(13 * [HERE] + 11 * [THERE])
    pause = np.where(np.arange(VIEWS - 1) == 12, 400, 10)
    taken = 10**9 * np.concatenate([[1], 1 + np.cumsum(pause)])
    assert divide_by_occlusion(grid, maps, taken).tolist() == 13 * [0] + 11 * [1]


@pytest.mark.parametrize("moved", [True, False])
def test_views_that_say_little_divide_at_a_pause_where_many_agree(moved: bool):
    """So much is wrong that no hull explains the half of it."""
    grid, maps = scene(13 * [HERE] + 11 * [THERE if moved else HERE], wrong_share=0.3)
    taken = 10**9 * np.concatenate([[1], 1 + np.cumsum(np.where(np.arange(VIEWS - 1) == 12, 400, 10))])
    assert predicted_agreement(grid, maps, np.arange(13, VIEWS)).mean() < LEAST_AGREEMENT
    assert divide_by_occlusion(grid, maps, taken).any() == moved
    assert not divide_by_occlusion(grid, maps).any()


def test_a_pause_alone_divides_nothing():
    grid, maps = scene(VIEWS * [HERE])
    taken = 10**9 * np.concatenate([[1], 1 + np.cumsum(np.where(np.arange(VIEWS - 1) == 12, 400, 10))])
    assert not divide_by_occlusion(grid, maps, taken).any()
