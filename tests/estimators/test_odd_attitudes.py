"""Attitudes that no estimator can do much with: each gets its reason, and none takes the table with it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from massprops.estimators.methods import methods
from massprops.sequence import AttitudeSeries, Sequence, write_sequence
from massprops_cli.main import run

METHODS = ("momentum-ls", "ekf", "ukf")


def written(folder: Path, turns: np.ndarray, kept: np.ndarray | None = None) -> Path:
    """A sequence of attitudes 0.1 s apart, given as rotation vectors (n, 3), of which some are kept."""
    kept = np.ones(len(turns), bool) if kept is None else kept
    q = Rotation.from_rotvec(turns).as_quat()[:, [3, 0, 1, 2]]
    t = np.arange(len(turns), dtype=np.int64) * 10**8
    write_sequence(folder, Sequence(attitude=AttitudeSeries(t[kept], q[kept], np.full(int(kept.sum()), 1e-3))))
    return folder


def estimated(folder: Path, out: Path) -> tuple[int, dict]:
    asked = [word for name in METHODS for word in ("--method", name)]
    code = run(["estimate", str(folder), "-o", str(out), "-q", *asked])
    return code, json.loads((out / "estimates.json").read_text())


@pytest.mark.parametrize("kind", ["still", "gap", "unlike"])
def test_each_method_gets_its_reason(tmp_path: Path, kind: str, capfd: pytest.CaptureFixture[str]) -> None:
    rng, n = np.random.default_rng(0), 60
    kept = np.ones(n, bool)
    if kind == "still":
        turns = np.zeros((n, 3))
    elif kind == "gap":
        turns, kept[15:45] = 0.1 * np.outer(np.arange(n), [0.1, 0.2, 0.3]) + 1e-3 * rng.standard_normal((n, 3)), False
    else:
        turns = Rotation.random(n, random_state=1).as_rotvec()
    code, document = estimated(written(tmp_path / "seq", turns, kept), tmp_path / "out")
    said = capfd.readouterr().err
    assert code == 3 and "unexpected" not in said and "nan" not in said, said
    told = {e["name"]: e["because"] or e["reason"] for e in document["estimators"]}
    told |= {e["name"]: e["reason"] for e in document["skipped"]}
    assert set(told) == set(METHODS) and all(told.values()), told


def test_a_filter_that_diverges_or_breaks_down_costs_its_own_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng, n = np.random.default_rng(0), 60
    turns = 0.1 * np.outer(np.arange(n), [0.1, 0.2, 0.3]) + 1e-3 * rng.standard_normal((n, 3))
    ekf, ukf = methods()["ekf"], methods()["ukf"]
    real = ukf.estimate

    def diverged(*given: object, **more: object) -> object:
        found = real(*given, **more)
        return replace(found, w=np.full_like(found.w, np.nan), k1=np.nan, k2=np.nan, inertia=np.full((3, 3), np.nan))

    def broken(*given: object, **more: object) -> object:
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(ekf, "estimate", broken)
    monkeypatch.setattr(ukf, "estimate", diverged)
    _, document = estimated(written(tmp_path / "seq", turns), tmp_path / "out")
    found = {e["name"]: e for e in document["estimators"]}
    assert "momentum-ls" in found and found["momentum-ls"]["rate"] is not None
    assert [e["name"] for e in document["skipped"]] == ["ekf"]
    assert found["ukf"]["rate"] is None and not found["ukf"]["reliable"]
