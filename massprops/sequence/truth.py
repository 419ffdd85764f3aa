"""Reads the truth of a simulated sequence: for plots, benchmarks and tests only, never for an estimator."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from massprops.documents.loading import load_yaml
from massprops.documents.tables import STATE
from massprops.sequence.table import read_table


@dataclass(frozen=True)
class Truth:
    """facts: `truth.yaml`; timestamp_ns (n,); position (n, 3) centre of mass in cam0 [m]; q (n, 4); w (n, 3)."""

    facts: dict[str, Any]
    timestamp_ns: np.ndarray
    position: np.ndarray
    q: np.ndarray
    w: np.ndarray


def read_truth(folder: str | Path) -> Truth | None:
    """The truth beside a sequence, or None when there is none."""
    folder = Path(folder) / "truth"
    if not (folder / "truth.yaml").is_file():
        return None
    facts = load_yaml(folder / "truth.yaml")
    path = folder / "state_groundtruth_estimate0" / "data.csv"
    if not path.is_file():
        return Truth(facts, np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 4)), np.zeros((0, 3)))
    table = read_table(path, STATE).columns
    values = np.column_stack([table[name] for name in STATE.names[1:]])
    return Truth(facts, table["timestamp"], values[:, :3], values[:, 3:7], values[:, 7:])
