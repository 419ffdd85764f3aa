"""Whether the fit of the effect that acts is the likeliest: one begun at the truth must not be likelier. A few seconds of CPU each.

Bodies that MuJoCo moves with one effect of `diagnosis.pair_worlds`. MASSPROPS_MINIMUM_SEEDS=0,26 runs more; goal: none of 300.
"""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np
import pytest

from massprops.diagnosis.conserved_start import Start
from massprops.diagnosis.effect_columns import term_of
from massprops.diagnosis.effect_search import best_fit, moved_to_best
from massprops.diagnosis.hypothesis import Hypothesis
from massprops.diagnosis.hypothesis_fit import HypothesisFit, fit_hypothesis
from massprops.diagnosis.record import Record, record_of_attitudes
from massprops.diagnosis.scanned_values import with_scanned
from massprops.diagnosis.unnamed import without_effects
from massprops.diagnosis.wheel_of_any_history import wheel_of_any_history
from massprops.effects import effects

pytestmark = pytest.mark.bench
FIRST, LAST = (int(s) for s in os.environ.get("MASSPROPS_MINIMUM_SEEDS", "0,3").split(","))
LIKELIER = 0.5
"""Log evidence from which another fit is likelier: fits of one hypothesis settle within less."""


def _both(record: Record, name: str, world: object, acting: object) -> tuple[HypothesisFit, HypothesisFit]:
    """The fit that is found, and the one begun at the truth."""
    from diagnosis.pair_worlds import CALLED, Acting, World

    assert isinstance(world, World) and isinstance(acting, Acting)
    inertia = 3.0 * world.inertia / np.trace(world.inertia)
    if name == "internal-rotor":
        own = wheel_of_any_history(record if record.rows.rates else without_effects(record)[1].record)
        assert own.with_latent is not None and acting.axis is not None and acting.history is not None
        h = acting.history(record.path.t) * 3.0 / np.trace(world.inertia)
        start = Start(inertia=inertia, left=1.0, axis=acting.axis, history=h)
        lag = own.alone.hypothesis.lag
        return own.alone, fit_hypothesis(record, Hypothesis(wheel=True, lag=lag, latent=False), start)
    effect = effects()[CALLED.get(name, name)]
    found = best_fit(record, effect, without_effects(record)[0])
    hypothesis = Hypothesis(terms=(term_of(effect, acting.held),), latent=False)
    true = fit_hypothesis(record, hypothesis, Start(inertia=inertia, left=1.0))
    assert found is not None
    gap = float(np.median(np.diff(record.times)))
    return with_scanned(found, gap), with_scanned(moved_to_best(true, gap), gap)


def test_no_fit_begun_at_the_truth_is_likelier(capsys) -> None:
    pytest.importorskip("mujoco")
    from diagnosis.pair_worlds import MUJOCO, Acting, World, _sequence, _world, moved, shows, sliding

    kinds: dict[str, Callable[[np.random.Generator, World], Acting]] = {
        **MUJOCO, "spring-mass-damper": lambda rng, world: sliding(rng, world)[0],
    }  # fmt: skip
    count, missed = 0, []
    for seed in range(FIRST, LAST + 1):
        for k, (name, drawn) in enumerate(kinds.items()):
            rng = np.random.default_rng([seed, k, 103])
            world = _world(rng)
            acting = drawn(rng, world)
            sequence = _sequence(*moved(world, [acting]), world.sun, rng)
            if not shows(sequence):
                continue
            assert sequence.attitude is not None
            found, true = _both(record_of_attitudes(sequence.attitude, sequence.environment), name, world, acting)
            count += 1
            if true.evidence > found.evidence + LIKELIER:
                missed.append((seed, name, true.evidence - found.evidence))
                with capsys.disabled():
                    print(f"\n{seed:4} {name}: begun at the truth it is {missed[-1][2]:.1f} likelier", flush=True)
    with capsys.disabled():
        print(f"\nlikelier from the truth in {len(missed)} of {count} fits")
    assert len(missed) <= 0.1 * count
    if missed:
        pytest.xfail(f"likelier from the truth in {len(missed)} of {count}, none wanted")
