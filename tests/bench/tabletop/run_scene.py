"""Runs the command on one scene, as a user would, and judges it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from tabletop.judge import Judgement, judge_run
from tabletop.truth import read_scene_truth, scene_input


def run_scene(folder: Path, run: Path, options: tuple[str, ...] = ()) -> Judgement:
    """`massprops reconstruct` on the images of a scene, in `run`; what it prints goes to `RUN.log`.

    Args:
        folder: of the scene.
        run: the run folder. A finished one is not computed again, and then the CPU time is near zero.
        options: of the command; none in the benchmark.
    """
    run.parent.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "massprops_cli.main", "reconstruct", str(scene_input(folder)), "-o", str(run)]
    with (run.parent / f"{run.name}.log").open("w") as log:
        child = subprocess.Popen([*command, *options], stdout=log, stderr=log)
        _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    truth = read_scene_truth(folder)
    return judge_run(run, truth, child.returncode, usage.ru_utime + usage.ru_stime)
