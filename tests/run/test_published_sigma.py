"""The sigma of the inertia that a published sequence states."""

from __future__ import annotations

import numpy as np
import pytest

from massprops.documents.body import LARGEST_SIGMA
from massprops.run.stages.publish import _relative_sigma


@pytest.mark.parametrize(("half", "sigma"), [(1.645, 1.0), (1e13, LARGEST_SIGMA)])
def test_the_sigma_of_the_moments_is_one_that_a_sequence_can_state(half: float, sigma: float) -> None:
    """A film of which four frames could be placed gave 5.6e6, which its own cross-check refused to read."""
    moments = np.ones(3)
    document = {"principal_moments": moments, "interval_90": {"principal_moments": [[1 - half, 1 + half]] * 3}}
    assert _relative_sigma(document) == pytest.approx(sigma)
    assert _relative_sigma({"principal_moments": moments}) is None
