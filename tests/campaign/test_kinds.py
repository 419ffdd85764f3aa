"""Simulated estimates and reconstructions as campaigns."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from massprops.campaigns.configuration import plan_of
from massprops.campaigns.kinds import diagnose, estimate, reconstruct
from massprops.campaigns.run import run_campaign
from massprops.campaigns.store import Row
from massprops.campaigns.table import Point
from massprops.dynamics.quaternion import from_rotation_vector, multiply, normalise
from massprops.errors import InputError
from massprops.estimators.methods import methods
from massprops.estimators.result import Estimate


def _truth(n: int = 50) -> dict[str, Any]:
    rng = np.random.default_rng(2)
    q = normalise(rng.standard_normal((n, 4)))
    stamp = (np.arange(n) * 5e8).astype(np.int64)
    w, r = rng.standard_normal((n, 3)), rng.standard_normal((n, 3))
    return {"timestamp_ns": stamp, "q": q, "w": w, "position": r, "k1": -0.3, "k2": -0.2}


def test_errors_do_not_mind_the_choice_of_body_axes() -> None:
    from massprops.dynamics.quaternion import conjugate, rotate

    truth = _truth()
    turn = normalise(np.array([0.3, -0.5, 0.7, 0.2]))
    exact = Estimate(
        "x",
        True,
        True,
        k1=-0.3,
        k2=-0.2,
        k_covariance=np.diag([1e-4, 4e-4]),
        times=truth["timestamp_ns"] * 1e-9,
        q=multiply(truth["q"], turn),
        w=rotate(conjugate(turn), truth["w"]),
        position=truth["position"],
    )
    row = estimate.errors(exact, truth)
    assert max(abs(row[name]) for name in ("k1_error", "k2_error", "nees_k", "w_deg_s", "position_m")) < 1e-9
    assert row["attitude_deg"] < 1e-5 and "error" not in row
    late = np.arange(50) >= 25
    tilt = np.where(late[:, None] & (np.arange(50) % 2 == 0)[:, None], np.radians([[2.0, 0, 0]]), 0.0)
    tilt += np.where(late[:, None] & (np.arange(50) % 2 == 1)[:, None], np.radians([[-2.0, 0, 0]]), 0.0)
    off = replace(
        exact, k1=-0.29, k2=-0.22, q=multiply(exact.q, from_rotation_vector(tilt)), position=exact.position + [3, 0, 4]
    )
    row = estimate.errors(off, truth)
    assert row["k1_error"] == pytest.approx(0.01) and row["k2_error"] == pytest.approx(-0.02)
    assert row["nees_k"] == pytest.approx(2.0) and row["position_m"] == pytest.approx(5.0)
    assert row["attitude_deg"] == pytest.approx(2.0, rel=0.01)
    assert "did not converge" in estimate.errors(replace(exact, converged=False), truth)["error"]


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ({"estimator": "smother"}, "no estimator 'smother'"),
        ({"sigma_pxx": 1}, "did you mean 'sigma_px'"),
        ({"sigma_px": -1}, "sigma_px must be from 0"),
        ({"effects": ["gravity-gradient"]}, "did you mean 'gravity-gradient-torque'"),
        ({"grid": {"scenario": [{"rate_dg": 3}]}}, "did you mean 'rate_deg'"),
        ({"grid": {"scenario": ["slow"]}}, "by name"),
        ({"moments": [1, 2]}, "3 numbers"),
        ({"orbit": "yes"}, "true or false"),
        ({"frames": 10.5}, "whole"),
    ],
)
def test_wrong_scenarios(content: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        plan_of({"kind": "estimate", "estimator": next(iter(methods())), **content})


def test_scenarios_effects_and_estimators_span_a_grid() -> None:
    content = {
        "kind": "estimate",
        "estimator": next(iter(methods())),
        "runs": 3,
        "frames": 60,
        "grid": {
            "scenario": [{"name": "slow", "rate_deg": 1}, {"name": "fast", "rate_deg": 6, "sigma_px": 0.1}],
            "effects": [[], ["internal-rotor:3"], "impulse"],
        },
        "draw": {"sigma_px": {"log-uniform": [0.1, 2]}},
    }
    plan = plan_of(content)
    assert plan.points == 6 and plan.total == 18
    cells = list(plan.cells())
    assert Point(0, cells[4], {}).label == "scenario fast, effects internal-rotor:3"
    made = estimate.scenario_of({**plan.fixed, **cells[4], "sigma_px": 0.7}, 5)
    assert (made.rate_deg, made.effects, made.seed, made.sigma_px) == (6, ("internal-rotor:3",), 5, 0.7)
    assert estimate.scenario_of({**plan.fixed, **cells[5]}, 5).effects == ("impulse",)


def test_an_estimate_campaign_end_to_end(tmp_path: Path) -> None:
    content = {"kind": "estimate", "estimator": "principal-axis-ekf", "runs": 2, "frames": 120, "chunk": 1}
    outcome = run_campaign(plan_of(content), tmp_path, workers=1)
    (point,) = outcome.document["points"]
    assert point["runs"] == 2
    (table,) = outcome.document["tables"]
    assert len(table["columns"]) == len(table["rows"][0])
    made = point["columns"].get("k1_error", {"n": 0})["n"]
    # of the other the filter says that its motion hardly shows the ratios: in principal axes it was 16 sigmas off
    assert made + point["failed"] in (1, 2) and made > 0, outcome.document["failures"]


@pytest.mark.parametrize(
    ("verdict", "named", "acted", "outcome"),
    [
        ("named", ["impulse"], {"impulse"}, "right"),
        ("none", [], set(), "right"),
        ("none", [], {"impulse"}, "missed"),
        ("named", ["impulse"], set(), "false_alarm"),
        ("named", ["impulse"], {"range-bias"}, "wrong"),
        ("named", ["impulse"], {"impulse", "range-bias"}, "wrong"),
        ("ambiguous", ["impulse", "range-bias"], {"impulse"}, "among"),
        ("ambiguous", ["impulse", "range-bias"], {"internal-rotor"}, "wrong"),
        ("unexplained", [], {"impulse"}, "unexplained"),
    ],
)
def test_diagnoses_are_judged_by_what_acted(verdict: str, named: list[str], acted: set[str], outcome: str) -> None:
    gap = {"fitted": {"before": 3.0, "after": 1.0}, "held_out": {"before": 4.0, "after": None}}
    row = diagnose.judged({"verdict": verdict, "effects": [{"name": n} for n in named], "gap": gap}, acted)
    assert [name for name in diagnose.OUTCOMES if row[name]] == [outcome]
    assert row["held_out_before"] == 4.0 and "held_out_after" not in row
    plan = plan_of({"kind": "diagnose", "runs": 1})
    (table,) = diagnose.tables(plan, [Point(0, {}, {}, [Row(0, 0, row)])])
    assert len(table["rows"][0]) == len(table["columns"])


def test_videos_are_points_with_run_folders_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a.mp4", "b.mp4"):
        (tmp_path / name).write_text(name)
    plan = plan_of({"kind": "reconstruct", "videos": ["*.mp4"], "frames": 30}, folder=tmp_path)
    assert [Path(v).name for v in plan.grid["video"]] == ["a.mp4", "b.mp4"] and plan.total == 2
    (tmp_path / "b.mp4").write_text("other")
    changed = plan_of({"kind": "reconstruct", "videos": ["*.mp4"], "frames": 30}, folder=tmp_path)
    assert changed.digest != plan.digest, "other footage is another campaign"
    asked: list[dict[str, Any]] = []

    def stand_in(source: str, out: Path, watch: Any = None, **options: Any) -> Any:
        asked.append({"source": source, "out": out, **options})
        out.mkdir()
        (out / "massprops.json").write_text("{}")
        found = {"volume": 2.0, "inertia_ratios": {"k1": -0.1, "k2": -0.2}, "interval_90": {"volume": [1.9, 2.2]}}
        return SimpleNamespace(exit_code=3 if "b.mp4" in source else 0, reason="too few frames", properties=found)

    monkeypatch.setattr("massprops.run.reconstruct.reconstruct", stand_in)
    rows = [
        reconstruct.runs({**plan.fixed, **cell}, [4], tmp_path / "runs" / str(k))[0]
        for k, cell in enumerate(plan.cells())
    ]
    assert asked[0]["frames"] == 30 and asked[0]["seed"] == 4 and asked[0]["out"] == tmp_path / "runs/0/a-4"
    assert rows[0]["volume"] == 2.0 and rows[0]["k2"] == -0.2 and "error" not in rows[0]
    assert rows[0]["volume_interval_relative"] == pytest.approx(0.15)
    assert rows[1]["error"] == "too few frames" and rows[1]["volume"] == 2.0
    points = [
        Point(k, c, {**plan.fixed, **c}, [Row(k, 4, rows[k], rows[k].get("error"))]) for k, c in enumerate(plan.cells())
    ]
    (table,) = reconstruct.tables(plan, points)
    assert [r[0] for r in table["rows"]] == ["a.mp4", "b.mp4"] and table["rows"][1][-1] == "too few frames"


def test_footage_that_cannot_be_read_is_a_row(tmp_path: Path) -> None:
    for name in ("a.mp4", "b.mp4"):
        (tmp_path / name).write_text("not a video " * 50)
    plan = plan_of({"kind": "reconstruct", "videos": ["a.mp4", "b.mp4"]}, folder=tmp_path)
    outcome = run_campaign(plan, tmp_path / "out")
    assert outcome.document["failed"] == outcome.document["done"] == 2
    assert all("not a video" in row[-1] for row in outcome.document["tables"][0]["rows"])
    with pytest.raises(InputError, match="--frames 1"):
        plan_of({"kind": "reconstruct", "videos": ["a.mp4"], "frames": 1}, folder=tmp_path)
