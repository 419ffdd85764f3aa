"""Test runs that take time, fail, hang, use memory or die on request, to try out a cluster before real work."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np

from massprops.campaigns.kinds import always
from massprops.documents.loading import excerpt
from massprops.errors import InputError

SENTENCE = "Practice runs that cost, fail, hang, grow or die on demand."
OWN_THREADS = False
DEFAULTS: dict[str, Any] = {
    "draws": 100,  # random numbers per run
    "sigma": 1.0,  # of each
    "cost_ms": 0.0,  # processor time per run
    "fails": 0.0,  # share of runs that raise
    "hangs": 0.0,  # share that never end
    "grows": 0.0,  # share that take memory without end
    "dies": 0.0,  # share that kill their process
    "gate": None,  # file that every run waits for
}
RANGES = {"draws": (1, 10**7), "sigma": (0.0, 1e9), "cost_ms": (0.0, 1e7)}
BLOCK = 16 * 2**20


def prepared(
    fixed: dict[str, Any], grid: dict[str, Any], folder: Path, where: str
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The gate's path made absolute."""
    if fixed.get("gate") is not None:
        fixed = {**fixed, "gate": str(folder / str(fixed["gate"]))}
    return fixed, grid


def parameters(fixed: dict[str, Any], grid: dict[str, Any]) -> list[str]:
    """Names that may be set."""
    return list(DEFAULTS)


def check(values: dict[str, Any], where: str) -> None:
    """Refuses numbers out of range."""
    for name, value in values.items():
        if name == "gate":
            continue
        low, high = RANGES.get(name, (0.0, 1.0))
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise InputError(f"{where}: {name} {excerpt(value)}: give a number from {low:g} to {high:g}")


default_runs = always(100)
chunk = always(10)
basis = always(None)


def runs(values: dict[str, Any], seeds: list[int], folder: Path | None) -> list[dict[str, Any]]:
    """Mean and greatest of random numbers per seed."""
    return [_run({**DEFAULTS, **values}, seed) for seed in seeds]


def _run(values: dict[str, Any], seed: int) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    fate = rng.random()
    for what in ("fails", "hangs", "grows", "dies"):
        if fate < values[what]:
            _misbehave(what, seed)
        fate -= values[what]
    while values["gate"] is not None and not Path(values["gate"]).exists():
        time.sleep(0.005)
    end = time.process_time() + 1e-3 * values["cost_ms"]
    while time.process_time() < end:
        pass
    numbers = values["sigma"] * rng.standard_normal(int(values["draws"]))
    return {"mean": float(numbers.mean()), "greatest": float(np.abs(numbers).max())}


def _misbehave(what: str, seed: int) -> None:
    if what == "fails":
        raise ValueError(f"run {seed} was asked to fail")
    if what == "dies":
        os.kill(os.getpid(), signal.SIGKILL)
    taken = []
    while True:
        if what == "grows":
            taken.append(np.ones(BLOCK // 8))
        time.sleep(0.01)


tables = always([])
boxes = always(None)
