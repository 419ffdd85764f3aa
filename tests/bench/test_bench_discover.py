"""Hidden laws outside the catalogue, moved by MuJoCo: which terms `--discover` finds, and what it predicts.

Seeds 0 to 9 and 200 to 259 served while it was made, 300 to 425 have been looked at since. A law that a free body follows within
the noise is not counted. Counted apart: right but for terms that are equal along the record, which the law lists, and wrong with
the hidden law among the rivals that it lists. MASSPROPS_LAW_SEEDS=300,359 runs others.
"""

from __future__ import annotations

import os
import re
from typing import Any

import pytest
from bench.hidden_laws import STEP_S, HiddenLaw, draw

from massprops.diagnosis.discovery.law import document_of_law
from massprops.diagnosis.discovery.sequence_law import law_of_sequence
from massprops.diagnosis.sequence_record import record_of_sequence
from massprops.diagnosis.unnamed import without_effects

pytestmark = pytest.mark.bench

FIRST, LAST = (int(s) for s in os.environ.get("MASSPROPS_LAW_SEEDS", "300,359").split(","))


def _right(found: set[str], hidden: HiddenLaw) -> bool:
    """Whether the terms are those that act and no others; a moment may be off by a part of the steps' spacing."""
    plain = {re.sub(r"\(t>[^ ]*", "(t>", label) for label in found}
    moments = [float(m) for label in found for m in re.findall(r"\(t>([0-9.e+]+)\)", label)]
    near = all(min(abs(m - t) for t in hidden.moments) < 5 * STEP_S for m in moments if hidden.moments)
    return plain == hidden.labels and near and len(found) == sum(len(t.axes) for t in hidden.terms)


def _judged(law: dict[str, Any], hidden: HiddenLaw) -> str:
    """right, same (but for terms equal along the record), rival (wrong, with the hidden law listed beside), or WRONG."""
    if _right({t["term"] for t in law["terms"]}, hidden):
        return "right"
    if _right({next((s for s in t["same_here"] if s in hidden.labels), t["term"]) for t in law["terms"]}, hidden):
        return "same"
    return "rival" if any(_right(set(r["terms"]), hidden) for r in law.get("rivals", [])) else "WRONG"


def test_hidden_laws() -> None:
    found_as = {"right": 0, "same": 0, "rival": 0, "WRONG": 0}
    predicted = surely_wrong = shown = 0
    for seed in range(FIRST, LAST + 1):
        hidden = draw(seed)
        law = document_of_law(law_of_sequence(hidden.sequence))
        found = {t["term"] for t in law["terms"]}
        if not found:
            record = record_of_sequence(hidden.sequence)
            base, unknown = without_effects(record)
            if base is unknown:
                print(f"\n{seed:4} does not show: {sorted(hidden.labels)}")
                continue
        shown += 1
        judged = _judged(law, hidden)
        good = judged in ("right", "same")
        held = law["held_out"]["after"] if found else float("nan")
        sure = bool(found) and min(t["probability"] for t in law["terms"]) > 0.9
        found_as[judged] += 1
        predicted += held <= 1.1
        surely_wrong += sure and not good and law["stated"]
        gap = law["fitted"] if found else {}
        print(f"\n{seed:4} {judged} held out {held:.2f} {gap} {law['stated']} {law['because']}")
        print(f"     hidden {sorted(hidden.labels)} {hidden.moments}\n     found  {law['formula']}")
        print("     " + ", ".join(f"{t['term']}: {t['probability']:.2f}" for t in law["terms"]))
    print(f"\n{found_as}, held out at most 1.1 {predicted}, surely wrong {surely_wrong} of {shown}")
    assert found_as["right"] >= 0.8 * shown and predicted >= 0.9 * shown and surely_wrong <= 0.02 * shown
