"""A write that fails, or a process that dies, anywhere in a campaign: the same command gives the same table."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

from massprops.campaigns import run as campaign
from massprops.campaigns.configuration import plan_of
from massprops.campaigns.kinds import load_kind
from massprops.errors import InputError, NotPossible

sys.path.insert(0, str(Path(__file__).parents[1] / "core"))
from faults import KINDS, failing, quick_disk  # noqa: E402

PLAN = plan_of({"kind": "drill", "runs": 4, "chunk": 2, "fails": 0.3})


class Here:
    """A backend in this process."""

    place, strict, ahead = "here", False, 1

    def __init__(self) -> None:
        self.done: list[tuple[Any, list[Any]]] = []

    def slots(self) -> int:
        return 1

    def submit(self, key: Any, tasks: list[dict[str, Any]]) -> None:
        spent = {"error": None, "wall_s": 0.0, "cpu_s": 0.0, "versions": None}
        replies = []
        for task in tasks:
            made = load_kind("drill").runs(task["parameters"] | {"fails": 0.0}, task["seeds"], None)
            rows = [{"seed": s, "data": d, **spent} for s, d in zip(task["seeds"], made, strict=True)]
            replies.append({"rows": rows, "worker": "here"})
        self.done.append((key, replies))

    def wait(self, seconds: float) -> list[tuple[Any, list[Any]]]:
        found, self.done = self.done, []
        return found

    def close(self) -> None:
        pass


def shown(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in ("table.json", "runs.csv", "campaign.yaml")}


def test_a_fault_anywhere_costs_nothing_but_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign, "backend_of", lambda *_: Here())
    with quick_disk(tmp_path) as place:
        with failing() as disk:
            campaign.run_campaign(PLAN, place / "whole")
        whole = shown(place / "whole")
        assert disk.count > 15
        for n in range(1, disk.count + 1):
            for kind in KINDS:
                out = place / "out"
                with failing(n, kind):
                    try:
                        campaign.run_campaign(PLAN, out)
                    except (InputError, NotPossible) as error:
                        assert "\n" not in str(error)
                campaign.run_campaign(PLAN, out)
                assert shown(out) == whole, (n, kind)
                shutil.rmtree(out)
