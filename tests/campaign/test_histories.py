"""Campaigns survive what happens to a cluster: see `histories.py`."""

from __future__ import annotations

import os
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "core")]
from faults import quick_disk  # noqa: E402
from histories import FAULTS, cluster, history  # noqa: E402

pytest.importorskip("distributed")


def several(tmp_path: Path, numbers: range) -> Counter[str]:
    struck: Counter[str] = Counter()
    wholes: dict[str, Any] = {}
    with quick_disk(tmp_path) as place, cluster(place) as made:
        for number in numbers:
            struck += history(number, made, place, wholes)
    return struck


def test_six_histories_of_faults(tmp_path: Path) -> None:
    assert sum(several(tmp_path, range(6)).values()) >= 3


@pytest.mark.bench
def test_a_thousand_histories_of_faults(tmp_path: Path) -> None:
    """`HISTORIES=FIRST:LAST` makes a part of them."""
    first, last = map(int, os.environ.get("HISTORIES", "0:1000").split(":"))
    struck = several(tmp_path, range(first, last))
    print(f"histories {first} to {last - 1}: " + ", ".join(f"{f} {struck[f]}" for f in FAULTS), flush=True)
    assert all(struck[f] for f in FAULTS)
