"""Processes: what native code prints stays off the terminal."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from pathlib import Path

import pytest

from massprops.core.processes import captured_output, memory_there_is, silenced_stderr


def test_what_native_code_prints_is_kept_away_while_it_lasts(capfd: pytest.CaptureFixture[str]) -> None:
    with silenced_stderr(), silenced_stderr():
        os.write(2, b"Corrupt JPEG data\n")
    os.write(2, b"ours\n")
    assert capfd.readouterr().err == "ours\n"


def test_a_closed_standard_error_stays_closed() -> None:
    real = os.dup(2)
    os.close(2)
    try:
        with silenced_stderr():
            pass
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(2)
    finally:
        os.dup2(real, 2)
        os.close(real)


def test_a_limit_on_address_space_is_named() -> None:
    code = "from massprops.core.processes import address_space_hint; print(address_space_hint())"
    for limit, says in ((1_200_000, "limited to 1.2 GB (ulimit -v)"), ("unlimited", "")):
        command = ["bash", "-c", f'ulimit -v {limit}; exec "$@"', "-", sys.executable, "-c", code]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        assert says in done.stdout and bool(says) == bool(done.stdout.strip())


def test_what_native_code_prints_is_overheard_on_both_streams(capfd: pytest.CaptureFixture[str]) -> None:
    print("before")
    with captured_output() as said:
        ctypes.CDLL(None).puts(b"of a library")
        os.write(2, b"and more\n")
        print("by way of Python")
    print("after")
    assert capfd.readouterr() == ("before\nafter\n", "")
    assert sorted(said[0].splitlines()) == ["and more", "by way of Python", "of a library"]


def test_a_mesh_library_without_its_parts_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "pymeshlab.py").write_text(
        "import os\nos.write(1, b'Cannot load library (libOpenGL.so.0: cannot open shared object file: No such file)')\n"
        "class MeshSet:\n    def __init__(self, verbose): pass\n"
    )
    code = "from massprops.native import mesh_set; mesh_set([[0, 0, 0]], [[0, 0, 0]])"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, env=environment, check=False
    )
    assert done.stdout == "" and done.stderr.splitlines()[-1].endswith(
        "libOpenGL.so.0: cannot open shared object file; type: sudo apt-get install libopengl0"
    )


@pytest.mark.parametrize("system", ["linux", "darwin"])
@pytest.mark.parametrize("when", ["before", "after"])
def test_a_child_ends_with_its_parent(system: str, when: str) -> None:
    """Whether the parent ends before the child asks for it, or after."""
    child = (
        "import os, sys, time, types\n"
        "from massprops.core import processes\n"
        f"processes.sys = types.SimpleNamespace(platform={system!r})\n"
        f"if {when!r} == 'before': print('first', flush=True), sys.stdin.read()\n"
        "processes.die_with_parent()\n"
        "print('alive', os.environ.get(processes.PARENT), flush=True), time.sleep(10), print('outlived')\n"
    )
    parent = (
        "import subprocess, sys, time\n"
        "from massprops.core.processes import child_environment\n"
        "subprocess.Popen([sys.executable, '-c', sys.argv[1]], env=child_environment())\n"
        "time.sleep(600)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", parent, child], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdin is not None and process.stdout is not None
    said = process.stdout.readline()
    process.kill()
    process.wait()
    process.stdin.close()
    assert (said, process.stdout.read()) == ("first\n" if when == "before" else "alive None\n", ""), "ends, then"
    process.stdout.close()


def test_a_process_is_refused_more_memory_than_there_is() -> None:
    code = (
        "from massprops.core import processes\n"
        "processes.memory_there_is = lambda: 400_000_000\n"
        "processes.limit_memory()\n"
        "small = bytearray(10_000_000)\n"
        "try:\n"
        "    bytearray(500_000_000)\n"
        "except MemoryError:\n"
        "    print('refused')\n"
    )
    for tighter, says in ((None, "refused\n"), (1_000_000, "refused\n")):  # of a limit that was there the lower holds
        before = "" if tighter is None else f"ulimit -d {tighter}; "
        command = ["sh", "-c", before + 'exec "$@"', "sh", sys.executable, "-c", code]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout) == (0, says), done.stderr
    assert memory_there_is() is None or memory_there_is() > 100_000_000  # type: ignore[operator]
