"""Evidence for a confidence, whose parts are given flat."""

from __future__ import annotations

from typing import Any

from massprops.mass.confidence import Evidence, ImageEvidence, PlacementEvidence, SurfaceEvidence


def evidence(half_width: float, filled: float, inferred: float, given: int, used: int, **more: Any) -> Evidence:
    """Evidence whose further parts go by their names."""
    kinds = (SurfaceEvidence, (half_width, filled, inferred)), (ImageEvidence, (given, used)), (PlacementEvidence, ())
    parts = [kind(*first, **{k: v for k, v in more.items() if k in kind.__annotations__}) for kind, first in kinds]
    assert all(any(k in kind.__annotations__ for kind, _ in kinds) for k in more)
    return Evidence(*parts)
