"""Whether the intervals of a push in a short toss hold it: the effect given, begun near its time; a few seconds of CPU each.

MASSPROPS_TOSS_SEEDS=30-59 runs others than 0 to 29, on which how fits settle was set.
"""

from __future__ import annotations

import os

import numpy as np
import pytest
from scipy.stats import norm

from massprops.diagnosis.document import parameters, rate_change
from massprops.diagnosis.effect_columns import Term
from massprops.diagnosis.effect_search import BALL, moved_to_best
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import fit_hypothesis
from massprops.diagnosis.record import record_of_attitudes
from massprops.diagnosis.scanned_values import with_scanned
from massprops.effects import effects
from massprops.sequence.data import Environment

pytestmark = pytest.mark.bench
FIRST, LAST = (int(s) for s in os.environ.get("MASSPROPS_TOSS_SEEDS", "0-29").split("-"))
WITHIN = float(norm.ppf(0.95))
"""Sigmas of a 90 % interval."""


def test_intervals_of_a_push_in_a_toss(capsys) -> None:
    from diagnosis.tossed_bodies import RATE, drawn, tossed

    held = {"time": 0, "duration": 0, "kick": 0}
    seeds, worst = range(FIRST, LAST + 1), []
    with capsys.disabled():
        print()
        for seed in seeds:
            toss = drawn(seed)
            series, change = tossed(toss, seed)
            start = {"duration": 0.02, "parts": 1, "time": toss.begins + 0.5 * toss.lasts - 0.01}
            term = Term(effect=effects()["impulse"], held=tuple(sorted(start.items())))
            begun = fit_hypothesis(
                record_of_attitudes(series, Environment()), Hypothesis(terms=(term,), latent=False), BALL
            )
            fit = with_scanned(moved_to_best(begun, 1 / RATE), 1 / RATE)
            value, sigma = parameters(fit, "impulse")
            truth = {"time": toss.begins, "duration": toss.lasts}
            off = {n: (value[n] - t) / max(sigma[n], 1e-12) for n, t in truth.items()}
            kick = [
                (value[f"kick_{a}"] - t) / max(sigma[f"kick_{a}"], 1e-12) for a, t in zip("xyz", toss.kick, strict=True)
            ]
            for n in truth:
                held[n] += abs(off[n]) < WITHIN
            held["kick"] += sum(abs(z) < WITHIN for z in kick)
            worst.append(max(map(abs, kick)))
            apart = np.linalg.norm(rate_change(fit) - change) / np.linalg.norm(change)
            note = "" if fit.settled else "; not settled"
            told = [sigma[f"kick_{a}"] for a in "xyz"]
            print(
                f"{seed:4} kick off by {', '.join(f'{z:+.1f}' for z in kick)} sigma, of "
                f"{', '.join(f'{s:.2f}' for s in told)} rad/s; time {off['time']:+.1f}, length "
                f"{off['duration']:+.1f}; change of rate off by {100 * apart:.1f} %{note}",
                flush=True,
            )
        n = len(seeds)
        print(
            f"90 % intervals hold {held['time']} of {n} times, {held['duration']} of {n} lengths, {held['kick']} of {3 * n} "
            f"components of the kick; the worst is {max(worst):.0f} sigma off"
        )
    assert held["kick"] >= 0.8 * 3 * n
