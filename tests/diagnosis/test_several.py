"""Several records of one body: what they say of the inertia together, and which effect they share."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from diagnosis.test_momentum_balance import INERTIA, tumble

from massprops.diagnosis.criteria import SHAPE_SD
from massprops.diagnosis.momentum_balance import shape_of
from massprops.diagnosis.several import common_ratios, joined
from massprops.dynamics.inertia import ratios
from massprops.sequence.data import Sequence


def test_posteriors_are_joined_as_their_product_over_the_prior() -> None:
    rng = np.random.default_rng(1)
    prior = np.eye(5) / SHAPE_SD**2
    X = [rng.standard_normal((20, 5)) for _ in range(2)]
    y = [x @ np.array([0.3, -0.2, 0.1, 0.4, 0.0]) + 0.1 * rng.standard_normal(20) for x in X]
    spreads = [np.linalg.inv(x.T @ x / 0.01 + prior) for x in X]
    means = [c @ x.T @ v / 0.01 for c, x, v in zip(spreads, X, y, strict=True)]
    found = joined(means, spreads)
    whole, target = np.concatenate(X), np.concatenate(y)
    covariance = np.linalg.inv(whole.T @ whole / 0.01 + prior)
    assert found.shape == pytest.approx(covariance @ whole.T @ target / 0.01)
    assert found.covariance == pytest.approx(covariance)

    def evidence(x: np.ndarray, v: np.ndarray) -> float:
        C = 0.01 * np.eye(len(v)) + SHAPE_SD**2 * x @ x.T
        return -0.5 * float(np.linalg.slogdet(2 * np.pi * C)[1] + v @ np.linalg.solve(C, v))

    together = evidence(whole, target) - sum(evidence(x, v) for x, v in zip(X, y, strict=True))
    assert found.agreement == pytest.approx(together, abs=1e-6)


def test_posteriors_of_two_bodies_disagree() -> None:
    small = 1e-4 * np.eye(5)
    shape = shape_of(INERTIA)
    assert joined([shape, shape], [small, small]).agreement > 0
    assert joined([shape, shape + 0.2], [small, small]).agreement < -50


def test_ratios_of_a_common_inertia_have_sigmas() -> None:
    value, sigma = common_ratios(joined([shape_of(INERTIA)] * 2, [1e-4 * np.eye(5)] * 2))
    assert value == pytest.approx(list(ratios(INERTIA)[0]), abs=1e-3)
    assert 0 < sigma[0] < 0.05


def test_the_command_takes_several_records_and_refuses_what_cannot_be_joined(tmp_path, capsys) -> None:
    from massprops.sequence.write import write_sequence
    from massprops_cli.main import run

    for k in (1, 2):
        write_sequence(tmp_path / f"{k}", Sequence(rates=tumble(rate=60.0, seconds=0.6, seed=k)))
    out = tmp_path / "out"
    assert run(["diagnose", str(tmp_path / "1"), str(tmp_path / "2"), "-o", str(out), "-q"]) == 0
    document = json.loads((out / "diagnosis.json").read_text())
    assert document["verdict"] == "none" and len(document["records"]) == 2 and document["agreement"] > 0
    truth = ratios(INERTIA)[0]
    assert abs(document["k1"]["value"] - truth[0]) < 4 * document["k1"]["sigma"] + 0.01
    write_sequence(tmp_path / "long", Sequence(rates=tumble(rate=20.0, seconds=12.0)))
    assert run(["diagnose", str(tmp_path / "1"), str(tmp_path / "long"), "-q"]) == 2
    assert "diagnose it by itself" in capsys.readouterr().err
    own = tumble(rate=60.0, seconds=0.6, seed=2)
    other = replace(own, w=own.w[:, [1, 2, 0]])
    write_sequence(tmp_path / "other", Sequence(rates=other))
    assert run(["diagnose", str(tmp_path / "1"), str(tmp_path / "other"), "-q"]) == 3
    assert "of different bodies or in different body axes" in capsys.readouterr().err
