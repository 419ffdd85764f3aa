"""A process learnt from the past, asked about an occlusion: values, rates, and variances fit for a filter."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from massprops.errors import NotPossible
from massprops.estimators.gp import QuasiPeriodicProcess, fit_process

MOST_SAMPLES = 1500
"""Latest samples learnt from."""


@dataclass(frozen=True)
class Foresight:
    """One process's view of n epochs, d outputs.

    Attributes:
        value, rate: (n, d). variance: (n, 2d) of values and rates, to be used as if white: see `foresee`.
        covariance: (n, 2d, 2d) the process's own. noise: 1-sigma of the samples that it found.
        shares: epochs that carry one independent error.
        process: for its frequencies.
    """

    value: np.ndarray
    rate: np.ndarray
    variance: np.ndarray
    covariance: np.ndarray
    noise: float
    shares: float
    process: QuasiPeriodicProcess


def foresee(t: np.ndarray, y: np.ndarray, ahead: np.ndarray, frequencies: np.ndarray | None = None) -> Foresight:
    """Learns y(t) and foresees it at `ahead`.

    The process's errors at neighbouring epochs are nearly the same: all of them come from its few learnt amplitudes
    and two frequencies. A filter that takes n of them as white would count each n / r times, r the number of
    amplitudes learnt, so the variances are larger than the process's own by that factor.

    Args:
        t: (n,) [s]; y: (n, d), rows with NaN are left out. ahead: (k,) [s].
        frequencies: (2,) start [Hz], e.g. those of another feature of the same body; by default from the spectrum.

    Raises:
        NotPossible: too few samples, or no period in them.
    """
    there = np.isfinite(y).all(axis=1)
    t, y = t[there][-MOST_SAMPLES:], y[there][-MOST_SAMPLES:]
    process = fit_process(t, y, frequencies)
    d = y.shape[1]
    _, _, learnt = process.predict(t)
    amplitudes = float(np.einsum("nii->ni", learnt)[:, :d].sum() / d / max(process.noise_sigma, 1e-300) ** 2)
    value, rate, covariance = process.predict(ahead)
    shares = max(1.0, len(ahead) / max(amplitudes, 1.0))
    variance = shares * np.einsum("nii->ni", covariance)
    return Foresight(value, rate, variance, covariance, process.noise_sigma, shares, process)


def foresee_features(t: np.ndarray, outputs: list[np.ndarray], ahead: np.ndarray) -> list[Foresight | None]:
    """One process per feature of one body, the later ones begun at the frequencies found so far.

    A feature that the shared frequencies do not explain to the noise found for the others is learnt on its own
    spectrum as well, and the likelier of the two is kept.

    Args:
        outputs: (n, d) per feature. Others as in `foresee`.

    Returns:
        None for a feature that cannot be learnt.
    """
    foresights: list[Foresight | None] = []
    best: Foresight | None = None
    for y in outputs:
        trials = []
        starts: list[np.ndarray | None] = [None] if best is None else [best.process.f]
        while starts:
            start = starts.pop(0)
            with suppress(NotPossible, np.linalg.LinAlgError):
                trials.append(foresee(t, y, ahead, start))
            poor = not trials or (best is not None and trials[-1].noise > 1.5 * best.noise)
            if start is not None and poor and len(trials) < 2:
                starts.append(None)
        if not trials:
            foresights.append(None)
            continue
        chosen = max(trials, key=lambda f: f.process.log_likelihood)
        foresights.append(chosen)
        if best is None or chosen.noise < best.noise:
            best = chosen
    # the first was learnt alone: where it stands out as poor, the others' frequencies may mend it
    for i, one in enumerate(foresights):
        if one is not None and best is not None and one is not best and one.noise > 1.5 * best.noise:
            try:
                again = foresee(t, outputs[i], ahead, best.process.f)
            except (NotPossible, np.linalg.LinAlgError):
                continue
            if again.process.log_likelihood > one.process.log_likelihood:
                foresights[i] = again
    return foresights
