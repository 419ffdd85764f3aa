"""`massprops reconstruct` with no other option on rendered table-top scenes, judged by their truth.

Prints one line a scene: the scenes of `../shared/data/tabletop`, then ours, development and held-out apart. Scenes that
are not there are left out. `MASSPROPS_BENCH_HELD_OUT=1` runs the held-out half, which is for the end.
To run and judge one scene while developing, and to keep its run folder: see `tabletop/__main__.py`, for example

    PYTHONPATH=tests/bench .venv/bin/python -m tabletop judge sugar
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from tabletop.judge import Judgement
from tabletop.places import SHARED, rendered
from tabletop.run_scene import run_scene
from tabletop.scenes import SCENES
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


def test_development_scenes(tmp_path: Path) -> None:
    """As the shared ones."""
    found = run_all([rendered() / s.name for s in SCENES if not s.held_out and is_there(rendered() / s.name)], tmp_path)
    if not found:
        pytest.skip("no scene is rendered: see tests/bench/tabletop/__main__.py")
    print("\n".join(summary("our scenes, development", found)))
    assert all(j.exit_code in (0, 3) for j in found.values())
    assert all(j.closed for j in found.values() if j.exit_code == 0)


def test_held_out_scenes(tmp_path: Path) -> None:
    """What the tool must reach on scenes that nobody looked at."""
    scenes = [s for s in SCENES if s.held_out]
    if os.environ.get("MASSPROPS_BENCH_HELD_OUT") != "1":
        pytest.skip("held-out scenes run with MASSPROPS_BENCH_HELD_OUT=1, at the end")
    if not all(is_there(rendered() / s.name) for s in scenes):
        pytest.skip("not all held-out scenes are rendered")
    found = run_all([rendered() / s.name for s in scenes], tmp_path)
    print("\n".join(summary("our scenes, held out", found)))
    alone = [j for j in found.values() if is_alone(j)]
    once = [abs(found[s.name].volume) for s in scenes if not s.turned and is_alone(found[s.name])]
    turned = [found[s.name] for s in scenes if s.turned and is_alone(found[s.name])]
    assert len(alone) >= 11
    assert np.median([j.iou_median for j in alone]) >= 0.97
    assert np.median(once) <= 0.03 and max(once) <= 0.06
    assert max(abs(j.volume) for j in turned) <= 0.015
    assert max(np.abs(j.shape).max() for j in turned) <= 0.03
    assert sum(j.holds.get("volume", False) for j in found.values()) >= 10
    assert np.median([j.half_width for j in alone]) <= 0.08


def is_there(folder: Path) -> bool:
    """The scene is finished."""
    return (folder / "truth.npz").is_file()


def is_alone(judged: Judgement) -> bool:
    """A closed body without anything else: no part is farther from the CAD than a twentieth of its length."""
    return judged.closed and judged.strays < 0.05
