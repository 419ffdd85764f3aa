"""Sky that counts only where the body would be lit is taken where that clearly leaves fewer of the silhouettes' pixels out."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from massprops.run.stages import surface
from massprops.surface import silhouette_only


@pytest.mark.parametrize(("fewer", "scatter", "taken"), [(1, 12, False), (30, 12, True), (-30, 12, False)])
def test_a_hair_decides_nothing(monkeypatch: pytest.MonkeyPatch, fewer: int, scatter: int, taken: bool) -> None:
    rng = np.random.default_rng(0)
    before = rng.integers(60, 100, 40)
    after = before - fewer + rng.integers(-scatter, scatter + 1, 40)

    def missed(mesh: tuple[Any, Any], views: Any, masks: Any) -> list[np.ndarray]:
        return [np.ones(n) for n in (after if mesh[0] == "again" else before)]

    monkeypatch.setattr(silhouette_only, "missed", missed)
    again, first = (SimpleNamespace(vertices=name, faces=None) for name in ("again", "first"))
    seen: Any = SimpleNamespace(views=None, masks=None)
    assert surface._misses_less(seen, again, first, surface.CLEARLY) is taken  # type: ignore[arg-type]
