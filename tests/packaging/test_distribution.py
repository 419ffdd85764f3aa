"""The source archive and the wheel carry what they need, and the papers of the project name what it is made of."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml

from massprops.native import advice

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def build(kind: str, source: Path, into: Path) -> Path:
    """Builds one archive offline, as pip would after it has fetched setuptools."""
    into.mkdir(exist_ok=True)
    code = f"import sys; from setuptools import build_meta as b; b.build_{kind}(sys.argv[1])"
    done = subprocess.run([sys.executable, "-c", code, str(into)], cwd=source, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    return next(into.iterdir())


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The source archive, and the wheel made of that archive alone."""
    pytest.importorskip("setuptools", minversion="77")
    base = tmp_path_factory.mktemp("dist")
    copy = base / "copy"
    left_out = shutil.ignore_patterns(
        ".git", ".venv", "runs", "bench-out", "build", "dist", "site", "__pycache__", "*.egg-info", ".*_cache"
    )
    shutil.copytree(ROOT, copy, ignore=left_out)
    sdist = build("sdist", copy, base / "sdist")
    with tarfile.open(sdist) as archive:
        archive.extractall(base / "unpacked", filter="data")
    return sdist, build("wheel", next((base / "unpacked").iterdir()), base / "wheel")


def test_the_wheel_holds_every_file_of_the_packages(archives: tuple[Path, Path]) -> None:
    names = set(zipfile.ZipFile(archives[1]).namelist())
    wanted = {
        (Path(into) / p.relative_to(ROOT / folder)).as_posix()
        for folder, into in (("massprops", "massprops"), ("cli", "massprops_cli"))
        for p in (ROOT / folder).rglob("*")
        if p.is_file() and "__pycache__" not in p.parts
    }
    assert sorted(wanted - names) == []
    assert "massprops/py.typed" in names
    assert not [n for n in names if n.startswith(("tests/", "docs/", "samples/"))]
    licences = {Path(n).name for n in names if "/licenses/" in n}
    assert licences >= {"LICENSE", "NOTICE"}


def test_the_source_archive_holds_what_its_makefile_asks_for(archives: tuple[Path, Path]) -> None:
    with tarfile.open(archives[0]) as archive:
        names = {n.partition("/")[2] for n in archive.getnames()}
    assert names >= {"Makefile", "LICENSE", "NOTICE", "CITATION.cff", "Dockerfile", "README.md", "CHANGELOG.md"}
    assert names >= {"samples/spacecraft.mp4", "samples/spacecraft.stl", "samples/spacecraft.length"}
    assert "tests/conftest.py" in names and "docs/files.md" in names


def test_the_wheel_works_outside_the_checkout(archives: tuple[Path, Path], tmp_path: Path) -> None:
    zipfile.ZipFile(archives[1]).extractall(tmp_path / "site")
    code = (
        "import massprops, massprops_cli.main as m; print(massprops.__file__);"
        "raise SystemExit(m.run(['simulate', 'tracks', '-o', 'seq', '--frames', '20', '-q']))"
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert str(tmp_path / "site") in done.stdout and (tmp_path / "seq/tracks0/data.csv").is_file()


def test_the_notice_names_every_dependency_and_what_the_gpl_means() -> None:
    notice = (ROOT / "NOTICE").read_text()
    for requirement in [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["cluster"]]:
        name = re.split(r"[<>=\[; ]", requirement)[0]
        assert re.search(rf"^  {re.escape(name)} ", notice, re.M | re.I), f"NOTICE says nothing of {name}"
    assert re.search(r"^  pymeshlab +GPL", notice, re.M) and re.search(r"^  PyMaxflow +GPL", notice, re.M)


def test_the_citation_fits_the_package() -> None:
    import massprops

    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == PROJECT["version"] == massprops.__version__
    assert citation["license"] == PROJECT["license"]
    assert "Apache License" in (ROOT / "LICENSE").read_text()


@pytest.mark.parametrize(
    ("module", "compiler", "says"),
    [
        ("pycolmap", True, "arm64"),
        ("maxflow", True, "pip install PyMaxflow.*a C\\+\\+ compiler builds it$"),
        ("maxflow", False, "which is not here: type 'sudo apt-get install g"),
    ],
)
def test_without_a_package_reconstruct_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, compiler: bool, says: str
) -> None:
    from massprops import native
    from massprops.errors import InputError
    from massprops.run import doctor, reconstruct

    monkeypatch.setattr(native, "find_spec", lambda name: None if name == module else object())
    monkeypatch.setattr(native.shutil, "which", lambda name: name if compiler else None)
    with pytest.raises(InputError, match=says):
        reconstruct.reconstruct(ROOT / "samples/spacecraft.mp4", tmp_path / "run")
    assert not (tmp_path / "run").exists()
    package = {"maxflow": "PyMaxflow"}.get(module, module)
    assert re.search(says, doctor._advice(package, f"ModuleNotFoundError: No module named '{module}'"))


@pytest.mark.parametrize(
    ("message", "package"),
    [
        ("libusb-1.0.so.0: cannot open shared object file", "libusb-1.0-0"),
        ("libidn2.so.0: cannot open shared object file", "libidn2-0"),
        ("libcom_err.so.2: cannot open shared object file", "libcom-err2"),
    ],
)
def test_a_missing_system_library_is_told_with_its_package(message: str, package: str) -> None:
    assert advice(message) == f"type: sudo apt-get install {package}"
    assert "doctor" in advice("undefined symbol")
