"""`massprops doctor`: what is installed, what is missing, and what to type."""

from __future__ import annotations

import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from massprops.core.processes import processors
from massprops.native import advice, missing

LIBRARIES = {
    "numpy": "import numpy",
    "scipy": "import scipy.spatial",
    "numba": "import numba",
    "opencv": "import cv2; cv2.SIFT_create",
    "pycolmap": "import zlib, pycolmap",
    "open3d": "from massprops.native import load_open3d; load_open3d()",
    "trimesh": "import trimesh",
    "pymeshlab": "from massprops.native import mesh_set; mesh_set([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])",
    "PyMaxflow": "import maxflow",
    "PyAV": "import av; av.codec.Codec('h264', 'r')",
    "pyyaml": "import yaml",
    "rich": "import rich.progress",
}


@dataclass(frozen=True)
class Finding:
    """name; ok; detail: version or what is wrong and what to type."""

    name: str
    ok: bool
    detail: str


def examine() -> list[Finding]:
    """Every finding; each native library is tried in a process of its own, since a broken one can crash."""
    findings = [
        Finding("python", sys.version_info >= (3, 11), sys.version.split()[0]),
        Finding("processors", True, f"{processors()} usable"),
    ]
    from massprops.run.runner import versions

    known = {**versions(), "opencv": versions()["opencv-python-headless"], "PyAV": versions()["av"]}
    for name, code in LIBRARIES.items():
        done = subprocess.run(
            [sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=120, check=False
        )
        if done.returncode == 0:
            findings.append(Finding(name, True, known.get(name, "")))
        else:
            last = (done.stderr.strip().splitlines() or [f"died with code {done.returncode}"])[-1]
            last = last.removeprefix("massprops.errors.InputError: ")
            todo = _advice(name, last)
            findings.append(Finding(name, False, last if todo in last else f"{last}; {todo}"))
    free = shutil.disk_usage(Path.cwd()).free / 1e9
    findings.append(
        Finding(
            "free disk", free > 2, f"{free:.1f} GB" + ("" if free > 2 else "; a run needs up to 2 GB: free some space")
        )
    )
    memory = _memory_gb()
    if memory is not None:
        findings.append(
            Finding("free memory", memory > 2, f"{memory:.1f} GB" + ("" if memory > 2 else "; a run needs 2 GB"))
        )
    return findings


def _advice(name: str, message: str) -> str:
    if name in ("pycolmap", "PyMaxflow") and (lacks := missing(name)):
        return lacks
    return advice(message) if ".so" in message else "type: pip install --force-reinstall massprops"


def _memory_gb() -> float | None:
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable")) / 1e6
    except (OSError, StopIteration, ValueError):
        return None
