"""`massprops reconstruct` with no other option on rendered table-top scenes, judged by their truth.

Prints one line a scene: the scenes of `../shared/data/tabletop`, then ours. Scenes that are not there are left out.
To run and judge one scene while developing, and to keep its run folder: see `tabletop/__main__.py`, for example

    PYTHONPATH=tests/bench .venv/bin/python -m tabletop judge sugar
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from tabletop.judge import Judgement
from tabletop.places import SHARED
from tabletop.run_scene import run_scene
from tabletop.table import summary
from tabletop.truth import scene_folders

pytestmark = pytest.mark.bench


def run_all(folders: list[Path], tmp_path: Path) -> dict[str, Judgement]:
    """Runs every scene; `MASSPROPS_BENCH_OUT` keeps the runs."""
    kept = os.environ.get("MASSPROPS_BENCH_OUT")
    place = Path(kept) / "tabletop" if kept else tmp_path
    return {folder.name: run_scene(folder, place / folder.name) for folder in folders}


def test_shared_scenes(tmp_path: Path) -> None:
    """Development scenes: the tool may refuse, but never break, and what it calls done is a closed body."""
    folders = scene_folders(SHARED / "tabletop")
    if not folders:
        pytest.skip("../shared/data/tabletop is not here")
    found = run_all(folders, tmp_path)
    print("\n".join(summary("shared scenes (development)", found)))
    assert all(j.exit_code in (0, 3) for j in found.values())
    assert all(j.closed for j in found.values() if j.exit_code == 0)
