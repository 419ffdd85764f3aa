"""No file of the product imports itself by way of others, and none imports a room above its own; imports within functions
counted."""

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


LAYERS = (
    ("cli",),
    ("massprops",),
    ("api",),
    ("campaigns",),
    ("run",),
    ("consistency", "diagnosis"),
    ("report", "simulation"),
    ("exchange",),
    ("capture", "estimators", "sfm"),
    ("effect_file", "surface"),
    ("dense", "mass", "model"),
    ("sensing",),
    ("dynamics",),
    ("effects", "sequence"),
    ("packaged",),
    ("effect_contract", "views"),
    ("documents",),
    ("geometry", "memory", "native"),
    ("core",),
    ("errors",),
)
"""Rooms from the top down, as `docs/architecture.md` says: one imports from those below it only, and not from its like."""
LEVEL = {room: level for level, layer in enumerate(LAYERS) for room in layer}


def typing_only(tree: ast.AST) -> set[int]:
    """Nodes below `if TYPE_CHECKING`, which never run."""
    return {
        id(below)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and any(getattr(n, "id", "") == "TYPE_CHECKING" for n in ast.walk(node.test))
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


@pytest.fixture(scope="module")
def graph() -> dict[str, set[str]]:
    """Of each module, the modules of ours that it imports."""
    return {module: imported(module, path.read_text()) for module, path in FILES.items()}


def first_circle(graph: dict[str, set[str]]) -> list[str]:
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_no_import_closes_a_circle(graph: dict[str, set[str]]) -> None:
    assert sum(map(len, graph.values())) > 500
    assert first_circle(graph) == []


def room_of(module: str) -> str:
    """The package of `massprops` that a file lies in, or the file that stands beside them."""
    head, _, rest = module.partition(".")
    return rest.partition(".")[0] or head if head == "massprops" else head


def upward(graph: dict[str, set[str]]) -> list[str]:
    """Imports of a room that does not lie below the importing one."""
    return [
        f"{module} imports {other}"
        for module, others in sorted(graph.items())
        for other in sorted(others)
        if (a := room_of(module)) != (b := room_of(other)) and LEVEL[a] >= LEVEL[b]
    ]


def test_every_import_leads_down(graph: dict[str, set[str]]) -> None:
    assert {room_of(module) for module in FILES} <= set(LEVEL), "a room without a layer: name it in LAYERS"
    assert upward(graph) == []


def test_the_documentation_shows_the_same_layers() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text()
    picture = next(block for block in text.split("```") if block.strip().startswith("cli > "))
    shown = [set(layer.replace(",", " ").split()) for layer in picture.split(">")]
    assert shown == [set(layer) for layer in LAYERS if layer != ("massprops",)]


@pytest.mark.parametrize(
    ("module", "other", "bad"),
    [
        ("massprops.core.files", "massprops.sequence.read", True),
        ("massprops.dynamics.orbit", "massprops.sensing.predict", True),
        ("massprops.run.child", "massprops.core.files", False),
        ("massprops.sfm.predicted_images", "massprops.sfm.pairs", False),
    ],
)
def test_an_import_that_leads_up_is_found(module: str, other: str, bad: bool) -> None:
    assert bool(upward({module: {other}})) == bad


def test_every_module_imported_is_there() -> None:
    """mypy takes a module of ours that is missing for one of a library without types."""
    packages = {name.rpartition(".")[0] for name in FILES} | set(FILES)
    missing = [
        f"{path.relative_to(ROOT)}:{node.lineno}: {node.module}"
        for folder in ("massprops", "cli", "tests")
        for path in (ROOT / folder).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "massprops"
        if node.module not in packages
    ]
    assert missing == []


@pytest.mark.parametrize("within", ["", "def late():\n    "])
def test_a_circle_is_found(within: str) -> None:
    graph = {
        "massprops.views": imported("massprops.views", f"{within}from massprops.model import Model"),
        "massprops.model": imported("massprops.model", "import massprops.views"),
    }
    assert set(first_circle(graph)) == {"massprops.views", "massprops.model"}
