"""Works with the table-top scenes from the shell, in the project's folder:

    PYTHONPATH=tests/bench .venv/bin/python -m tabletop judge sugar            runs the tool, keeps the run, prints
    PYTHONPATH=tests/bench .venv/bin/python -m tabletop judge sugar --fresh    forgets the kept run first
    PYTHONPATH=tests/bench .venv/bin/python -m tabletop judge --run RUN sugar  judges a finished run folder
    PYTHONPATH=tests/bench .venv/bin/python -m tabletop list                   the scenes that are there

Runs are kept under `bench-out/tabletop/`.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from tabletop.judge import judge_run
from tabletop.places import SHARED, kept_run, rendered
from tabletop.run_scene import run_scene
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
    judge = verbs.add_parser("judge", help="run the tool on scenes and judge it")
    judge.add_argument("names", nargs="+")
    judge.add_argument("--fresh", action="store_true", help="forget the kept run first")
    judge.add_argument("--run", type=Path, help="judge this finished run instead of running the tool")
    chosen = parser.parse_args()
    there = scenes()
    if chosen.verb == "list":
        print("\n".join(sorted(there)))
        return
    if missing := [n for n in chosen.names if n not in there]:
        parser.error(f"no finished scene {', '.join(missing)}; there are: {', '.join(sorted(there))}")
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
