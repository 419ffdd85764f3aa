"""A package brings an export format, a scale source or a paper in one file, with no other change; effects and estimators
have the like beside their own tests."""

from __future__ import annotations

from collections.abc import Callable

FORMAT = """
NAME = "mass-only"
SUFFIX = ".mass"
NEEDS_METRES = False
MESHES = False


def render(body, meshes):
    return f"{body.mass:.6g}"
"""


def test_a_format(with_package: Callable[..., str]) -> None:
    code = """
import tempfile, trimesh, massprops
from pathlib import Path
from massprops.exchange.formats import formats
with tempfile.TemporaryDirectory() as folder:
    trimesh.creation.box((1, 2, 3)).export(f"{folder}/box.stl")
    print(Path(massprops.export(f"{folder}/box.stl", to="mass-only", density=10.0)).read_text(), "worse" in formats())
"""
    bad = FORMAT.replace("mass-only", "worse").replace("SUFFIX", "ENDING")
    assert with_package("massprops.formats", code, good=FORMAT, bad=bad).split() == ["60", "False"]


SOURCE = """
from massprops.sfm.scale import ScaleEstimate

NAME = "stick"


def estimate(inputs):
    return ScaleEstimate("stick", 2.5, 1e-6)
"""


def test_a_scale_source(with_package: Callable[..., str]) -> None:
    code = """
from massprops.sfm.scale import ScaleInputs, find_scale
found = find_scale(ScaleInputs(length=2.0, given=5.5, given_sigma=0.1))
print(found.source, found.metres_per_unit, [e.source for e in found.all])
"""
    taken = SOURCE.replace('NAME = "stick"', 'NAME = "given"')
    said = with_package("massprops.scale_sources", code, good=SOURCE, bad=taken)
    assert said.strip() == "stick 5.0 ['given', 'stick']"


PAPER = '''
"""A paper of one number a run."""

PAPER = "nobody2026"
CASES = {"only": "the seed, squared"}
RUNS = {"only": 3}


def configuration(case):
    return {"power": 2}


def runs(configuration, seeds):
    return [{"seed": seed, "value": float(seed) ** configuration["power"]} for seed in seeds]


def table(case, rows):
    return {"title": case, "columns": ["sum"], "rows": [[sum(row["value"] for row in rows)]], "notes": []}
'''


def test_a_paper(with_package: Callable[..., str]) -> None:
    code = """
import massprops
from massprops.campaigns.papers import papers
found = massprops.reproduce("nobody2026", runs=3, seed=1, workers=1)
print(found.column("value").sum(), "14" in found.text, "worse2026" in papers())
"""
    worse = PAPER.replace("nobody", "worse").replace("def table", "def tables")
    assert with_package("massprops.papers", code, good=PAPER, bad=worse).strip() == "14.0 True False"
