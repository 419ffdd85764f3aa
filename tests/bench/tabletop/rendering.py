"""Renders scenes one after the other, each by Blender in a process of its own with one thread at the lowest priority.

What is there already is kept: a finished scene, and every finished frame of an unfinished one.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from tabletop.develop import develop
from tabletop.places import PROJECT, SHARED
from tabletop.prepare import prepare
from tabletop.scenes import Scene

RENDERER = Path(__file__).with_name("render.py")


def blender() -> Path:
    """A Python that has `bpy`: `MASSPROPS_BENCH_BLENDER`, else `bench-out/blender`.

    Raises:
        FileNotFoundError: it is not there; the message says how to make it.
    """
    given = os.environ.get("MASSPROPS_BENCH_BLENDER")
    python = Path(given) if given else PROJECT / "bench-out" / "blender" / "bin" / "python"
    if not python.is_file():
        raise FileNotFoundError(f"{python}: no Python with bpy; see {Path(__file__).with_name('requirements.txt')}")
    return python


@dataclass(frozen=True, kw_only=True)
class Job:
    """Something to render: its folder's name, what writes the folder up to its frames, what makes images of these."""

    name: str
    prepare: Callable[[Path], None]
    develop: Callable[[Path], None]


def scene_job(scene: Scene) -> Job:
    """Of a table-top scene."""
    return Job(
        name=scene.name,
        prepare=lambda folder: prepare(scene, SHARED / "ycb", folder),
        develop=lambda folder: develop(scene, folder),
    )


def render_all(jobs: Iterable[Job], root: Path) -> None:
    """Renders what is not finished, in its order, and prints a line for each.

    Args:
        jobs: in the order of rendering.
        root: folder of their folders.

    Raises:
        BlockingIOError: another process renders into the same folder.
    """
    python = blender()
    root.mkdir(parents=True, exist_ok=True)
    with (root / "rendering.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        for job in jobs:
            folder = root / job.name
            if (folder / "truth.npz").is_file():
                continue
            begin = time.monotonic()
            if not (folder / "work" / "scene.json").is_file():
                job.prepare(folder)
            with (folder / "work" / "render.log").open("a") as log:
                command = ["nice", "-n", "19", str(python), str(RENDERER), str(folder / "work")]
                subprocess.run(command, stdout=log, stderr=log, check=True, env=_one_thread())
            job.develop(folder)
            shutil.rmtree(folder / "work" / "frames")
            print(f"{job.name}: rendered in {time.monotonic() - begin:.0f} s", flush=True)


def _one_thread() -> dict[str, str]:
    return {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
