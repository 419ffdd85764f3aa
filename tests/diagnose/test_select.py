"""What is looked for beside a single effect: where the assumed inertia is contradicted, and where attitudes are beyond the catalogue."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from massprops.diagnosis.search import select as module
from massprops.diagnosis.search.by_balance import ByBalance
from massprops.diagnosis.search.refit import Added
from massprops.diagnosis.search.select import Selection, _beside, _Course, _more_than_one
from massprops.effects import changes_motion, effects

QUIET = lambda what, done, total: None  # noqa: E731


def fitted(*names: str, bic: float = 0.0, rms: float = 1.5, held: float = 2.0) -> Any:
    """What a selection reads of a fit."""
    added = tuple(Added(effects()[n]) for n in names)
    return SimpleNamespace(
        added=added,
        names=names,
        bic=bic,
        fitted=rms,
        held=held,
        white=9.0,
        implausible="",
        fit=SimpleNamespace(cost=bic),
    )


BASE = fitted(bic=1000.0, rms=5.0, held=9.0)
RIGHT = ("viscous-damping", "gravity-gradient-torque")
DENSE = ("constant-body-torque", "nonuniform-density")


def course(*first: Any) -> _Course:
    case = SimpleNamespace(fitted=SimpleNamespace(count=9999))
    every = list(effects().values())
    return _Course(
        case=case, base=BASE, watch=QUIET, usable=every, out=Selection(BASE, best=BASE), first=list(first),
        good=sorted(first, key=lambda s: s.bic),
    )  # fmt: skip


@pytest.fixture
def quiet(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, ...]]:
    """No fit is made; which effects a second one is looked for beside, and what a search by steps may take."""
    seen: list[tuple[str, ...]] = []

    def candidates(case: Any, upon: Any, *_: Any, **__: Any) -> list[Any]:
        seen.append(upon.names)
        return [fitted(*RIGHT, bic=120.0, rms=1.0, held=1.0)] if upon.names == RIGHT[:1] else []

    def steps(case: Any, start: Any, usable: list[Any], watch: Any) -> list[Any]:
        seen.append(("steps", *(m.NAME for m in usable)))
        return []

    monkeypatch.setattr(module, "fit_candidates", candidates)
    monkeypatch.setattr(module, "stepwise", steps)
    monkeypatch.setattr(module, "contradicts", lambda case, s: "constant-body-torque" in s.names)
    monkeypatch.setattr(module, "density_with_each", lambda *_: [fitted(*DENSE, bic=145.0, rms=1.0, held=1.0)])
    monkeypatch.setattr(_Course, "lengthen", lambda self, modules: None)
    return seen


def test_uneven_density_does_not_keep_a_pair_from_being_tried(quiet: list[tuple[str, ...]]) -> None:
    """An effect that brings the inertia back to what is assumed says that no mass is hidden: a second one beside it is tried though
    uneven density beside another explains the data."""
    found = course(fitted("viscous-damping", bic=400.0, rms=1.04, held=1.2), fitted("constant-body-torque", bic=900.0))
    _more_than_one(found, violated=True)
    assert found.good[0].names == RIGHT and found.good[1].names == DENSE
    assert ("viscous-damping",) in quiet and ("constant-body-torque",) not in quiet


def test_beyond_the_catalogue_only_sensors_are_tried_beside_a_torque(
    quiet: list[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_Course, "balance", lambda self: ByBalance(forced=True))
    _more_than_one(course(fitted("impulse", bic=400.0)), violated=False)
    (steps,) = quiet
    assert steps[0] == "steps" and len(steps) > 3
    assert not any(changes_motion(effects()[n]) for n in steps[1:])


def test_what_the_catalogue_explains_in_the_attitudes_leaves_the_search_as_it_is(
    quiet: list[tuple[str, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_Course, "balance", lambda self: ByBalance(forced=True, named=True))
    _more_than_one(course(fitted("solar-radiation-torque", bic=400.0)), violated=False)
    assert "viscous-damping" in quiet[-1]


def test_beside_a_sensor_everything_is_tried() -> None:
    every = list(effects().values())
    assert _beside(fitted("rolling-shutter"), every) == every
