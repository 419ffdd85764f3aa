"""No file of the product imports itself by way of others, imports within functions counted."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FILES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for folder in ("massprops", "cli")
    for path in (ROOT / folder).rglob("*.py")
}


def typing_only(tree: ast.AST) -> set[int]:
    """Nodes below `if TYPE_CHECKING`, which never run."""
    return {
        id(below)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for below in ast.walk(node)
    }


def imported(module: str, text: str) -> set[str]:
    """Modules of the product that a file imports, anywhere in it."""
    tree = ast.parse(text)
    unused = typing_only(tree)
    names: set[str] = set()
    for node in ast.walk(tree):
        if id(node) in unused:
            continue
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    names = {"cli" + n.removeprefix("massprops_cli") if n.startswith("massprops_cli") else n for n in names}
    # a package's own front door may gather what lies in it
    return {n for n in names if n in FILES and n != module and not module.startswith(n + ".")}


def first_circle(graph: dict[str, set[str]]) -> list[str]:
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_no_import_closes_a_circle() -> None:
    graph = {module: imported(module, path.read_text()) for module, path in FILES.items()}
    assert sum(map(len, graph.values())) > 500
    assert first_circle(graph) == []


@pytest.mark.parametrize("within", ["", "def late():\n    "])
def test_a_circle_is_found(within: str) -> None:
    graph = {
        "massprops.views": imported("massprops.views", f"{within}from massprops.model import Model"),
        "massprops.model": imported("massprops.model", "import massprops.views"),
    }
    assert set(first_circle(graph)) == {"massprops.views", "massprops.model"}
