"""Where parts of a vector lie."""

import numpy as np

from massprops.core.linalg import consecutive


def test_slices_follow_one_another_and_leave_nothing_out():
    counts = [3, 0, 5, 1]
    whole = np.arange(9)
    parts = [whole[own] for own in consecutive(counts)]
    assert [len(p) for p in parts] == counts
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_they_begin_where_they_are_told():
    assert consecutive(iter([2, 1]), 4) == [slice(4, 6), slice(6, 7)]
    assert consecutive([]) == []
