"""What tests of the surface share."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from massprops.surface import spread
from massprops.surface.cloud import Cloud


@pytest.fixture(scope="module")
def scatter_once() -> Iterator[None]:
    """How far points scatter takes most of the time of `replicates`: here the same call is made once, its draws included."""
    known: dict[Any, tuple[Cloud, np.ndarray, Any]] = {}
    scatter = spread.face_scatter

    def once(
        middle: np.ndarray, observed: np.ndarray, cloud: Cloud, radius: float, rng: np.random.Generator
    ) -> np.ndarray:
        key = id(cloud), radius, middle.tobytes(), observed.tobytes(), str(rng.bit_generator.state)
        if key not in known:
            known[key] = cloud, scatter(middle, observed, cloud, radius, rng), rng.bit_generator.state
        _, found, rng.bit_generator.state = known[key]
        return found.copy()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(spread, "face_scatter", once)
        yield
