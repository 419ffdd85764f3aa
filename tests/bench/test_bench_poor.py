"""What is said of tumbling bodies filmed badly: never a wrong answer outside its interval, never an internal error.

Prints a row for each kind and body. `MASSPROPS_BENCH_OUT` keeps footage and runs, and they are used again. Seeds 0
and 1 show nearly all of the body and served to develop on; `MASSPROPS_POOR_SEED` films others. One run takes about a minute of CPU.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from bench_footage import place
from poor_footage import KINDS, film

import massprops
from massprops.mass.properties import MassProperties

pytestmark = pytest.mark.bench

SEED = int(os.environ.get("MASSPROPS_POOR_SEED", "0"))
BODIES = (("asteroid", SEED), ("spacecraft", SEED + 1))
HEAD = "| footage | body | placed | volume | half width | k1, k2 | outside its interval | confidence, because |\n|---|---|---|---|---|---|---|---|"


def row(name: str, scenario: str, seed: int, folder: Path) -> tuple[str, str]:
    """One line of the table, and what is wrong with the answer."""
    filmed = film(name, scenario, seed, folder)
    run = massprops.reconstruct(filmed.video, folder / "run", scale=filmed.length, threads=1)
    if not (run.folder / "massprops.json").is_file():
        return f"| {name} | {scenario} | no answer: {run.reason} | | | | | |", "" if run.reason else "no reason given"
    document, truth = run.properties, filmed.body
    out = missed(document, truth)
    if document.get("recommended"):
        out += [f"recommended {q}" for q in missed(document["recommended"], truth)]
    low, high = document["interval_90"]["volume"]
    k1, k2 = (document["inertia_ratios"][k] - getattr(truth, k) for k in ("k1", "k2"))
    seen, confidence = document["images"], document["confidence"]
    line = (
        f"| {name} | {scenario} | {seen['registered']} of {seen['given']} "
        f"| {100 * (document['volume'] / truth.volume - 1):+.1f} % | {50 * (high - low) / document['volume']:.0f} % "
        f"| {k1:+.3f}, {k2:+.3f} | {', '.join(out) or 'none'} | {confidence['level']}: {'; '.join(confidence['because'])} |"
    )
    return line, ", ".join(out)


def missed(stated: dict[str, Any], truth: MassProperties) -> list[str]:
    """Quantities of the body that lie outside their 90 % intervals."""
    bounds = stated["interval_90"]
    pairs = [("volume", bounds["volume"], truth.volume), ("k1", bounds["k1"], truth.k1), ("k2", bounds["k2"], truth.k2)]
    pairs += [(f"I{i + 1}", bounds["principal_moments"][i], truth.principal_moments[i]) for i in range(3)]
    return [name for name, (low, high), true in pairs if not low <= true <= high]


@pytest.mark.parametrize("scenario", BODIES, ids=[b for b, _ in BODIES])
@pytest.mark.parametrize("name", KINDS)
def test_poor_footage(name: str, scenario: tuple[str, int], tmp_path: Path) -> None:
    body, seed = scenario
    folder = place(tmp_path, f"poor-{body}-{seed}-{name.replace(' ', '-').replace(chr(39), '')}")
    line, wrong = row(name, body, seed, folder)
    print(f"\n{HEAD}\n{line}" if name == next(iter(KINDS)) else f"\n{line}")
    assert not wrong, f"{line}\n{wrong}"
