"""Sky that counts only where the body would be lit is taken where that clearly leaves fewer of the silhouettes' pixels out."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from massprops.run.stages import surface
from massprops.surface import lit_sky, silhouette_only


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


@pytest.mark.parametrize(("contradicted", "more", "taken"), [(0.3, 2, True), (0.3, 40, False), (0.0, 2, False)])
def test_darkness_explains_sky_before_what_was_measured(
    monkeypatch: pytest.MonkeyPatch, contradicted: float, more: int, taken: bool
) -> None:
    """A shape by which as little is missed is taken where the other one calls many silhouettes wrong, and none that misses clearly more."""
    before = np.random.default_rng(1).integers(60, 100, 40)
    after = before + more + np.random.default_rng(2).integers(-12, 13, 40)

    def shape(name: str, share: float) -> Any:
        return SimpleNamespace(vertices=name, faces=None, hull=SimpleNamespace(outside_share=share))

    def missed(mesh: tuple[Any, Any], views: Any, masks: Any) -> list[np.ndarray]:
        return [np.ones(n) for n in (after if mesh[0] == "again" else before)]

    monkeypatch.setattr(silhouette_only, "missed", missed)
    monkeypatch.setattr(lit_sky, "sky_where_lit", lambda *_: ["lit"])
    monkeypatch.setattr(surface, "_closed", lambda job, seen: (shape("again", 0.0), seen.masks))
    nothing: Any = None
    images = {"views": nothing, "masks": ["all"], "grey": [], "cloud": nothing, "table": nothing}
    seen = surface.Evidence(**images, sun=np.zeros((1, 3)), place={}, moving=True, balance=None)
    job: Any = nothing
    chosen, masks = surface._with_lit_sky(job, seen, shape("first", contradicted), ["all"])
    assert (str(chosen.vertices), masks) == (("again", ["lit"]) if taken else ("first", ["all"]))
