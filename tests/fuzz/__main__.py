"""`python -m tests.fuzz`: many mutated inputs for every target; what is found goes into the corpus.

Says for each target how many inputs were tried and each kind of finding once, with the file that shows it.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import tempfile
import time
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from .mutations import mutated
from .oracle import fault
from .targets import fresh, restore, targets

CORPUS = Path(__file__).parent / "corpus"
LARGEST = 20_000
PART = 200
"""Inputs between two looks at the clock."""


def corpus(target: str) -> dict[str, list[bytes]]:
    """Files kept for a target, by the name under which they are read."""
    found: dict[str, list[bytes]] = {}
    for path in sorted((CORPUS / target).glob("*")):
        found.setdefault(path.name.split("~", 1)[1].replace("__", "/"), []).append(path.read_bytes())
    return found


def keep(target: str, name: str, data: bytes) -> Path | None:
    """Puts a small file that showed something into the corpus."""
    if len(data) > LARGEST:
        return None
    path = CORPUS / target / f"{hashlib.sha256(data).hexdigest()[:10]}~{name.replace('/', '__')}"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def fuzz(name: str, count: int, start: int, limit_s: float) -> tuple[int, dict[str, Path | None]]:
    """Inputs tried and findings, each kind with one file."""
    target = targets()[name]()
    seeds = {n: [*given_, *corpus(name).get(n, [])] for n, given_ in target.seeds.items()}
    found: dict[str, Path | None] = {}
    tried, part = 0, 0
    end = time.monotonic() + limit_s
    with tempfile.TemporaryDirectory(prefix="massprops-fuzz-") as place:
        folder = Path(place) / "f"

        def one(data: st.DataObject) -> None:
            nonlocal tried
            file = data.draw(st.sampled_from(sorted(seeds)))
            content = data.draw(mutated(seeds[file]))
            tried += 1
            wrong = fault(target, folder, file, content)
            restore(target, folder, file)
            if wrong and kind_of(wrong) not in map(kind_of, found):
                found[wrong] = keep(name, file, content)
                print(f"  {name}: {wrong}: {found[wrong]}", flush=True)

        while tried < count and time.monotonic() < end:
            fresh(target, folder)
            several = settings(max_examples=min(PART, count - tried), deadline=None, database=None,
                               phases=[Phase.generate], suppress_health_check=list(HealthCheck))  # fmt: skip
            seed(1000 * start + part)(several(given(st.data())(one)))()
            part += 1
    return tried, found


def kind_of(wrong: str) -> str:
    """A finding without what differs from input to input."""
    return wrong.split(" (")[0]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=20_000, help="for all targets together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=60.0, help="for all targets together, at most")
    parser.add_argument("target", nargs="*", default=[])
    asked = parser.parse_args()
    names = asked.target or list(targets())
    total = wrong = 0
    for name in names:
        tried, found = fuzz(name, asked.inputs // len(names), asked.seed, 60 * asked.minutes / len(names))
        print(f"{name}: {tried} inputs, {len(found)} findings", flush=True)
        total, wrong = total + tried, wrong + len(found)
    print(f"all: {total} inputs, {wrong} findings")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
