"""What a model leaves of the measurements, those its fit saw and those it did not: by blocks in time, each held out in turn."""

from __future__ import annotations

import numpy as np

from massprops.core.robust import rms
from massprops.diagnosis import criteria
from massprops.diagnosis.hypothesis_fit import HypothesisFit


def noise_floor(fit: HypothesisFit) -> np.ndarray:
    """(3,) the noise by component, over that of the rows: one where it is stated, else what the fit finds.

    Args:
        fit: with a latent torque, so that noise is what no smooth torque can follow either.
    """
    return np.ones(3) if fit.record.stated else np.resize(fit.noise, 3)


def fitted_rms(fit: HypothesisFit, noise: np.ndarray) -> float:
    """Root mean square of what a fit leaves, over the noise (3,)."""
    return rms(fit.residual / noise)


def held_out_rms(fit: HypothesisFit, over: np.ndarray) -> float:
    """Root mean square of what blocks hold beyond the prediction from the others, over the noise (3,); NaN for short
    records.

    The fit's own linearisation serves: only what enters linearly is found again without the block. The first block and the
    last are always seen: a history that may be any, of a wheel or of an unknown torque, says nothing beyond its ends.
    """
    if len(fit.record.times) < criteria.FEWEST_HELD:
        return float("nan")
    times = fit.record.row_times
    count = len(times)
    blocks = min(criteria.BLOCKS, len(fit.record.times) // criteria.FEWEST_IN_BLOCK)
    block = np.minimum(np.argsort(np.argsort(times)) * blocks // count, blocks - 1)
    ends = (block == 0) | (block == blocks - 1)
    fold = np.repeat(np.where(ends, -1, block % criteria.FOLDS), 3)
    noise = fit.row_noise
    X = np.concatenate([b.columns for b in fit.blocks], axis=1)
    sd = np.concatenate([fit.posterior.sd[b.name] for b in fit.blocks])
    residual = np.full(len(fit.y), np.nan)
    for k in range(criteria.FOLDS):
        seen = fold != k
        A = X[seen] * sd / noise[seen, None]
        mean = sd * np.linalg.solve(A.T @ A + np.eye(len(sd)), A.T @ (fit.y[seen] / noise[seen]))
        residual[~seen] = fit.y[~seen] - X[~seen] @ mean
    return float(np.sqrt(np.nanmean((residual.reshape(-1, 3) / over) ** 2)))
