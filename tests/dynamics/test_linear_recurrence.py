"""Systems of linear equations stepped together."""

from __future__ import annotations

import numpy as np

from massprops.dynamics.linear_recurrence import recurrence


def test_each_step_is_its_matrix_and_what_is_added() -> None:
    rng = np.random.default_rng(1)
    step, added, first = rng.standard_normal((6, 3, 2, 2)), rng.standard_normal((6, 3, 2)), rng.standard_normal((3, 2))
    found = recurrence(step, added, first)
    assert found.shape == (7, 3, 2) and np.array_equal(found[0], first)
    for k in range(6):
        assert np.allclose(found[k + 1], (step[k] @ found[k][..., None])[..., 0] + added[k])
