"""The balance of momentum against motions integrated by scipy, and each of its parts by its property."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from report.browser import BROWSER, check_page
from scipy.integrate import solve_ivp

from massprops.core.robust import rms
from massprops.diagnosis.conserved_start import conserved, conserved_across
from massprops.diagnosis.criteria import ALIKE, SCALE_SD, SCALES
from massprops.diagnosis.diagnose import diagnose_by_balance
from massprops.diagnosis.effect_columns import Term, forcing_of, in_balance, is_linear
from massprops.diagnosis.evidence import Block, solve
from massprops.diagnosis.held_out import held_out_rms
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import fit_hypothesis
from massprops.diagnosis.momentum_balance import inertia_jacobian, inertia_of, shape_of
from massprops.diagnosis.motion_path import path_from_rates
from massprops.diagnosis.record import record_of_rates
from massprops.diagnosis.scanned_values import at_likely_scale
from massprops.diagnosis.verdict import significance
from massprops.dynamics.environment import EnvironmentState
from massprops.dynamics.rotation import six_of
from massprops.effects import effects
from massprops.errors import NotPossible
from massprops.estimators.estimate import estimate_all
from massprops.sensing.free_flight import check_free_flight, lever
from massprops.sequence.data import AttitudeSeries, RateSeries, Sequence

INERTIA = inertia_of(np.array([0.4, -0.9, 0.1, 0.05, -0.1]))
SIGMA = 0.003
SKY = EnvironmentState((7e6, 1e5, 0.0), (0.6, 0.8, 0.0), (2e-5, -1e-5, 3e-5), 3.986e14)


def tumble(torque=None, wheel=None, seconds: float = 0.8, rate: float = 200.0, seed: int = 3) -> RateSeries:
    """Noisy rates of a body with a torque(t, w) over the mean moment, or a wheel(t) of momentum along z."""

    def slope(t, y):
        h = np.array([0.0, 0.0, wheel(t) if wheel else 0.0])
        w = np.linalg.solve(INERTIA, y - h)
        return np.cross(y, w) + (0.0 if torque is None else torque(t, w))

    times = np.arange(round(seconds * rate)) / rate
    w0 = np.array([4.0, -6.0, 5.0])
    start = INERTIA @ w0 + np.array([0.0, 0.0, wheel(0.0) if wheel else 0.0])
    y = solve_ivp(slope, (0.0, times[-1]), start, t_eval=times, rtol=1e-9, atol=1e-10, max_step=0.005).y.T
    h = np.stack(
        [np.zeros((len(times), 2)).T[0], np.zeros(len(times)), [wheel(t) if wheel else 0.0 for t in times]], axis=1
    )
    w = np.linalg.solve(INERTIA, (y - h).T).T
    noisy = w + SIGMA * np.random.default_rng(seed).standard_normal(w.shape)
    return RateSeries(np.round(times * 1e9).astype(np.int64), noisy, SIGMA)


def step(t: float) -> float:
    """A wheel that starts at .2 s and is held at .3 s."""
    return 1.5 * min(max((t - 0.2) / 0.1, 0.0), 1.0)


def test_the_shape_of_an_inertia_goes_back_and_forth_and_has_its_derivatives() -> None:
    shape = np.array([0.3, -0.7, 0.2, 0.5, -0.1])
    assert np.trace(inertia_of(shape)) == pytest.approx(3.0)
    assert shape_of(inertia_of(shape)) == pytest.approx(shape, abs=1e-12)
    for k, slope in enumerate(inertia_jacobian(shape)):
        e = 1e-6 * np.eye(5)[k]
        assert (inertia_of(shape + e) - inertia_of(shape - e)) / 2e-6 == pytest.approx(slope, abs=1e-8)
    moments = np.linalg.eigvalsh(inertia_of(np.array([9.0, -8.0, 3.0, 5.0, 0.0])))
    assert moments[0] > 0 and moments[0] + moments[1] >= moments[2] * (1 - 1e-12)


@pytest.mark.parametrize("name", [m.NAME for m in in_balance() if is_linear(m)])
def test_a_torque_taken_for_linear_is(name: str) -> None:
    effect = effects()[name]
    q, w, six = (0.5, 0.5, -0.5, 0.5), (0.3, -0.2, 0.6), six_of(INERTIA)
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((2, len(effect.PARAMETERS)))

    def torque(p):
        return np.array(effect.torque(0.7, q, w, list(p), six, SKY), float)

    assert torque(2.0 * a - 3.0 * b) == pytest.approx(2.0 * torque(a) - 3.0 * torque(b), rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("name", [m.NAME for m in in_balance()])
def test_columns_are_as_many_as_their_unknowns_and_move_the_rates(name: str) -> None:
    effect = effects()[name]
    path = path_from_rates(np.linspace(0, 1, 60), np.tile([1.0, 2.0, -1.0], (60, 1)))
    held = effect.momentum_scan(path.t, path.w)[2] if hasattr(effect, "momentum_scan") else {}
    term = Term(effect=effect, held=tuple(held.items()))
    forcing = forcing_of(term, path, path.w, INERTIA, SKY)
    if term.moves:  # what a scan begins with may have unknowns of another number
        term = term.moved(np.full(forcing.count, 0.1))
        forcing = forcing_of(term, path, path.w, INERTIA, SKY)
    assert forcing.count == (len(term.unknowns) if term.prior is None else term.prior.shape[1])
    assert set(term.unknowns) <= {p.name for p in effect.PARAMETERS}
    parts = [p for p in (forcing.momentum, forcing.internal, forcing.rate) if p is not None]
    assert np.all(sum(np.abs(p).max(axis=(0, 1)) for p in parts) > 0)


def test_free_rotation_gives_its_inertia_without_a_start_and_within_its_sigma() -> None:
    record = record_of_rates(tumble())
    start = conserved(record.path, record.rows.at)
    assert np.abs(start.inertia - INERTIA).max() < 0.02
    fit = fit_hypothesis(record, Hypothesis(latent=False), start)
    # 5 mm wide at 3 mrad/s: what the gyroscope's scale leaves open
    assert np.abs(fit.inertia - INERTIA).max() < 0.02
    assert rms(fit.residual) == pytest.approx(1.0, abs=0.1)
    assert held_out_rms(fit, np.ones(3)) < 1.15


def test_drag_by_axis_is_found_with_its_numbers() -> None:
    truth = np.array([0.35, 0.05, 0.2])
    record = record_of_rates(tumble(lambda t, w: -truth * w))
    term = Term(effect=effects()["drag-by-axis"])
    start = conserved(record.path, record.rows.at, forcing_of(term, record.path, record.path.w, np.eye(3)))
    fit = fit_hypothesis(record, Hypothesis(terms=(term,), latent=False), start)
    plain = fit_hypothesis(record, Hypothesis(latent=False), start)
    sd = np.sqrt(np.diag(fit.covariance["drag-by-axis"]))
    assert np.all(np.abs(fit.values["drag-by-axis"] - truth) < 4 * sd + 0.01)
    assert fit.evidence > plain.evidence + 100 and significance(fit) < 1e-6
    assert held_out_rms(fit, np.ones(3)) < 0.5 * held_out_rms(plain, np.ones(3))


def test_a_wheel_of_any_history_is_found_along_its_axis() -> None:
    record = record_of_rates(tumble(wheel=step))
    start = conserved_across(record.path, record.rows.at)
    assert start.axis is not None and abs(start.axis[2]) > np.cos(np.radians(5))
    fit = fit_hypothesis(record, Hypothesis(wheel=True, latent=False), start)
    assert fit.axis is not None and fit.history is not None
    truth = np.array([step(t) for t in record.path.t])
    history = fit.history * np.sign(fit.axis[2])
    assert abs(fit.axis[2]) > np.cos(np.radians(2))
    assert np.corrcoef(history, truth)[0, 1] > 0.99 and np.ptp(history) == pytest.approx(1.5, rel=0.1)
    plain = fit_hypothesis(record, Hypothesis(latent=False), start)
    assert fit.evidence > plain.evidence + 100


def test_a_brake_that_takes_hold_between_two_rates_is_drawn() -> None:
    """Within 6 ms, of which 300 rates a second see two: 60 knots in .8 s left 9.5 of the noise along the wheel's axis."""
    record = record_of_rates(tumble(wheel=lambda t: step(t) - min(max((t - 0.503) / 0.006, 0.0), 1.0), rate=300.0))
    start = conserved_across(record.path, record.rows.at)
    fit = fit_hypothesis(record, Hypothesis(wheel=True, latent=False), start)
    assert np.all(fit.noise < (1.1, 1.1, 3.5))


def test_evidence_finds_a_size_and_lets_go_of_noise() -> None:
    rng = np.random.default_rng(2)
    A, idle = rng.standard_normal((2, 300, 4))
    truth = np.array([1.0, -2.0, 0.5, 1.5])
    y = A @ truth + rng.standard_normal(300)
    active = Block(name="active", columns=A, sd=0.1, kind="common")
    alone = solve([active], y, 100.0)
    both = solve([active, Block(name="idle", columns=idle, sd=0.1, kind="common")], y, 100.0)
    assert alone.mean["active"] == pytest.approx(truth, abs=0.3) and alone.noise[0] == pytest.approx(1.0, abs=0.1)
    assert both.evidence < alone.evidence + 2.0
    nothing = solve([Block(name="idle", columns=idle, sd=0.1, kind="common")], y, 100.0)
    assert alone.evidence > nothing.evidence + 100


def test_sparse_steps_keep_the_large_ones_whole() -> None:
    rng = np.random.default_rng(3)
    n = 120
    steps = np.tril(np.ones((n, n)))
    truth = np.zeros(n)
    truth[[40, 80]] = 3.0, -2.0
    y = steps @ truth / 0.05 + rng.standard_normal(n)
    found = solve([Block(name="h", columns=steps / 0.05, sd=0.01, kind="sparse")], y, 100.0).mean["h"]
    assert found[[40, 80]] == pytest.approx([3.0, -2.0], abs=0.2)
    assert np.abs(np.delete(found, [40, 80])).max() < 0.1


def test_the_lever_is_found_and_a_hand_is_no_free_flight() -> None:
    series = tumble()
    times = series.timestamp_ns * 1e-9
    r = np.array([0.02, -0.01, 0.04])
    rate = np.gradient(series.w, times, axis=0)
    force = np.cross(rate, r) + np.cross(series.w, np.cross(series.w, r))
    found = lever(times, series.w, force)
    assert found.r == pytest.approx(r, abs=1e-3) and found.left < 0.1


def test_a_record_in_the_hand_is_refused(tmp_path) -> None:
    series = tumble()
    times = series.timestamp_ns * 1e-9
    path = path_from_rates(times, series.w)
    folder = tmp_path / "imu0"
    folder.mkdir()
    # a hand carries the body: gravity turns in its axes
    gravity = 9.8 * path.R[np.searchsorted(path.t, times - 1e-9), 2]
    rows = [
        f"{t}," + ",".join(f"{x:.6f}" for x in (*w, *a))
        for t, w, a in zip(series.timestamp_ns, series.w, gravity, strict=True)
    ]
    head = "#timestamp [ns],w_x [rad s^-1],w_y [rad s^-1],w_z [rad s^-1],a_x [m s^-2],a_y [m s^-2],a_z [m s^-2]"
    (folder / "data.csv").write_text("\n".join([head, *rows]) + "\n")
    held = Sequence(rates=series, folder=tmp_path)
    for use in (check_free_flight, diagnose_by_balance, estimate_all):
        with pytest.raises(NotPossible, match="no free flight"):
            use(held)
    # and where it lets go of it halfway
    free = [row.rsplit(",", 3)[0] + ",0,0,0" for row in rows]
    half = len(rows) // 2
    (folder / "data.csv").write_text("\n".join([head, *rows[:half], *free[half:]]) + "\n")
    with pytest.raises(NotPossible, match=r"m/s\^2 from 0.* to 0.* s that no distance"):
        check_free_flight(held)
    # beside attitudes too, along which the rates are rows
    q = path.q[np.searchsorted(path.t, times - 1e-9)]
    beside = AttitudeSeries(series.timestamp_ns, q, np.full(len(times), 1e-3))
    with pytest.raises(NotPossible, match="no free flight"):
        diagnose_by_balance(replace(held, attitude=beside))


def test_gravity_along_an_axis_that_a_table_turns_about_is_no_free_flight(tmp_path) -> None:
    t = np.arange(300) * 10**7
    w = np.tile([0.0, 0.0, 3.0], (300, 1)) + np.random.default_rng(0).normal(0.0, 1e-3, (300, 3))
    (tmp_path / "imu0").mkdir()
    head = "#timestamp [ns],w_x [rad s^-1],w_y [rad s^-1],w_z [rad s^-1],a_x [m s^-2],a_y [m s^-2],a_z [m s^-2]"
    rows = [f"{s},{x:.6f},{y:.6f},{z:.6f},0,0,9.81" for s, (x, y, z) in zip(t, w, strict=True)]
    (tmp_path / "imu0" / "data.csv").write_text("\n".join([head, *rows]) + "\n")
    with pytest.raises(NotPossible, match=r"measures 9.4 m/s\^2 .* no free flight"):
        check_free_flight(Sequence(rates=RateSeries(t, w, None), folder=tmp_path))


def test_rates_too_few_or_too_far_apart_are_refused() -> None:
    t = np.arange(8) * 10**7
    with pytest.raises(NotPossible, match="needs at least"):
        record_of_rates(RateSeries(t, np.ones((8, 3))))
    with pytest.raises(NotPossible, match="faster record"):
        record_of_rates(RateSeries(np.arange(40) * 10**8, np.full((40, 3), 30.0)))


def test_the_command_names_drag_and_writes_what_it_promises(tmp_path, capsys) -> None:
    import json

    from massprops.diagnosis.diagnose import decides
    from massprops.model import load_model
    from massprops.sequence.write import write_sequence
    from massprops_cli.main import run

    truth = np.array([0.6, 0.3, 0.9])
    sequence = Sequence(rates=tumble(lambda t, w: -truth * w, rate=60.0))
    assert decides(sequence)
    write_sequence(tmp_path / "seq", sequence)
    assert run(["diagnose", str(tmp_path / "seq"), "-o", str(tmp_path / "out"), "-q"]) == 0
    document = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert document["verdict"] == "named" and [e["name"] for e in document["effects"]] == ["drag-by-axis"]
    assert document["gap"]["held_out"]["after"] < 0.5 * document["gap"]["held_out"]["before"]
    assert document["latent"]["evidence"] > 0 and document["effects"][0]["significance"] < 1e-3
    model = load_model(tmp_path / "out" / "model.yaml")
    assert model.value("drag-by-axis") == pytest.approx(truth, abs=0.1)
    assert np.abs(model.inertia - INERTIA).max() < 0.05
    assert "<svg" in (tmp_path / "out" / "report.html").read_text() and "drag-by-axis" in capsys.readouterr().out
    if BROWSER is not None:
        check_page(tmp_path / "out" / "report.html", tmp_path)


def test_free_rotation_is_given_no_effect() -> None:
    from massprops.diagnosis.diagnose import diagnose_by_balance

    document = diagnose_by_balance(Sequence(rates=tumble(rate=80.0))).document
    assert document["verdict"] == "none" and document["effects"] == []
    assert document["gap"]["fitted"]["before"] == pytest.approx(1.0, abs=0.15)


def test_the_errors_of_a_gyroscope_are_as_large_as_the_record_says() -> None:
    """A true one has the narrowest prior, though the record hardly tells; one that shows other rates than the body's by 2 % keeps its
    own."""
    true = tumble()
    apart = 0.03 * np.array([[1.0, -0.6, 0.5], [0.7, -1.0, -0.4], [-0.5, 0.6, 0.8]])
    bent = RateSeries(true.timestamp_ns, true.w @ (np.eye(3) + apart).T, SIGMA)
    found = []
    for series in (true, bent):
        record = record_of_rates(series)
        fit = fit_hypothesis(record, Hypothesis(latent=False), conserved(record.path, record.rows.at))
        best = at_likely_scale(fit)
        assert best.evidence > fit.evidence - ALIKE
        found.append(best.hypothesis.scale)
    assert found[0] == SCALES[0] and found[1] == SCALE_SD
