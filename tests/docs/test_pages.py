"""README and documentation: short enough, every link leads somewhere, every command, estimator and effect is named."""

from __future__ import annotations

import ast
import csv
import importlib
import importlib.util
import os
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import massprops
from massprops.campaigns.papers import references
from massprops.effects import effects
from massprops.sequence import Sequence, read_sequence
from massprops_cli.main import COMMANDS

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
MADE = {"python.md", "commands.md", "papers.md", "changelog.md", "report.png"}
SCRIPTS = sorted((ROOT / "docs/gallery").glob("[0-9]*.py"))


def test_the_readme_is_short_and_names_every_command() -> None:
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 130
    for command in COMMANDS:
        assert re.search(rf"[`| ]{command}\b", text), command
    for target in ("demo", "test", "docs"):
        assert f"make {target}" in text and re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.M)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_links_between_pages_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)#\s]+)", page.read_text()):
        if re.match(r"https?:", link):
            continue
        made = page.parent.name == "docs" and (link in MADE or link.startswith(("methods/", "catalogue/", "gallery/")))
        assert made or (page.parent / link).exists(), link


def test_every_page_is_in_the_navigation() -> None:
    listed = (ROOT / "mkdocs.yml").read_text()
    for page in PAGES[1:]:
        assert f"- {page.name}" in listed, page.name


def test_papers_have_a_reference_and_the_citation_gives_the_same() -> None:
    import yaml

    cited = {r["title"]: r.get("doi", "") for r in yaml.safe_load((ROOT / "CITATION.cff").read_text())["references"]}
    found = {reference.title: reference.doi for reference in references().values()}
    assert cited.items() <= found.items() and len(cited) >= 5


NAMING = [*(ROOT / "docs/generate").glob("*.py"), *(ROOT / "tests/bench").rglob("*.py")]


@pytest.mark.parametrize("path", sorted(NAMING), ids=lambda p: str(p.relative_to(ROOT)))
def test_what_no_other_test_runs_names_things_of_the_product_that_are_there(path: Path) -> None:
    """The benches and what makes the pages: a name that moved is seen here, and not when they are run months later."""
    imported = [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.ImportFrom) and n.level == 0]
    for node in imported:
        if node.module is not None and node.module.split(".")[0] == "massprops":
            module = importlib.import_module(node.module)
            for alias in node.names:
                if not hasattr(module, alias.name):
                    importlib.import_module(f"{node.module}.{alias.name}")


def test_effects_on_a_mesh_have_a_page_without_a_plot() -> None:
    page = runpy.run_path(str(ROOT / "docs/generate/effect_pages.py"))["page"]
    known = effects()
    on_mesh = [name for name, effect in known.items() if "mesh" in effect.NEEDS]
    assert on_mesh
    for name in (*on_mesh, "viscous-damping"):
        assert (f"({name}.svg)" in page(name, known[name])) == (name not in on_mesh)


def test_the_page_of_files_lists_the_keys_that_results_have() -> None:
    import trimesh

    from massprops.estimators.documents import document as estimates_of

    listed = runpy.run_path(str(ROOT / "docs/generate/result_files.py"))["RESULTS"]
    compared = massprops.compare(trimesh.creation.box((1, 2, 3.03)), trimesh.creation.box((1, 2, 3))).document()
    assert {*listed["compare.json"], "format"} == {*compared, "fused", "colour_limit"}  # a colour where it was written
    t = np.linspace(0.0, 10.0, 101)
    w = np.stack([0.1 * np.cos(0.2 * t), 0.1 * np.sin(0.2 * t), np.full(101, 0.4)], axis=1)
    found = massprops.estimate(massprops.sequence_from_arrays(t, rates=w, rate_sigma=1e-4), method="momentum-ls")
    assert {*listed["estimates.json"], "format"} == set(estimates_of(found.outcome))
    for name, package in (("crosscheck.json", "consistency"), ("diagnosis.json", "diagnosis")):
        source = "".join(p.read_text() for p in (ROOT / "massprops" / package).rglob("*.py"))
        assert all(f'"{key}"' in source for key in listed[name]), name


def test_the_gallery_has_scripts_with_what_they_gave() -> None:
    assert len(SCRIPTS) >= 12
    for script in SCRIPTS:
        assert ast.get_docstring(ast.parse(script.read_text())), script.name
        for ending in ("png", "txt"):
            assert (ROOT / "docs/gallery/output" / f"{script.stem}.{ending}").stat().st_size > 20, script.name


@pytest.mark.parametrize("number", ["01", "03", "13"])
def test_the_quick_scripts_of_the_gallery_run(number: str, tmp_path: Path) -> None:
    if importlib.util.find_spec("matplotlib") is None:
        pytest.skip("matplotlib is of the extra docs: make gallery")
    script = next(p for p in SCRIPTS if p.name.startswith(number))
    done = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, capture_output=True, text=True, check=False,
        env={**os.environ, "SHORT": "1", "GALLERY_OUT": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / f"{script.stem}.png").is_file()


def test_a_table_of_tracks_becomes_a_sequence(tmp_path: Path) -> None:
    seen = massprops.simulate("tracks", frames=30, seed=2)
    tracks = seen.sequence.tracks
    with (tmp_path / "tracks.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["time", "camera", "point", "x", "y"])
        for stamp, camera, point, (x, y) in zip(
            tracks.timestamp_ns, tracks.camera, tracks.feature, tracks.uv, strict=True
        ):
            table.writerow([stamp * 1e-9, camera, point, x, y])
    options = ["--focal", "1000", "--size", "1280x1024", "--baseline", "1.0"]
    found = by_script(tmp_path, "--tracks", "tracks.csv", *options)
    assert len(found.tracks.uv) == len(tracks.uv) and found.attitude is None


def by_script(folder: Path, *options: str) -> Sequence:
    """The sequence that `samples/tables_to_sequence.py` makes of tables in a folder."""
    script = ROOT / "samples/tables_to_sequence.py"
    subprocess.run([sys.executable, str(script), "seq", *options], cwd=folder, check=True)
    return read_sequence(folder / "seq")


def test_a_table_of_attitudes_becomes_a_sequence_in_either_convention(tmp_path: Path) -> None:
    true = massprops.simulate("tracks", frames=30, attitude=0.005, seed=2).sequence.attitude
    times = true.timestamp_ns * 1e-9
    q = true.q
    np.savetxt(tmp_path / "plain.csv", np.column_stack([times, q]), delimiter=",", header="time,w,x,y,z")
    other = np.column_stack([times, -q[:, 1:], q[:, 0], np.full(len(q), 0.002)])[::-1]
    np.savetxt(tmp_path / "tracker.csv", other, delimiter=",")
    rates = np.column_stack([times[::2], np.tile([0.1, 0.2, 0.3], (len(times[::2]), 1))])
    np.savetxt(tmp_path / "rates.csv", rates, delimiter=",")

    found = by_script(tmp_path, "--attitudes", "plain.csv", "--attitude-sigma", "0.004", "--rates", "rates.csv")
    assert np.allclose(found.attitude.q, q, atol=1e-7) and np.allclose(found.attitude.sigma, 0.004)
    assert np.array_equal(found.attitude.timestamp_ns, true.timestamp_ns) and len(found.rates.w) == 15
    shutil.rmtree(tmp_path / "seq")
    found = by_script(tmp_path, "--attitudes", "tracker.csv", "--scalar-last", "--into-body")
    assert np.allclose(found.attitude.q, q, atol=1e-7) and np.allclose(found.attitude.sigma, 0.002)
