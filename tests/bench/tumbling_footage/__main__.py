"""Works with the footage of tumbling bodies from the shell, in the project's folder:

    PYTHONPATH=tests/bench .venv/bin/python -m tumbling_footage render cubesat 0 2       two bodies (88 frames each)
    PYTHONPATH=tests/bench .venv/bin/python -m tumbling_footage render foil 0 --poor eclipse
    PYTHONPATH=tests/bench .venv/bin/python -m tumbling_footage judge cubesat_00_dev     runs the tool, keeps the run, prints
    PYTHONPATH=tests/bench .venv/bin/python -m tumbling_footage list                     what is rendered

Kinds: `bodies.KINDS`. Bodies with odd numbers are held out. Folders as those of the table-top scenes.
"""

from __future__ import annotations

import argparse
from functools import partial

from tabletop.places import bench_data, kept_run
from tabletop.rendering import Job, render_all
from tabletop.run_scene import run_scene
from tabletop.table import HEAD, line
from tabletop.truth import scene_folders

from tumbling_footage.bodies import KINDS
from tumbling_footage.footage import SENSORS, Footage, develop, prepare
from tumbling_footage.poor import POOR


def main() -> None:
    """Reads the command line."""
    parser = argparse.ArgumentParser(prog="tumbling", description=__doc__.splitlines()[0])
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("list", help="finished footage")
    render = verbs.add_parser("render", help="render bodies that are missing")
    render.add_argument("kind", choices=list(KINDS))
    render.add_argument("numbers", nargs="+", type=int)
    render.add_argument("--poor", choices=[name for name in POOR if name], default="")
    render.add_argument(
        "--sensors", choices=SENSORS, default="", help="a sequence folder with attitudes or a second camera"
    )
    render.add_argument("--frames", type=int, default=88, help="of a new body; the same motion, shown shorter")
    judge = verbs.add_parser("judge", help="run the tool on bodies and judge it")
    judge.add_argument("names", nargs="+")
    judge.add_argument("--held-out", action="store_true", help="allow the bodies that are kept for the end")
    chosen = parser.parse_args()
    root = bench_data() / "tumbling"
    there = {p.name: p for p in scene_folders(root)}
    if chosen.verb == "list":
        print("\n".join(sorted(there)))
    elif chosen.verb == "render":
        how = {"poor": chosen.poor, "sensors": chosen.sensors, "frames": chosen.frames}
        wanted = [Footage(kind=chosen.kind, number=n, **how) for n in chosen.numbers]
        jobs = [Job(name=f.name, prepare=partial(prepare, f), develop=partial(develop, f)) for f in wanted]
        render_all(jobs, root)
    else:
        if missing := [n for n in chosen.names if n not in there]:
            parser.error(f"no finished footage {', '.join(missing)}; there are: {', '.join(sorted(there))}")
        if not chosen.held_out and (kept := [n for n in chosen.names if "_held" in n]):
            parser.error(f"{', '.join(kept)}: held out, not run before the end (--held-out)")
        print(HEAD)
        for name in chosen.names:
            print(line(name, run_scene(there[name], kept_run(f"tumbling-{name}"))), flush=True)


if __name__ == "__main__":
    main()
