"""Variances and what the unknowns take up of the residual, without the covariance where one noise factor is all."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from massprops.diagnosis import evidence
from massprops.diagnosis.evidence import Block, _covariance, _rows, _unknowns, solve


def test_variances_of_one_group_are_those_of_the_covariance() -> None:
    rng = np.random.default_rng(3)
    X, y, sd = rng.standard_normal((40, 6)), rng.standard_normal(40), rng.uniform(0.2, 2.0, 6)
    rows = _rows([Block(name="a", columns=X, sd=1.0)], y, None)
    _, variance, taken, factor = _unknowns(rows, sd, np.array([1.3]))
    covariance = np.linalg.inv(X.T @ X / 1.3**2 + np.diag(sd**-2.0))
    assert np.allclose(variance, np.diag(covariance))
    assert np.allclose(taken, np.sum(covariance * rows.G[0]))
    assert np.allclose(_covariance(factor, sd), covariance)


def test_one_noise_factor_and_three_alike_agree() -> None:
    """Rows that are the same three times over have the same factor in each group."""
    rng = np.random.default_rng(4)
    X, y = rng.standard_normal((50, 4)), 2.0 * rng.standard_normal(50)
    blocks = [Block(name="a", columns=np.repeat(X, 3, axis=0), sd=1.0, kind="common")]
    rows = np.repeat(y, 3)
    one = solve(blocks, rows, 3.0)
    three = solve(blocks, rows, 1.0, np.tile([0, 1, 2], 50))
    assert np.allclose(one.noise, three.noise, rtol=1e-3) and np.allclose(one.mean["a"], three.mean["a"], rtol=1e-3)


@pytest.mark.parametrize("seed", [1, 2])
def test_few_steps_among_many_are_found_from_whatever_size_it_begins_at(seed: int) -> None:
    """What is not needed goes to nothing slowly: by plain steps the search ended 0.6 and 0.7 apart."""
    rng, t = np.random.default_rng(seed), np.linspace(0.0, 1.0, 300)
    rises = np.maximum(t[:, None] - np.linspace(0.0, 1.0, 61), 0.0)
    X = 100.0 * (rises[:, :-1] - rises[:, 1:])
    steps = np.zeros(60)
    steps[[10, 11, 40]] = [40.0, 30.0, -60.0]
    y = X @ steps + rng.standard_normal(len(t))
    found = [solve([Block(name="a", columns=X, sd=sd, kind="sparse")], y, 100.0).evidence for sd in (0.01, 100.0)]
    assert abs(found[0] - found[1]) < 0.3


def test_a_wide_block_set_apart_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(5)
    X, y = rng.standard_normal((80, 25)), rng.standard_normal(80)
    kinds: list[tuple[str, slice, Any]] = [
        ("a", slice(0, 5), "fixed"),
        ("b", slice(5, 15), "common"),
        ("c", slice(15, 25), "sparse"),
    ]
    blocks = [Block(name=n, columns=X[:, own], sd=0.5, kind=kind) for n, own, kind in kinds]
    whole = solve(blocks, y, 3.0)
    monkeypatch.setattr(evidence, "WIDE", 10)
    apart = solve(blocks, y, 3.0)
    assert apart.evidence == pytest.approx(whole.evidence, abs=1e-9)
    assert np.allclose(apart.joint, whole.joint, atol=1e-9) and np.allclose(apart.noise, whole.noise, atol=1e-9)
    assert all(np.allclose(apart.mean[n], whole.mean[n], atol=1e-9) for n, _, _ in kinds)


@pytest.mark.parametrize("steps", [1, 60])
def test_the_compiled_search_is_the_plain_one(steps: int) -> None:
    """Steps of numpy, as searches with sparse or wide blocks take, lead to the same sizes and evidence."""
    rng = np.random.default_rng(6)
    X, y = rng.standard_normal((60, 9)), 3.0 * rng.standard_normal(60)
    blocks = [
        Block(name="a", columns=X[:, :3], sd=np.array([0.1, 1.0, 10.0])),
        Block(name="b", columns=X[:, 3:7], sd=0.3, kind="common"),
        Block(name="c", columns=X[:, 7:], sd=2.0, kind="common"),
    ]
    search = evidence._Search(_rows(blocks, y, None), blocks, 5.0)
    begun = search.begun(None)
    own = search.by_kernel(begun, steps)
    search.plain = False
    other = evidence._searched(search, begun, steps)
    assert own.evidence == pytest.approx(other.evidence, abs=1e-9)
    assert other.factor is not None and np.allclose(own.factor, other.factor, atol=1e-12)
    for name in ("mean", "sizes", "moved"):
        assert np.allclose(getattr(own, name), getattr(other, name), rtol=1e-9)


def test_the_compiled_search_says_when_numbers_leave_all_bounds() -> None:
    X = np.full((4, 2), 1e200)
    with pytest.raises(FloatingPointError), np.errstate(over="ignore"):
        solve([Block(name="a", columns=X, sd=1.0)], np.ones(4), 1.0)
    with pytest.raises(FloatingPointError):
        solve([Block(name="a", columns=np.ones((4, 2)), sd=1.0)], np.full(4, 1e200), 1.0)


def test_a_sparse_block_pays_by_the_law_of_its_precisions() -> None:
    """The bound is the mixture's: normal unknowns of the sizes before, less the entropy and prior of gamma precisions."""
    from scipy.special import gammaln

    from massprops.diagnosis.size_kernel import sparse_moved

    rng = np.random.default_rng(7)
    sd, second, own, scale = rng.uniform(0.1, 2.0, 6), rng.uniform(0.01, 4.0, 6), np.array([0.3]), 0.7
    a, b = 0.5, 0.5 * np.array([0.3] + [0.7] * 5) ** 2
    expected = np.log(sd) + 0.5 * second / sd**2 + a * np.log(b) - gammaln(a) + gammaln(1.0)
    moved = sd.copy()
    gained, new = sparse_moved(moved, second, own, scale, 1.0)
    precision = 1.0 / (b + 0.5 * second)
    assert gained == pytest.approx(np.sum(expected + np.log(precision)))
    assert np.allclose(moved, precision**-0.5) and new == pytest.approx(np.mean(precision[1:]) ** -0.5)
