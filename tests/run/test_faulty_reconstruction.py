"""A whole small reconstruction, from an empty folder to its report, on a disk that fails at one of its changes.

`make bench` takes some of the changes, `EVERY=1` all: some 600 where the camera positions are given.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import yaml

from massprops.run.stages import ORDER

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "core")]
from faults import quick_disk  # noqa: E402
from shim import Faulty  # noqa: E402
from test_faulty_disk import KINDS, of_run, one_fault  # noqa: E402
from warm import Warm  # noqa: E402

STAGES = tuple(os.environ.get("STAGES", " ".join(ORDER)).split())
"""Whose changes fail."""
EVERY = os.environ.get("EVERY", "")
"""`1`: every change fails, in one way after the other. Else those of each sort (verb and kind of file) that come first, in
the middle and last."""
WAYS = int(os.environ.get("WAYS", "1"))
"""In which each of them fails."""
SEED = int(os.environ.get("SEED", "16"))
"""Chooses which way comes first."""


@pytest.fixture(scope="module")
def footage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every stage runs on it."""
    from massprops.simulation import simulate

    out = tmp_path_factory.mktemp("footage") / "seq"
    return simulate("asteroid", out, frames=10, size=(200, 150), rate_deg=8.0, seed=1) / "cam0" / "data"


@dataclass
class Run:
    """A reconstruction in `out`, of which every stage but the one in question is known from `base`."""

    warm: Warm
    base: Path
    out: Path
    command: list[str]
    loose: dict[str, list[str]] = field(default_factory=dict)

    def begins(self) -> Iterator[tuple[str, Path, int]]:
        """Each stage, the folder as it is when the stage begins, and how many changes there are until the next one does."""
        place = self.base.with_name("begins")
        for number, stage in enumerate(ORDER):
            self.place(place)
            self.warm.real = (stage,)
            self.warm(self.out, self.command)
            changes = self.warm.changes(self.out)
            following = f"work/.{ORDER[number + 1]}.request.json" if number + 1 < len(ORDER) else None
            end = next((n for n, _, path in changes if following and path.startswith(following)), changes[-1][0] + 1)
            yield stage, place, end - 1
            if following:
                self.place(place)
                self.warm(self.out, self.command, end, "kill")
                self.loose[ORDER[number + 1]] = sorted({*self.loose.get(stage, []), *self.warm.loose(self.out)})
                shutil.rmtree(place, ignore_errors=True)
                shutil.copytree(self.out, place)

    def place(self, begin: Path) -> None:
        shutil.rmtree(self.out, ignore_errors=True)
        if begin.exists():
            shutil.copytree(begin, self.out)


def sort_of(verb: str, path: str, stage: str) -> tuple[str, str]:
    """Changes of one sort are of one verb and of one kind of file; the runner's own files are alike in all stages."""
    name = re.sub(r"\d+", "#", re.sub(r"[0-9a-f]{24,}", "HEX", re.sub(rf"\b{stage}\b", "STAGE", path)))
    return verb, re.sub(r"(previous/)\S+", r"\1...", name)


def chosen(changes: list[tuple[int, str, str]], stage: str, rng: np.random.Generator) -> list[tuple[int, str]]:
    """Changes that fail, and how."""
    sorts: dict[tuple[str, str], list[int]] = {}
    for n, verb, path in changes:
        sorts.setdefault(sort_of(verb, path, stage), []).append(n)
    some = {n for numbers in sorts.values() for n in (numbers[0], numbers[len(numbers) // 2], numbers[-1])}
    turn = int(rng.integers(len(KINDS)))
    found = []
    for n, _, _ in changes:
        if EVERY == "1" or n in some:
            turn += 1
            found += [(n, KINDS[(turn + way) % len(KINDS)]) for way in range(WAYS)]
    return found


@pytest.mark.bench
@pytest.mark.parametrize("poses", ["given", "computed"])
def test_every_change_of_a_reconstruction(tmp_path: Path, footage: Path, poses: str) -> None:
    """With camera positions from `--sparse` all stages; where they are computed sfm, whose changes are a database's.

    A power cut takes what the stage left loose, every second time what the stages before it did, too. Where a fault left
    the folder as an earlier one had left it, but for what the next run removes unread, that run is not done again.
    """
    with quick_disk(tmp_path) as place:
        base, out, rng = place / "base" / "out", place / "out", np.random.default_rng(SEED)
        command = ["reconstruct", str(footage), "-q", "--scale", "1", "--threads", "1"]
        with Warm(tmp_path / "shim", [*command, "-o", str(base)]) as warm:
            if poses == "given":
                shutil.move(base / "sparse", tmp_path / "sparse")
                shutil.rmtree(base)
                command += ["--sparse", str(tmp_path / "sparse")]
            code, whole = warm(base, [*command, "-o", str(base)]).returncode, of_run(base)
            entries = yaml.load((base / "run.yaml").read_text(), Loader=yaml.CSafeLoader)["stages"]
            assert set(entries) == set(ORDER)
            (base / "entries.json").write_text(json.dumps(entries))
            warm.known = base
            run = Run(warm, base, out, [*command, "-o", str(out)])
            assert Faulty(tmp_path / "cold")(out, run.command).returncode == code
            assert of_run(out) == whole, "stages that are forked give other results"
            wrong: list[str] = []
            seen = 0
            for stage, begin, end in run.begins():
                changes = [change for change in warm.changes(out) if change[0] <= end]
                assert of_run(out) == whole, stage
                faults = chosen(changes, stage, rng) if stage in (STAGES if poses == "given" else ("sfm",)) else []
                known: set[str] = set()
                for k, (n, kind) in enumerate(faults):
                    run.place(begin)
                    earlier = run.loose.get(stage, []) if k // len(KINDS) % 2 else []
                    again = True
                    try:
                        again = one_fault(warm, out, run.command, n, kind, whole, of_run, code, earlier, known)
                    except AssertionError as error:
                        wrong.append(f"{stage}: {error}")
                    how = "" if again else ", as before"
                    print(f"{stage}: change {n} of {end}, {kind}{how}", *wrong[seen:], flush=True)
                    seen = len(wrong)
                ways = Counter(kind for _, kind in faults)
                print(f"{stage}: {end} changes, {len({n for n, _ in faults})} of them failed, {dict(ways)}", flush=True)
        assert not wrong, wrong
