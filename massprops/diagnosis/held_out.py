"""How well a model predicts parts of the record that its fit did not see: by blocks in time, each held out in turn."""

from __future__ import annotations

import numpy as np

from massprops.diagnosis import criteria
from massprops.diagnosis.hypothesis_fit import HypothesisFit


def held_out_rms(fit: HypothesisFit) -> float:
    """Root mean square of what blocks hold beyond the prediction from the others, over the noise; NaN for short records.

    The fit's own linearisation serves: only what enters linearly is found again without the block.
    """
    count = len(fit.record.times)
    if count < criteria.FEWEST_HELD:
        return float("nan")
    block = np.minimum(np.arange(count) * criteria.BLOCKS // count, criteria.BLOCKS - 1)
    fold = np.repeat(block % criteria.FOLDS, 3)
    noise = np.resize(fit.noise, 3)[np.arange(3 * count) % 3]
    X = np.concatenate([b.columns for b in fit.blocks], axis=1)
    sd = np.concatenate([fit.posterior.sd[b.name] for b in fit.blocks])
    left = np.empty(len(fit.y))
    for k in range(criteria.FOLDS):
        seen = fold != k
        A = X[seen] * sd / noise[seen, None]
        mean = sd * np.linalg.solve(A.T @ A + np.eye(len(sd)), A.T @ (fit.y[seen] / noise[seen]))
        left[~seen] = fit.y[~seen] - X[~seen] @ mean
    return float(np.sqrt(np.mean(left**2)))
