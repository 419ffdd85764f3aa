"""What holds of matrices of mixed units, spreads, texts and plain values whatever they are."""

from __future__ import annotations

import json
import unicodedata

import numpy as np
from drawn import arrays, matrices, numbers, quickly
from hypothesis import given
from hypothesis import strategies as st

from massprops.core.clustered import in_blocks
from massprops.core.displayed import number
from massprops.core.files import hash_of, json_text, plain
from massprops.core.levenberg_marquardt import damped_step
from massprops.core.linalg import at_least, consecutive, inverse_of, normalised_square
from massprops.core.robust import mad_sigma, nanmedian, rms
from massprops.core.text import HIDDEN, clean, table

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**60), 2**60) | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=8,
)


@quickly
@given(matrices(4))
def test_an_inverse_of_mixed_units_is_one(P: np.ndarray) -> None:
    size = np.sqrt(np.diag(P))
    np.testing.assert_allclose(size[:, None] * (inverse_of(P) @ P) / size, np.eye(4), atol=1e-6)


@quickly
@given(matrices(3))
def test_a_direction_without_information_gets_none(P: np.ndarray) -> None:
    wide = np.zeros((4, 4))
    wide[:3, :3] = P
    found = inverse_of(wide)
    assert not found[3].any() and not found[:, 3].any()
    np.testing.assert_allclose(found[:3, :3], inverse_of(P), rtol=1e-6)


@quickly
@given(matrices(3), arrays(3), arrays(3, 3.0))
def test_a_normalised_square_does_not_depend_on_units(P: np.ndarray, e: np.ndarray, power: np.ndarray) -> None:
    error, units = e * np.sqrt(np.diag(P)), 10.0**power
    here = normalised_square(error, P)
    assert here >= 0.0
    np.testing.assert_allclose(normalised_square(units * error, units[:, None] * P * units), here, rtol=1e-6)


@quickly
@given(matrices(3), arrays((3, 3), 10.0))
def test_a_widened_covariance_is_no_less_than_either(P: np.ndarray, mix: np.ndarray) -> None:
    size = np.sqrt(np.diag(P))
    floor = size[:, None] * (mix @ mix.T) * size
    wide = at_least(P, floor)
    for less in (P, floor):
        assert np.linalg.eigvalsh((wide - less) / np.outer(size, size)).min() > -1e-6


@quickly
@given(st.lists(st.integers(0, 9), max_size=6), st.integers(0, 5))
def test_slices_leave_nothing_out(counts: list[int], first: int) -> None:
    covered = [k for own in consecutive(counts, first) for k in range(own.start, own.stop)]
    assert covered == list(range(first, first + sum(counts)))


@quickly
@given(matrices(3), arrays(3), st.floats(1e-6, 1e6))
def test_a_step_leads_downhill_and_more_damping_makes_it_shorter(N: np.ndarray, g: np.ndarray, damping: float) -> None:
    unit = np.sqrt(np.diag(N))
    near, far = (unit * damped_step(N, unit * g, d) for d in (2.0 * damping, damping))
    assert near @ g >= 0.0 and far @ g >= 0.0
    assert np.linalg.norm(near) <= np.linalg.norm(far) * (1 + 1e-9)


@quickly
@given(arrays((6, 4)), numbers(-9.0, 9.0))
def test_spreads_grow_with_the_numbers(x: np.ndarray, factor: float) -> None:
    for spread in (rms, mad_sigma):
        assert spread(x) >= 0.0
        assert np.isclose(spread(factor * x), abs(factor) * spread(x), rtol=1e-9, atol=1e-12)
    shuffled = x[::-1]
    np.testing.assert_array_equal(nanmedian(shuffled, 0), nanmedian(x, 0))
    np.testing.assert_array_equal(nanmedian(x, 0), np.median(x, axis=0))


@quickly
@given(st.text())
def test_clean_text_steers_no_terminal_and_is_clean(given_text: str) -> None:
    once = clean(given_text)
    assert clean(once) == once
    assert all(c in "\n\t" or unicodedata.category(c) not in HIDDEN for c in once)


@quickly
@given(st.lists(st.lists(st.text("abc-12", min_size=1, max_size=9), min_size=3, max_size=3), min_size=1, max_size=5))
def test_the_columns_of_a_table_stand_below_each_other(rows: list[list[str]]) -> None:
    lines = table(rows[0], rows[1:])
    wide = [max(len(row[k]) for row in rows) for k in range(3)]
    for line, row in zip(lines, rows, strict=True):
        assert line.split() == row
        assert line.rstrip().endswith(row[2]) and len(line) == 2 + sum(wide) + 4
        assert line[2 : 2 + wide[0]].rstrip() == row[0]


@quickly
@given(st.lists(st.lists(st.text(max_size=9), min_size=1, max_size=3) | st.text("ab", max_size=5), max_size=5))
def test_a_table_has_a_line_for_each_row_whatever_it_is_given(rows: list[list[str] | str]) -> None:
    lines = table(("a", "b", "c"), rows)
    assert len(lines) == 1 + len(rows) and all("\n" not in line and clean(line) == line for line in lines)


@quickly
@given(VALUES)
def test_plain_values_are_json_and_plain_again(value: object) -> None:
    once = plain(value)
    assert plain(once) == once and json.loads(json_text(value)) == once
    assert hash_of(value) == hash_of(once)


@quickly
@given(st.floats(-1e300, 1e300))
def test_a_number_that_is_shown_is_right_to_four_digits(value: float) -> None:
    assert np.isclose(float(number(value)), value, rtol=1e-3)


@quickly
@given(st.integers(12, 200), st.integers(1, 5))
def test_blocks_of_time_follow_one_another(epochs: int, tracks: int) -> None:
    epoch, track = (a.ravel() for a in np.meshgrid(np.arange(epochs), np.arange(tracks)))
    block = in_blocks(epoch, epochs, track)
    assert np.all(np.diff(block[np.argsort(epoch, kind="stable")]) >= 0), "in order of time"
    assert len({(e, b) for e, b in zip(epoch, block, strict=True)}) == epochs, (
        "one block for an epoch, whatever the track"
    )
    assert len(set(block)) > 1 and np.ptp(np.bincount(block)) <= 2 * tracks
