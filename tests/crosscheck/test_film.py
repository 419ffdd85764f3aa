"""A film whose images were placed by one free motion is asked for its inertia itself."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from crosscheck.test_crosscheck import make_run
from estimators.made_sequence import AXES, TRUE_K, simple_method

from massprops.consistency.crosscheck import crosscheck
from massprops.consistency.film import FILM, FLOOR, film_estimate
from massprops.estimators import methods as registry
from massprops.mass.ratio_space import inertia_of, log_components
from massprops.sequence import RateSeries, write_sequence
from massprops.sequence.read import read_sequence
from massprops.sfm.free_motion import BASIS

WRONG = TRUE_K + [0.2, -0.1]


@pytest.fixture(autouse=True)
def simple(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "methods", lambda: {"simple": simple_method()})


def with_film(run: Path, k: np.ndarray, covariance: np.ndarray) -> Path:
    """The run with what its film's adjustment says."""
    inertia = inertia_of(k, AXES)
    (run / "work" / "sfm").mkdir(parents=True)
    file = run / "work" / "sfm" / "precision.npz"
    np.savez(file, inertia=inertia / np.cbrt(np.linalg.det(inertia)), inertia_covariance=covariance)
    return run


def test_its_ratios_and_covariance_are_those_of_the_logarithm(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    half = 0.01 * rng.standard_normal((5, 5))
    found, covariance = film_estimate(with_film(tmp_path, TRUE_K, half @ half.T), AXES)
    np.testing.assert_allclose([found.k1, found.k2], TRUE_K, atol=1e-9)
    np.testing.assert_allclose(np.trace(found.inertia), 1.0)
    moments, own = np.linalg.eigh(found.inertia)
    log = own @ np.diag(np.log(moments)) @ own.T
    drawn = log + np.einsum("rk,kij->rij", rng.standard_normal((20000, 5)) @ half.T, BASIS)
    w, v = np.linalg.eigh(drawn)
    five = log_components(np.einsum("rij,rj,rkj->rik", v, np.exp(w), v), AXES)
    np.testing.assert_allclose(np.cov(five.T), covariance, atol=FLOOR**2 + 0.03 * covariance.diagonal().max())
    np.testing.assert_allclose(found.k_covariance, covariance[:2, :2], atol=1e-9)


def test_the_verdict_rests_on_it(tmp_path: Path) -> None:
    run = with_film(make_run(tmp_path / "run", TRUE_K), TRUE_K, 0.005**2 * np.eye(5))
    right = crosscheck(run, write=False)
    assert right.verdict == "consistent" and right.document["rests_on"] == FILM
    assert [e["name"] for e in right.document["estimators"]] == [FILM, "simple"]
    wrong = crosscheck(with_film(make_run(tmp_path / "other", TRUE_K), WRONG, 0.005**2 * np.eye(5)), write=False)
    assert wrong.verdict == "inconsistent" and wrong.document["rests_on"] == FILM


def test_a_film_that_shows_no_ratios_is_not_outvoted_by_what_reads_its_attitudes(tmp_path: Path) -> None:
    run = with_film(make_run(tmp_path / "run", WRONG), TRUE_K, np.eye(5))
    found = crosscheck(run, write=False)
    assert found.verdict == "unobservable" and "the film does not show k1 and k2" in found.document["reason"]
    assert [e["observable"] for e in found.document["estimators"]] == [False, True]


def test_a_gyroscope_may_show_what_a_film_does_not(tmp_path: Path) -> None:
    run = with_film(make_run(tmp_path / "run", TRUE_K), TRUE_K, np.eye(5))
    sequence = read_sequence(run)
    rates = RateSeries(sequence.attitude.timestamp_ns, np.zeros((len(sequence.attitude.timestamp_ns), 3)), None)
    shutil.rmtree(run / "sequence")
    write_sequence(run / "sequence", replace(sequence, rates=rates))
    found = crosscheck(run, write=False)
    assert [e["name"] for e in found.document["estimators"]] == ["simple"]


def test_a_run_whose_images_have_poses_of_their_own_has_none(tmp_path: Path) -> None:
    assert film_estimate(tmp_path, AXES) is None
    (tmp_path / "work" / "sfm").mkdir(parents=True)
    np.savez(tmp_path / "work" / "sfm" / "precision.npz", attitude=np.ones(3))
    assert film_estimate(tmp_path, AXES) is None
