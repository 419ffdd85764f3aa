"""Errors that are alike in time: the density of the innovations against that of the whole covariance."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from scipy.stats import multivariate_normal

from massprops.diagnosis.correlated_errors import innovations, log_density


def test_innovations_have_the_density_of_the_rows() -> None:
    rng = np.random.default_rng(1)
    times, memory = np.cumsum(rng.uniform(0.5, 2.0, 9)), 1.7
    record = SimpleNamespace(times=times, rows=SimpleNamespace(rates=False))
    rows = rng.standard_normal((len(times), 3))
    covariance = np.exp(-np.abs(times[:, None] - times) / memory)
    whole = sum(multivariate_normal(cov=covariance).logpdf(rows[:, k]) for k in range(3))
    own = innovations(rows.reshape(-1), record, memory)
    independent = -0.5 * float(own @ own) - 0.5 * own.size * np.log(2.0 * np.pi)
    assert np.isclose(independent + log_density(record, memory), whole)
    # rates beside attitudes stay as they are
    more = innovations(np.concatenate([rows.reshape(-1), [5.0, 6.0, 7.0]]), record, memory)
    assert np.allclose(more[-3:], [5.0, 6.0, 7.0]) and np.allclose(more[:-3], own)
