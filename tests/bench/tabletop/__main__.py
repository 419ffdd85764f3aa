"""Works with the table-top scenes from the shell, in the project's folder:

    PYTHONPATH=tests/bench .venv/bin/python -m tabletop judge sugar            runs the tool, keeps the run, prints
    PYTHONPATH=tests/bench .venv/bin/python -m tabletop judge sugar --fresh    forgets the kept run first
    PYTHONPATH=tests/bench .venv/bin/python -m tabletop judge --run RUN sugar  judges a finished run folder
    PYTHONPATH=tests/bench .venv/bin/python -m tabletop list                   the scenes that are there
    PYTHONPATH=tests/bench .venv/bin/python -m tabletop check                  that scenes are whole, without a look
    PYTHONPATH=tests/bench .venv/bin/python -m tabletop render [NAME ...]      renders what is missing (hours)
    PYTHONPATH=tests/bench .venv/bin/python -m tabletop render 08_dev_shoe-2   renders that kind of scene, drawn anew

Runs are kept under `bench-out/tabletop/`, scenes under `bench-out/data/` or `MASSPROPS_BENCH_DATA`. Rendering needs a
second environment, see `requirements.txt` here. Held-out scenes (`scenes.py`) are judged only with `--held-out`.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from tabletop.check import check
from tabletop.judge import judge_run
from tabletop.places import SHARED, kept_run, rendered
from tabletop.rendering import render_all, scene_job
from tabletop.run_scene import run_scene
from tabletop.scenes import SCENES, by_name, render_order
from tabletop.table import HEAD, line
from tabletop.truth import read_scene_truth, scene_folders


def scenes() -> dict[str, Path]:
    """Folder of every finished scene by name."""
    return {p.name: p for root in (SHARED / "tabletop", rendered()) for p in scene_folders(root)}


def main() -> None:
    """Reads the command line."""
    parser = argparse.ArgumentParser(prog="tabletop", description=__doc__.splitlines()[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("list", help="finished scenes")
    verbs.add_parser("check", help="images and truth of our scenes are whole, the object is in the frame")
    render = verbs.add_parser("render", help="render our scenes that are missing")
    render.add_argument("names", nargs="*", help="all of them by default")
    judge = verbs.add_parser("judge", help="run the tool on scenes and judge it")
    judge.add_argument("names", nargs="+")
    judge.add_argument("--fresh", action="store_true", help="forget the kept run first")
    judge.add_argument("--held-out", action="store_true", help="allow the scenes that are kept for the end")
    judge.add_argument("--run", type=Path, help="judge this finished run instead of running the tool")
    chosen = parser.parse_args()
    if chosen.verb == "list":
        print("\n".join(sorted(scenes())))
    elif chosen.verb == "check":
        for scene in SCENES:
            if (rendered() / scene.name / "truth.npz").is_file():
                print(check(scene, rendered() / scene.name))
    elif chosen.verb == "render":
        wanted = [by_name(n) for n in chosen.names] or render_order()
        render_all([scene_job(s) for s in wanted], rendered())
    else:
        judge_scenes(chosen, parser)


def judge_scenes(chosen: argparse.Namespace, parser: argparse.ArgumentParser) -> None:
    """Runs or takes the runs of the named scenes, and prints a line for each."""
    there = scenes()
    if missing := [n for n in chosen.names if n not in there]:
        parser.error(f"no finished scene {', '.join(missing)}; there are: {', '.join(sorted(there))}")
    kept = {n for n in chosen.names if n[0].isdigit() and by_name(n).held_out}
    if kept and not chosen.held_out:
        parser.error(f"{', '.join(sorted(kept))}: held out, not run before the end (--held-out)")
    print(HEAD)
    for name in chosen.names:
        if chosen.fresh and not chosen.run:
            shutil.rmtree(kept_run(name), ignore_errors=True)
        if chosen.run:
            found = judge_run(chosen.run, read_scene_truth(there[name]))
        else:
            found = run_scene(there[name], kept_run(name))
        print(line(name, found), flush=True)


if __name__ == "__main__":
    main()
