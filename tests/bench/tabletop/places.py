"""Where the rendered scenes and the kept runs lie."""

from __future__ import annotations

import os
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[3]
SHARED = PROJECT.parent / "shared" / "data"
"""Real data and the eight scenes that are not ours."""


def bench_data() -> Path:
    """Folder of rendered footage: `MASSPROPS_BENCH_DATA`, else `bench-out/data` of the project."""
    given = os.environ.get("MASSPROPS_BENCH_DATA")
    return Path(given) if given else PROJECT / "bench-out" / "data"


def rendered() -> Path:
    """Folder of our table-top scenes, one folder each."""
    return bench_data() / "tabletop"


def kept_run(name: str) -> Path:
    """Run folder of a scene that is kept between calls."""
    return PROJECT / "bench-out" / "tabletop" / name
