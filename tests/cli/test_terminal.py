"""What reaches the terminal: no word of a library's, nothing it would obey, one line about a bug; on any terminal."""

from __future__ import annotations

import logging
import os
import stat
import subprocess
import sys
import tomllib
import warnings
from pathlib import Path

import pytest
import trimesh
from whole import massprops

from massprops.core.text import clean
from massprops_cli import main


def test_control_characters_are_shown_as_codes() -> None:
    assert clean("a\x1b[31mred\x9b2J \u202eevil \udce9 ± °\n\tb") == "a\\x1b[31mred\\x9b2J \\u202eevil \\xe9 ± °\n\tb"


def test_libraries_are_silent_and_a_bug_is_one_line_with_a_file(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)

    def broken() -> None:
        warnings.warn("divide by zero", RuntimeWarning, stacklevel=1)
        logging.getLogger("trimesh").error("a traceback of theirs")
        raise KeyError("oops")

    monkeypatch.setattr(main, "app", broken)
    said = massprops(capfd, "mass", "x.stl")
    assert said.code == 3 and len(said.lines) == 1 and said.out == ""
    assert "unexpected KeyError" in said.err and "issue tracker" in said.err
    written = [p for p in tmp_path.iterdir() if p.suffix == ".txt"]
    assert len(written) == 1 and str(written[0]) in said.err
    assert "Traceback" in written[0].read_text() and "'x.stl'" in written[0].read_text()
    assert logging.lastResort is not None, "as it was"


def test_the_end_of_a_file_is_no_interrupt(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def ended(*_: object) -> None:
        raise EOFError("no data left in file")

    monkeypatch.setattr("massprops.run.from_mesh.mass", ended)
    said = massprops(capfd, "mass", "x.stl", "-o", tmp_path / "run")
    assert said.code == 3 and len(said.lines) == 1 and "no data left in file" in said.err, said


@pytest.mark.parametrize(
    ("error", "free"),
    [
        (ImportError("libavcodec.so: failed to map segment from shared object"), (3, "is a bug in massprops")),
        (OSError("Could not find/load shared object file 'libllvmlite.so'"), (2, "libllvmlite")),
        (MemoryError(), (3, "give a smaller one")),
    ],
)
def test_a_limit_on_address_space_is_no_bug(
    error: Exception, free: tuple[int, str], monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def fails(*_: object) -> None:
        raise error

    monkeypatch.setattr("massprops.run.from_mesh.mass", fails)
    monkeypatch.setattr("massprops_cli.main._report", lambda _: "")
    said = massprops(capfd, "mass", "x.stl", "-o", "run")
    assert said.code == free[0] and free[1] in said.err and "ulimit" not in said.err, said
    monkeypatch.setattr("resource.getrlimit", lambda _: (500_000_000, 500_000_000))
    said = massprops(capfd, "mass", "x.stl", "-o", "run")
    assert said.code == 3 and len(said.lines) == 1, said
    assert "limited to 0.5 GB (ulimit -v)" in said.err and "bug" not in said.err, said


@pytest.mark.parametrize(
    "terminal",
    [
        {"LANG": "C", "LC_ALL": "C"},
        {"PYTHONIOENCODING": "ascii"},
        {"TERM": "dumb", "COLUMNS": "20"},
    ],
)
def test_strange_terminals(tmp_path: Path, terminal: dict[str, str]) -> None:
    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / "box.stl")
    code = "from massprops_cli.main import main; main()"
    done = subprocess.run(
        [sys.executable, "-P", "-c", code, "mass", "box.stl", "-o", "run", "--scale-sigma", "0.01", "--density", "2700"],
        capture_output=True, cwd=tmp_path, env={**os.environ, **terminal}, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0 and b"volume" in done.stdout and done.stderr == b""


def test_numba_has_a_place_where_package_and_home_cannot_be_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from massprops import native

    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.setattr(native, "_writable", lambda path: True)  # also where these tests run without either
    native.prepare_numba_cache()
    assert not os.environ["NUMBA_CACHE_DIR"], "the ordinary places do"
    monkeypatch.setattr(native, "_writable", lambda path: False)
    native.prepare_numba_cache()
    place = Path(os.environ["NUMBA_CACHE_DIR"])
    assert place.parent == tmp_path and stat.S_IMODE(place.stat().st_mode) == 0o700
    place.chmod(0o777)  # numba loads what it finds: never from a place that others can write to
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    native.prepare_numba_cache()
    assert Path(os.environ["NUMBA_CACHE_DIR"]) != place


def test_an_interrupt_while_modules_are_loaded_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "typer.py").write_text("raise KeyboardInterrupt\n")
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from massprops_cli.start import main; main()"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "massprops: interrupted before anything was done\n")
    scripts = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]["scripts"]
    assert scripts["massprops"] == "massprops_cli.start:main"
