"""Several records of one body: what they say of the inertia together, and which effect they share."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from diagnosis.test_momentum_balance import INERTIA, tumble

from massprops.diagnosis.common_parameters import Law, common_of, joined
from massprops.diagnosis.criteria import SHAPE_SD
from massprops.diagnosis.momentum_balance import shape_of
from massprops.diagnosis.several import common_ratios
from massprops.dynamics.inertia import ratios
from massprops.sequence.data import Sequence


def _shape_law(mean: np.ndarray, covariance: np.ndarray) -> Law:
    return Law(mean=mean, covariance=covariance, sd=np.full(5, SHAPE_SD))


def test_posteriors_are_joined_as_their_product_over_the_prior() -> None:
    rng = np.random.default_rng(1)
    prior = np.eye(5) / SHAPE_SD**2
    X = [rng.standard_normal((20, 5)) for _ in range(2)]
    y = [x @ np.array([0.3, -0.2, 0.1, 0.4, 0.0]) + 0.1 * rng.standard_normal(20) for x in X]
    spreads = [np.linalg.inv(x.T @ x / 0.01 + prior) for x in X]
    means = [c @ x.T @ v / 0.01 for c, x, v in zip(spreads, X, y, strict=True)]
    found, gained = joined([_shape_law(m, c) for m, c in zip(means, spreads, strict=True)], [])
    whole, target = np.concatenate(X), np.concatenate(y)
    covariance = np.linalg.inv(whole.T @ whole / 0.01 + prior)
    assert found.mean == pytest.approx(covariance @ whole.T @ target / 0.01)
    assert found.covariance == pytest.approx(covariance)

    def evidence(x: np.ndarray, v: np.ndarray) -> float:
        C = 0.01 * np.eye(len(v)) + SHAPE_SD**2 * x @ x.T
        return -0.5 * float(np.linalg.slogdet(2 * np.pi * C)[1] + v @ np.linalg.solve(C, v))

    together = evidence(whole, target) - sum(evidence(x, v) for x, v in zip(X, y, strict=True))
    assert gained == pytest.approx(together, abs=1e-6)


def test_a_size_of_a_prior_is_found_for_all_records() -> None:
    """Whatever sizes the records' own priors have, the joint law is the same."""
    rng = np.random.default_rng(2)
    precisions, bys = [np.diag(rng.uniform(1.0, 9.0, 5)) for _ in range(2)], rng.standard_normal((2, 5))

    def law(L: np.ndarray, by: np.ndarray, sd: float) -> Law:
        C = np.linalg.inv(L + np.eye(5) / sd**2)
        return Law(mean=C @ by, covariance=C, sd=np.full(5, sd))

    found = [
        joined([law(L, by, s) for L, by, s in zip(precisions, bys, own, strict=True)], [np.arange(5)])[0]
        for own in ([0.3, 0.3], [0.2, 4.0])
    ]
    assert found[1].sd == pytest.approx(found[0].sd, rel=0.02)
    assert found[1].mean == pytest.approx(found[0].mean, rel=0.02)


def test_posteriors_of_two_bodies_disagree() -> None:
    small = 1e-4 * np.eye(5)
    shape = shape_of(INERTIA)
    assert joined([_shape_law(shape, small), _shape_law(shape, small)], [])[1] > 0
    assert joined([_shape_law(shape, small), _shape_law(shape + 0.2, small)], [])[1] < -50


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


# -- the body's parameters -------------------------------------------------------------------------


def _moved_by_mujoco(
    torque: Torque | None, rates: list[np.ndarray], inside: Callable[[], Acting] | None = None
) -> list[Sequence]:
    """Records of one body that starts with other rates [deg/s], moved by MuJoCo."""
    out = []
    for k, rate in enumerate(rates):
        rng = np.random.default_rng([k, 5])
        world = World(inertia=BODY, start=np.array([1.0, 0.0, 0.0, 0.0]), rate=np.radians(rate), sun=np.array([0.6, 0.0, 0.8]))
        acting = [Acting(torque=torque)] if inside is None else [inside()]
        out.append(_sequence(*moved(world, acting), world.sun, rng))
    return out


BODY = np.array([[20.0, 1.0, -0.5], [1.0, 16.0, 0.8], [-0.5, 0.8, 12.0]])
MEAN = float(np.trace(BODY)) / 3.0


def _sigmas_off(found: Common, name: str, truth: dict[str, float]) -> list[float]:
    return [(found.parameters[name][n] - v) / found.sigma[name][n] for n, v in truth.items()]


def _fits(records: list[Sequence], name: str) -> list[HypothesisFit]:
    """The effect's fit in each record."""
    out = []
    for r in records:
        record = record_of_attitudes(r.attitude, r.environment)
        fit = best_fit(record, effects()[name], without_effects(record)[0])
        assert fit is not None
        out.append(fit)
    return out


def test_drag_by_axis_of_three_spins_is_one_drag() -> None:
    """Each record shows the drag about the axis that it turns about; together they show all three, and the inertia better."""
    damping = np.array([4e-4, 1e-4, 2.5e-4]) * MEAN
    records = _moved_by_mujoco(
        lambda t, R, w: -damping * w, [np.array(r) for r in ([3.0, 0.2, 0.1], [0.3, 3.0, 0.2], [0.1, 0.2, 3.0])]
    )
    fits = _fits(records, "drag-by-axis")
    found = common_of(fits)
    truth = dict(zip(("damping_x", "damping_y", "damping_z"), damping / MEAN, strict=True))
    assert max(map(abs, _sigmas_off(found, "drag-by-axis", truth))) < 3.0
    alone = np.array([np.sqrt(np.diag(f.covariance["drag-by-axis"])) for f in fits])
    joint = np.array(list(found.sigma["drag-by-axis"].values()))
    # at least as well as independent records would say it, and no better than all their rows about a known body could
    assert (joint <= 1.05 * (alone**-2).sum(axis=0) ** -0.5).all()
    assert (joint < 0.5 * alone.max(axis=0)).all()


def test_two_records_separate_what_one_confounds() -> None:
    """Across the field eddy currents brake as a fluid does; about the field they do not brake at all."""
    field = FIELD_T / np.linalg.norm(FIELD_T)
    across = np.cross(field, [0.0, 0.0, 1.0])
    conductance = 0.3 / SECONDS * MEAN / (FIELD_T @ FIELD_T)
