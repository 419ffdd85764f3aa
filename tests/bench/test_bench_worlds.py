"""Attitudes of bodies that Basilisk and MuJoCo move, with hidden effects, diagnosed by the balance of momentum: about
fifteen seconds of CPU each.

Thresholds were set on seeds 1 and 2, and how pairs are looked for on seeds 11 and 51. The bench runs others:
MASSPROPS_WORLD_SEEDS=21,22 and so on. Basilisk's up to 68 have been looked at, MuJoCo's up to 74, sliding masses up to 33.
"""

from __future__ import annotations

import os

import numpy as np
import pytest

from massprops.diagnosis.diagnose import diagnose_by_balance

pytestmark = pytest.mark.bench
SEEDS = [int(s) for s in os.environ.get("MASSPROPS_WORLD_SEEDS", "21,22").split(",")]
PAIR_SEEDS = range(226, 238)
CALLED = {"sunlight": "solar-pressure-on-facets", "wheel-that-coasts": "internal-rotor"}
"""Effects under another name than Basilisk's kind."""


def _judged(records: list) -> tuple[int, int, int]:
    """Prints a line for each of (label, truth, sequence), of truths apart by | any; how many are right, named wrong, and all that show an effect."""
    right, wrong, shown = 0, 0, 0
    spent = []
    for label, truth, sequence in records:
        begun = os.times()
        document = diagnose_by_balance(sequence).document
        cpu = sum(os.times()[:2]) - sum(begun[:2])
        spent.append(cpu)
        names = [e["name"] for e in document["effects"]]
        gap = document["gap"]
        rights = [sorted(one.split(" + ")) for one in truth.split(" | ")]
        good = document["verdict"] == "none" if truth == "none" else sorted(names) in rights
        counts = truth == "none" or gap["fitted"]["before"] > 1.15
        right += good and counts
        wrong += document["verdict"] == "named" and not good
        shown += counts
        held = gap["held_out"]["after"]
        print(
            f"{label:<32}{document['verdict']:<12}{' + '.join(names):<42}{gap['fitted']['before']:8.2f} ->"
            f"{gap['fitted']['after']:6.2f}, held out {np.nan if held is None else held:5.2f}{cpu:7.1f} s"
            f"{'' if counts else '  (not counted)'}",
            flush=True,
        )
    print(
        f"right {right} of {shown}, named wrong {wrong}; CPU median {np.median(spent):.0f} s, most {max(spent):.0f} s"
    )
    return right, wrong, shown


def test_bodies_moved_by_basilisk(capsys) -> None:
    pytest.importorskip("Basilisk")
    from diagnosis.basilisk_worlds import KINDS, WHEELS, recorded

    with capsys.disabled():
        print()
        found = _judged([(f"{k}:{s}", CALLED.get(k, k), recorded(k, s)) for s in SEEDS for k in (*KINDS, *WHEELS)])
    right, wrong, shown = found
    assert right >= 0.9 * shown and wrong <= 0.1 * shown


def test_two_effects_at_once_in_basilisk(capsys) -> None:
    pytest.importorskip("Basilisk")
    from diagnosis.basilisk_worlds import PAIRS, recorded

    def both(pair: str) -> str:
        return " + ".join(CALLED.get(k, k) for k in pair.split("+"))

    with capsys.disabled():
        print()
        right, wrong, shown = _judged([(f"{p}:{s}", both(p), recorded(p, s)) for s in SEEDS for p in PAIRS])
    if right < 0.85 * shown:
        pytest.xfail(f"both named in {right} of {shown}, 85 % wanted")
    assert wrong <= 0.1 * shown


def test_two_of_the_catalogue_drawn_at_random(capsys) -> None:
    """Both named, or among what is listed as ambiguous. Seeds 100 to 111, 202, 205, 206, 229, 230 and 233 served while pairs were
    mended; those up to 309 have been looked at."""
    pytest.importorskip("Basilisk")
    pytest.importorskip("mujoco")
    from diagnosis.pair_worlds import drawn

    right = wrong = 0
    with capsys.disabled():
        print()
        for seed in PAIR_SEEDS:
            pair = drawn(seed)
            selection = diagnose_by_balance(pair.sequence).selection
            named = [sorted(c.alone.names) for c in selection.named]
            good = sorted(pair.names) in named
            right += good
            wrong += bool(named) and not good
            print(f"{seed:5} {pair.engine:<10}{' + '.join(pair.names):<56}{selection.verdict:<12}{named}", flush=True)
        print(f"both named {right} of {len(PAIR_SEEDS)}, named wrong {wrong}")
    if right < 0.85 * len(PAIR_SEEDS):
        pytest.xfail(f"both named in {right} of {len(PAIR_SEEDS)}, 85 % wanted")
    assert wrong <= 0.1 * len(PAIR_SEEDS)


def test_strangers_are_not_misnamed(capsys) -> None:
    pytest.importorskip("Basilisk")
    from diagnosis.basilisk_worlds import STRANGERS, recorded

    with capsys.disabled():
        print()
        _, wrong, shown = _judged([(f"{k}:{s}", "in no catalogue", recorded(k, s)) for s in SEEDS for k in STRANGERS])
    assert wrong <= 0.1 * shown


def test_what_swings_in_basilisk_and_mujoco(capsys) -> None:
    """Panels, slosh and sliding masses. Basilisk's seeds 1 and 2 and MuJoCo's 1 to 7 served while the effect was built."""
    pytest.importorskip("Basilisk")
    pytest.importorskip("mujoco")
    from diagnosis.basilisk_worlds import SWINGING, recorded
    from diagnosis.pair_worlds import slid

    name = "spring-mass-damper"
    records = [(f"{k}:{s}", name, recorded(k, s)) for s in SEEDS for k in SWINGING]
    records += [(f"sliding:{s}", name, slid(s)[0]) for s in SEEDS]
    with capsys.disabled():
        print()
        right, wrong, shown = _judged(records)
    assert right >= 0.5 * shown and wrong <= 0.1 * shown


def test_bodies_moved_by_mujoco(capsys) -> None:
    pytest.importorskip("mujoco")
    from diagnosis.mujoco_worlds import BODIES, recorded, right

    with capsys.disabled():
        print()
        worlds = [(f"{name}:{s}", right(name, s), recorded(name, s)[0]) for s in SEEDS for name in BODIES]
        found = _judged(worlds)
    good, wrong, shown = found
    assert good >= 0.9 * shown and wrong <= 0.1 * shown
