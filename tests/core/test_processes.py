"""Processes: what native code prints stays off the terminal."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from massprops.core.processes import muffled


def test_what_native_code_prints_is_kept_away_while_it_lasts(capfd: pytest.CaptureFixture[str]) -> None:
    with muffled(), muffled():
        os.write(2, b"Corrupt JPEG data\n")
    os.write(2, b"ours\n")
    assert capfd.readouterr().err == "ours\n"


def test_a_closed_standard_error_stays_closed() -> None:
    real = os.dup(2)
    os.close(2)
    try:
        with muffled():
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
