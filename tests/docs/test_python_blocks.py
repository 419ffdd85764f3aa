"""The Python in README, documentation, gallery and samples: its calls are possible, and its blocks run."""

from __future__ import annotations

import ast
import inspect
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import massprops

sys.path.insert(0, str(Path(__file__).parents[1] / "report"))
from fake_run import add_everything, make_run

ROOT = Path(__file__).parents[2]
BLOCKS = {
    f"{page.name}-{i}": text
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
    for i, text in enumerate(re.findall(r"^```python\n(.*?)^```", page.read_text(), re.M | re.S))
}
SCRIPTS = {
    p.name: p.read_text() for folder in ("docs/gallery", "samples") for p in sorted((ROOT / folder).glob("*.py"))
}


@pytest.mark.parametrize("name", [*BLOCKS, *SCRIPTS])
def test_calls_are_possible(name: str) -> None:
    """Every function of the package exists, and takes the arguments that it is given."""
    tree = ast.parse({**BLOCKS, **SCRIPTS}[name])
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("massprops"):
            module = __import__(node.module, fromlist=["x"])
            assert all(hasattr(module, one.name) for one in node.names), ast.unparse(node)
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "massprops":
            assert hasattr(massprops, node.attr), ast.unparse(node)
        if isinstance(node, ast.Call) and ast.unparse(node.func).startswith("massprops."):
            bound(node)


def bound(call: ast.Call) -> None:
    """Asserts that the function has parameters for what a call gives it."""
    function = eval(ast.unparse(call.func), {"massprops": massprops})
    spread = any(isinstance(a, ast.Starred) for a in call.args) or any(k.arg is None for k in call.keywords)
    bind = inspect.signature(function).bind_partial if spread else inspect.signature(function).bind
    given = [None for a in call.args if not isinstance(a, ast.Starred)]
    try:
        bind(*given, **{k.arg: None for k in call.keywords if k.arg is not None})
    except TypeError as error:
        raise AssertionError(f"{ast.unparse(call)}: {error}") from None


@pytest.fixture(scope="module")
def names(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What a reader of the blocks has of his own: times, attitudes and body rates."""
    seen = massprops.simulate("tracks", frames=60, attitude=0.005, rates=0.002, seed=2)
    attitude, rates = seen.sequence.attitude, seen.sequence.rates
    assert np.array_equal(attitude.timestamp_ns, rates.timestamp_ns)
    return {"times": attitude.timestamp_ns * 1e-9, "q": attitude.q, "quaternions": attitude.q, "gyroscope": rates.w}


@pytest.mark.parametrize("name", BLOCKS)
def test_blocks_run(name: str, names: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As they stand, but for `reconstruct`, which takes minutes: its call is bound, and it gives a run made by hand."""
    real = massprops.reconstruct

    def reconstruct(*given: Any, **options: Any) -> Any:
        inspect.signature(real).bind(*given, **options)
        return massprops.open_run(add_everything(make_run(tmp_path / "run")))

    monkeypatch.setattr(massprops, "reconstruct", reconstruct)
    monkeypatch.chdir(tmp_path)
    exec(compile(BLOCKS[name], name, "exec"), {**names, "__name__": "block"})


def test_the_effect_of_the_docs_is_one(tmp_path: Path) -> None:
    """The file of docs/effects.md, by the command that stands below it, shortened."""
    page = (ROOT / "docs/effects.md").read_text()
    file = tmp_path / "sunlit_jet.py"
    file.write_text(BLOCKS["effects.md-0"])
    asked = re.search(
        r"^massprops simulate tracks -o seq --attitude 0.005 --effect sunlit_jet.py --effects (\S+)$", page, re.M
    )
    assert asked is not None
    still = massprops.simulate("tracks", frames=20, seed=3)
    pushed = massprops.simulate("tracks", frames=20, seed=3, effect=[file], effects=[asked[1]])
    assert np.abs(pushed.truth.w - still.truth.w).max() > 1e-4
