"""The command line: quick help, exit codes, one-line errors, clean JSON."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh

HEAVY = ("numpy", "cv2", "pycolmap", "open3d", "numba", "scipy", "trimesh", "pymeshlab", "yaml", "rich.progress")


def massprops(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    code = "from massprops_cli.main import main; main()"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, cwd=cwd, timeout=300, check=False
    )


@pytest.mark.parametrize(
    "arguments",
    [
        ["--help"],
        ["reconstruct", "--help"],
        ["compare", "--help"],
        ["simulate", "--help"],
        ["export", "--help"],
        ["mass", "--help"],
        ["campaign", "--help"],
        ["reproduce", "--help"],
    ],
)
def test_help_loads_nothing_heavy_and_shows_an_example(arguments: list[str]) -> None:
    code = (
        "import sys\nfrom massprops_cli.main import run\n"
        f"code = run({arguments!r})\n"
        f"print('HEAVY', [m for m in {HEAVY!r} if m in sys.modules], code)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert "HEAVY [] 0" in done.stdout
    assert "Example: massprops" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["reconstruct", "nothing.mp4", "-o", "run"], "no such file"),
        (["reconstruct", ".", "-o", "run", "--frames", "1"], "--frames 1"),
        (["reconstruct", ".", "-o", "run", "--density", "-5"], "--density"),
        (["reconstruct", ".", "-o", "run", "--motion", "sideways"], "tumbling"),
        (["reconstruct", ".", "-o", "run", "--masks", "nowhere"], "--masks"),
        (["reconstruct", "."], "-o"),
        (["reconstrct"], "no such command"),
        (["reconstruct", ".", "-o", "run", "--frames", "many"], "--frames"),
        (["simulate", "nothing", "-o", "seq"], "asteroid, bracket, spacecraft"),
        (["simulate", "asteroid", "-o", "seq", "--size", "big"], "640x480"),
        (["export", "nowhere", "--to", "urdf"], "no such"),
        (["compare", "nowhere", "cad.stl"], "no such"),
        (["view", "nowhere"], "no such folder"),
        (["mass", "nothing.stl", "-o", "run"], "no such file"),
    ],
)
def test_wrong_input_is_one_line_and_exit_2(tmp_path: Path, arguments: list[str], says: str) -> None:
    done = massprops(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1 and says in lines[0], done.stderr
    assert "Traceback" not in done.stderr and done.stdout == ""


def test_a_text_file_named_mp4(tmp_path: Path) -> None:
    (tmp_path / "v.mp4").write_text("not a video " * 100)
    done = massprops("reconstruct", "v.mp4", "-o", "run", "-q", cwd=tmp_path)
    assert done.returncode == 2 and "not a video" in done.stderr and "Traceback" not in done.stderr


def test_mass_of_a_mesh_and_its_exports(tmp_path: Path) -> None:
    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / "box.stl")
    done = massprops("mass", "box.stl", "-o", "run", "--density", "2.0", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["volume"] == pytest.approx(6.0)
    assert document["mass"] == pytest.approx(12.0)
    assert document["principal_moments"] == pytest.approx([5.0, 10.0, 13.0])
    assert (tmp_path / "run/report.html").stat().st_size > 10_000
    done = massprops("export", "run", "--to", "urdf", "-o", "box.urdf", cwd=tmp_path)
    assert done.returncode == 0 and (tmp_path / "box.urdf").is_file()
    assert massprops("export", "run", "--to", "dwg", cwd=tmp_path).returncode == 2


def test_open_and_empty_meshes(tmp_path: Path) -> None:
    box = trimesh.creation.box()
    box.update_faces([True] * 6 + [False] * 6)
    box.export(tmp_path / "open.stl")
    (tmp_path / "points.off").write_text("OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n")
    for name in ("open.stl", "points.off"):
        done = massprops("mass", name, "-o", "run", cwd=tmp_path)
        assert done.returncode == 2 and len(done.stderr.strip().splitlines()) == 1, done.stderr


def test_version() -> None:
    assert massprops("--version").stdout.startswith("massprops ")
