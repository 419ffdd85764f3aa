"""Where something is missing: a network, a place to write, memory."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh
import yaml

HOUSE = Path(__file__).parents[2]
MASSPROPS = [sys.executable, "-P", "-c", "from massprops_cli.main import main; main()"]


def confined(how: str, inner: str, *command: object, **more: object) -> subprocess.CompletedProcess[str]:
    """A command in name spaces of its own, after `inner`; without them the test is skipped."""
    unshare = shutil.which("unshare")
    if unshare is None or subprocess.run([unshare, how, "true"], capture_output=True, check=False).returncode:
        pytest.skip("no user name spaces here")
    whole = [unshare, how, "sh", "-c", f'{inner} exec "$@"', "sh", *map(str, command)]
    return subprocess.run(whole, capture_output=True, text=True, timeout=300, check=False, **more)  # type: ignore[call-overload]


def test_commands_need_no_network(tmp_path: Path) -> None:
    """There is not even a loopback device that is up."""
    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / "box.stl")
    (tmp_path / "study.yaml").write_text(yaml.safe_dump({"kind": "drill", "runs": 4, "chunk": 2}))
    code = "import socket; socket.create_connection(('127.0.0.1', 9))"
    assert "unreachable" in confined("-rn", "", sys.executable, "-c", code).stderr
    for arguments in (
        ("mass", "box.stl", "-o", "run", "--density", "1000"),
        ("export", "run", "--to", "urdf"),
        ("simulate", "tracks", "-o", "seq", "--features", "6", "--frames", "30", "-q"),
        ("estimate", "seq", "-o", "seq-e", "--method", "ekf", "-q"),
        ("campaign", "study.yaml", "-o", "study", "--workers", "1", "-q"),
    ):
        done = confined("-rn", "", *MASSPROPS, *arguments, cwd=tmp_path)
        assert done.returncode in (0, 3 * (arguments[0] == "estimate")), (arguments, done.stderr)
        assert "Traceback" not in done.stderr and "unexpected" not in done.stderr, done.stderr
    assert (tmp_path / "run/report.html").is_file() and (tmp_path / "seq-e/estimates.json").is_file()
    assert (tmp_path / "study/table.json").is_file()


def test_compiled_code_is_kept_where_package_and_home_are_read_only(tmp_path: Path) -> None:
    """numba itself, on a copy of the module that prepares its place: both disks refuse, as those of a container do."""
    package, home, free = (tmp_path / name for name in ("package", "home", "free"))
    for folder in (package, home, free):
        folder.mkdir()
    for name in ("__init__", "native", "errors"):
        (package / f"{name}.py").write_text(
            (HOUSE / "massprops" / f"{name}.py").read_text() if name != "__init__" else ""
        )
    (package / "compiled.py").write_text("from numba import njit\n@njit(cache=True)\ndef twice(x):\n    return 2 * x\n")
    code = (
        "import sys, importlib; sys.path.insert(0, sys.argv[1])\n"
        "from package.native import prepare_numba_cache\n"
        "prepare_numba_cache()\n"
        "from package.compiled import twice\n"
        "print(twice(3.0))\n"
    )
    environment = {**os.environ, "HOME": str(home), "TMPDIR": str(free)}
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        environment.pop(name, None)
    read_only = "".join(f'mount --bind "{p}" "{p}" && mount -o remount,bind,ro "{p}" && ' for p in (package, home))
    done = confined("-rm", read_only, sys.executable, "-c", code, tmp_path, env=environment)
    assert (done.returncode, done.stdout) == (0, "6.0\n"), done.stderr
    assert list(free.glob("massprops-numba-*/**/*.nbi"))
