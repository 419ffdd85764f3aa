"""Several records of one body: what they say of the inertia together, and which effect they share."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from diagnosis.pair_worlds import FIELD_T, PERIOD_S, SECONDS, Acting, World, _sequence, moved
from diagnosis.test_momentum_balance import INERTIA, tumble
from diagnosis.test_turned_axes import seen

from massprops.diagnosis import criteria, selection
from massprops.diagnosis.candidate import Candidate
from massprops.diagnosis.common_parameters import Common, Law, common_of, joined
from massprops.diagnosis.criteria import SHAPE_SD
from massprops.diagnosis.diagnose import diagnose_by_balance
from massprops.diagnosis.effect_search import best_fit
from massprops.diagnosis.hypothesis_fit import HypothesisFit
from massprops.diagnosis.momentum_balance import inertia_of, shape_of
from massprops.diagnosis.record import Record, record_of_attitudes, record_of_rates
from massprops.diagnosis.scanned_values import with_scanned
from massprops.diagnosis.several import CommonEffect, Together, together
from massprops.diagnosis.several_document import common_ratios, document_of_together
from massprops.diagnosis.unnamed import without_effects
from massprops.dynamics.inertia import ratios
from massprops.dynamics.quaternion import from_rotation_vector, rotation_matrix
from massprops.effects import effects
from massprops.errors import NotPossible
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


def test_ratios_of_a_common_inertia_have_sigmas() -> None:
    law, _ = joined([_shape_law(shape_of(INERTIA), 1e-4 * np.eye(5))] * 2, [])
    value, sigma = common_ratios(
        Common(shape=law.mean, covariance=law.covariance, inertia=inertia_of(law.mean), evidence=0.0)
    )
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
    capsys.readouterr()
    for more in ("--discover",), ("--simulator", "my:own"):
        assert run(["diagnose", str(tmp_path / "1"), str(tmp_path / "2"), *more, "-q"]) == 2
        assert "give each record by itself" in capsys.readouterr().err
    write_sequence(tmp_path / "long", Sequence(rates=tumble(rate=20.0, seconds=12.0)))
    assert run(["diagnose", str(tmp_path / "1"), str(tmp_path / "long"), "-q"]) == 2
    assert "diagnose it by itself" in capsys.readouterr().err
    own = tumble(rate=60.0, seconds=0.6, seed=2)
    other = replace(own, w=own.w[:, [1, 2, 0]])
    write_sequence(tmp_path / "other", Sequence(rates=other))
    assert run(["diagnose", str(tmp_path / "1"), str(tmp_path / "other"), "-q"]) == 3
    assert "of different bodies or in different body axes" in capsys.readouterr().err


def test_an_effect_of_ones_own_is_tried_in_several_records_and_told_with_its_parameters(
    tmp_path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    from massprops.sequence.write import write_sequence
    from massprops_cli.main import run

    text = """
from massprops.effects import Parameter
NAME = "my-brake"
SENTENCE = "The square of the rate about x brakes about y."
PARAMETERS = (Parameter("brake", "rad^-1", 0.1),)
NEEDS = ()
BODY = ("brake",)


def torque(t, q, w, p, inertia, environment):
    return 0.0 * w[0], -p[0] * w[0] * w[0], 0.0 * w[0]
"""
    (tmp_path / "mine.py").write_text(text)
    for k in (1, 2):
        series = tumble(torque=lambda t, w: np.array([0.0, -0.35 * w[0] ** 2, 0.0]), rate=60.0, seconds=0.6, seed=k)
        write_sequence(tmp_path / f"{k}", Sequence(rates=series))
    usable, few = selection.usable_effects, ("my-brake", "viscous-damping")
    monkeypatch.setattr(selection, "usable_effects", lambda r: ([e for e in usable(r)[0] if e.NAME in few], {}))
    records = [str(tmp_path / "1"), str(tmp_path / "2")]
    assert run(["diagnose", *records, "--effect", str(tmp_path / "mine.py"), "-q"]) == 0
    said = capsys.readouterr().out
    assert "my-brake" in said
    line = next(line.split() for line in said.splitlines() if line.split()[:1] == ["brake"])
    assert line[4] == "rad^-1" and abs(float(line[1]) - 0.35) < 4.0 * float(line[3])


# -- the body's parameters -------------------------------------------------------------------------


BODY = np.array([[20.0, 1.0, -0.5], [1.0, 16.0, 0.8], [-0.5, 0.8, 12.0]])
MEAN = float(np.trace(BODY)) / 3.0
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def _records(acting: Acting, begun: list[tuple[np.ndarray, np.ndarray]]) -> list[Sequence]:
    """Records of one body, moved by MuJoCo, that begins with other attitudes and rates [deg/s]."""
    out = []
    for k, (start, rate) in enumerate(begun):
        world = World(inertia=BODY, start=start, rate=np.radians(rate), sun=np.array([0.6, 0.0, 0.8]))
        out.append(_sequence(*moved(world, [acting]), world.sun, np.random.default_rng([k, 5])))
    return out


def _fits(records: list[Sequence], name: str) -> list[HypothesisFit]:
    """An effect by itself in each record."""
    out = []
    for r in records:
        assert r.attitude is not None
        record = record_of_attitudes(r.attitude, r.environment)
        fit = best_fit(record, effects()[name], without_effects(record)[0])
        assert fit is not None
        out.append(with_scanned(fit, PERIOD_S))
    return out


def _off(found: Common, name: str, truth: dict[str, float]) -> float:
    """The largest error over its sigma."""
    return max(abs(found.parameters[name][n] - v) / found.sigma[name][n] for n, v in truth.items())


def test_drag_by_axis_in_three_spins_is_one_drag() -> None:
    """Each record shows the drag about the axis that it turns about, together they show all three."""
    pytest.importorskip("mujoco")
    damping = np.array([4e-4, 1e-4, 2.5e-4])
    acting = Acting(torque=lambda t, R, w: -MEAN * damping * w)
    fits = _fits(
        _records(acting, [(LEVEL, np.array(r)) for r in ([3.0, 0.2, 0.1], [0.3, 3.0, 0.2], [0.1, 0.2, 3.0])]),
        "drag-by-axis",
    )
    found = common_of(fits)
    names = ("damping_x", "damping_y", "damping_z")
    assert _off(found, "drag-by-axis", dict(zip(names, damping, strict=True))) < 3.0
    alone = np.array([np.diag(f.covariance["drag-by-axis"]) for f in fits])
    joint = np.array([found.sigma["drag-by-axis"][n] for n in names]) ** 2
    assert (joint < 1.0 / np.sum(1.0 / alone, axis=0)).all()  # more than as many known bodies: the inertia is one too


def test_a_damped_sphere_has_one_coupling_in_two_records() -> None:
    """What is scanned, not solved for, is moved to its best for both."""
    pytest.importorskip("mujoco")
    share, coupling = 0.08, 0.03
    moment = share * MEAN
    inside = (
        f'<body pos="0.1 0.1 -0.2"><joint type="ball" damping="{coupling * moment}"/>'
        f'<inertial pos="0 0 0" mass="0.001" diaginertia="{moment} {moment} {moment}"/></body>'
    )
    acting = Acting(inside=inside, speeds=(0.0, 0.0, 0.0))
    fits = _fits(
        _records(acting, [(LEVEL, np.array(r)) for r in ([3.0, 0.2, 0.1], [0.3, 3.0, 0.2])]), "energy-dissipation"
    )
    found = common_of(fits)
    assert _off(found, "energy-dissipation", {"share": share, "coupling": coupling}) < 3.0
    alone = [common_of([f]).sigma["energy-dissipation"]["coupling"] for f in fits]
    assert found.sigma["energy-dissipation"]["coupling"] < 1.02 * np.sum(np.array(alone) ** -2.0) ** -0.5


def test_two_records_separate_what_one_confounds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Turning straight across the field, a body is braked by eddy currents as by a fluid, and shows no inertia; along it, it is not."""
    pytest.importorskip("mujoco")
    from scipy.spatial.transform import Rotation

    conductance = 0.3 / SECONDS / (FIELD_T @ FIELD_T)

    def torque(t: float, R: np.ndarray, w: np.ndarray) -> np.ndarray:
        B = R.T @ FIELD_T
        return MEAN * conductance * np.cross(np.cross(w, B), B)

    other, _, axis = np.linalg.eigh(BODY)[1].T
    field = FIELD_T / np.linalg.norm(FIELD_T)
    across = np.cross(field, [0.0, 0.0, 1.0])
    begun = []
    for way, rate in ((across / np.linalg.norm(across), 2.5 * axis), (field, 2.5 * axis + 0.3 * other)):
        x, y, z, w = Rotation.align_vectors([way], [axis])[0].as_quat()
        begun.append((np.array([w, x, y, z]), rate))
    names = ("eddy-current-torque", "viscous-damping")
    monkeypatch.setattr(selection, "in_balance", lambda: [effects()[n] for n in names])
    monkeypatch.setattr(selection, "first_look_at_wheel", _none)
    found = [diagnose_by_balance(r) for r in _records(Acting(torque=torque), begun)]
    assert [f.document["verdict"] for f in found] == ["ambiguous", "named"]
    joint = together([f.selection for f in found])
    assert joint.verdict == "named" and joint.named[0].name == "eddy-current-torque"
    common = joint.named[0].common
    assert _off(common, "eddy-current-torque", {"conductance": conductance}) < 3.0
    alone = [np.sqrt(c.best.covariance["eddy-current-torque"][0, 0]) for c in joint.named[0].candidates]
    assert common.sigma["eddy-current-torque"]["conductance"] < min(alone)
    document = document_of_together(joint, ["across", "along"], [f.document for f in found])
    assert document["effects"][0]["parameters"]["eddy-current-torque"]["conductance"] == pytest.approx(
        conductance, rel=0.05
    )
    assert "parameters the same" in document["reason"]


def _none(record: Record) -> Candidate:
    raise NotPossible("not tried")


def test_what_is_told_by_other_fits_than_count_does_not_part_the_records() -> None:
    """A wheel whose rate was measured counts beside an unknown torque and is told by itself, with sigmas that hold for one record."""
    fits = [without_effects(record_of_rates(tumble(rate=60.0, seconds=0.6, seed=k)))[0] for k in (1, 2)]
    own = tuple(Candidate(alone=f, told=f) for f in fits)
    common = common_of(fits)
    moved = [
        replace(law, mean=law.mean + s * np.sqrt(np.diag(law.covariance)))
        for law, s in zip(common.records, (4, -4), strict=True)
    ]
    apart = replace(common, records=tuple(moved))
    effect = CommonEffect(name="wheel", evidence=50.0, common=apart, candidates=own, agreement=5.0)
    found = Together(verdict="named", named=(effect,), tried=(effect,), common=apart, agreement=5.0)
    document = document_of_together(found, ["a", "b"], [{"warnings": []}, {"warnings": []}])
    assert any("the records differ in k" in w for w in document["warnings"])
    assert any("sigmas" in w and "times as large" in w for w in document["warnings"])
    assert "its parameters the same" not in document["reason"]
    alike = replace(found, named=(replace(effect, common=common),), common=common)
    sigma = document_of_together(alike, ["a", "b"], [{"warnings": []}, {"warnings": []}])["k1"]["sigma"]
    assert found.stretch > 2.0 and document["k1"]["sigma"] > 2.0 * sigma


def test_one_effect_in_turned_axes_is_told_with_the_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    """A sensor that has slipped between two records, where no turn is let in: each shows the drag, together they have no inertia in
    common."""
    monkeypatch.setattr(criteria, "TURNED", np.inf)
    usable = selection.usable_effects
    monkeypatch.setattr(
        selection, "usable_effects", lambda r: ([e for e in usable(r)[0] if e.NAME == "viscous-damping"], {})
    )
    monkeypatch.setattr(selection, "first_look_at_wheel", _none)
    fits = []
    for k in (1, 2):
        series = tumble(torque=lambda t, w: -0.5 * w, rate=60.0, seconds=0.6, seed=k)
        axis = np.array([0.0, 0.0, 0.05 * (k - 1)])
        turned = rotation_matrix(from_rotation_vector(axis))
        fits.append(diagnose_by_balance(Sequence(rates=replace(series, w=series.w @ turned))))
    found = together([f.selection for f in fits])
    with pytest.raises(
        NotPossible, match="one inertia and one viscous-damping .* apart in .*turn .rad. about principal axis"
    ):
        document_of_together(found, ["a", "b"], [f.document for f in fits])
    effect = replace(found.named[0], candidates=())
    unexplained = replace(found, verdict="unexplained", named=(), agreement=0.0, split=effect)
    reason = document_of_together(unexplained, ["a", "b"], [f.document for f in fits])["reason"]
    assert "viscous-damping explains each by itself, but they differ in" in reason


def test_records_of_different_rates_tell_by_which_law_a_drag_acts(monkeypatch: pytest.MonkeyPatch) -> None:
    """A drag in proportion to the rate: no record by itself says that it is none by the rate's square."""
    usable = selection.usable_effects
    monkeypatch.setattr(
        selection, "usable_effects", lambda r: ([e for e in usable(r)[0] if e.NAME == "drag-by-axis"], {})
    )
    monkeypatch.setattr(selection, "first_look_at_wheel", _none)
    found = [diagnose_by_balance(seen("rates", np.zeros(3), k, drag=0.015, speed=s)) for k, s in enumerate((0.5, 1.2))]
    law = "drag-by-rate-squared"
    assert [f.document["verdict"] for f in found] == ["none", "named"]
    assert [c.alike for c in found[1].selection.tried] == [(law,)]
    joint = together([f.selection for f in found])
    assert joint.verdict == "named" and joint.named[0].name == "drag-by-axis"
    assert {e.name for e in joint.tried} == {"drag-by-axis", law}
    reason = document_of_together(joint, ["slow", "fast"], [f.document for f in found])["reason"]
    assert f"together they tell it from {law}" in reason
