"""What `make lint` holds the source to beside ruff and mypy: short functions, few parameters, no hidden imports, nothing
unused.

`python -m tests.house` prints one line for each fault. What is excepted is named below; an exception that is needed no
longer is noted.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path

from vulture import Vulture

ROOT = Path(__file__).parents[1]
MOST_LINES, MOST_PARAMETERS = 60, 10

LONG: set[str] = set()
"""Functions, as `path:name`, that are longer still: no new one."""

UNUSED = {
    "format_commands": "typer calls it",
    "free_path": "compiled by its name",
    "sensor_type": "a key that other programs write, read and left",
    "comment": "the same",
    "camera_model": "the same",
    "distortion_model": "the same",
    "length_scales": "a result for who asks for it",
    "sigma_velocity": "written by its name",
}
"""Names that no line of ours uses, and why they stay."""


def sizes(path: Path) -> list[tuple[str, int, int, int]]:
    """Name, line, length and number of parameters of every function of a file."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            given = node.args.args + node.args.kwonlyargs + node.args.posonlyargs
            found.append((node.name, node.lineno, (node.end_lineno or node.lineno) - node.lineno + 1, len(given)))
    return found


def size_faults() -> list[str]:
    """Functions that are too long or take too much."""
    faults: list[str] = []
    long = set()
    for path in sorted(p for folder in ("massprops", "cli") for p in (ROOT / folder).rglob("*.py")):
        where = str(path.relative_to(ROOT))
        for name, line, length, count in sizes(path):
            key = f"{where}:{name}"
            if length > MOST_LINES:
                long.add(key)
                if key not in LONG:
                    faults.append(f"{where}:{line}: {name} has {length} lines, more than {MOST_LINES}: split it")
            if count > MOST_PARAMETERS:
                faults.append(f"{where}:{line}: {name} takes {count} parameters, more than {MOST_PARAMETERS}")
    note("LONG", LONG - long)
    return faults


SHADOWED: set[str] = set()
"""Names of functions' own, as `path:function:name`, that hide an import of their file: no new one."""


def shadow_faults() -> list[str]:
    """Parameters and variables of a function that have the name of something the file imports at its top."""
    found = {}
    for path in sorted(p for folder in ("massprops", "cli") for p in (ROOT / folder).rglob("*.py")):
        where, tree = str(path.relative_to(ROOT)), ast.parse(path.read_text())
        imports = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
        top = {(name.asname or name.name).split(".")[0] for node in imports for name in node.names}
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                inside = list(ast.walk(node))
                own = {x.arg for x in inside if isinstance(x, ast.arg)}
                own |= {x.id for x in inside if isinstance(x, ast.Name) and isinstance(x.ctx, ast.Store)}
                for name in own & top:
                    found[f"{where}:{node.name}:{name}"] = f"{where}:{node.lineno}: {node.name}: {name} hides an import"
    note("SHADOWED", SHADOWED - set(found))
    return [line for key, line in sorted(found.items()) if key not in SHADOWED]


def note(where: str, stale: set[str]) -> None:
    """Says which exceptions can go."""
    for name in sorted(stale):
        print(f"note: tests/house.py: {where}: {name} needs no exception any more: take it out")


def unused_faults() -> list[str]:
    """Functions, classes and variables that nothing uses, the tests and the documentation counted as users.

    Attributes are left out: those that we only set are read by the libraries that own them.
    """
    finder = Vulture()
    finder.scavenge([str(ROOT / name) for name in ("massprops", "cli", "tests", "docs/generate", "docs/gallery")])
    found = [
        item
        for item in finder.get_unused_code()
        if item.typ != "attribute" and item.filename.relative_to(ROOT).parts[0] in ("massprops", "cli")
    ]
    faults = [
        f"{item.filename.relative_to(ROOT)}:{item.first_lineno}: {item.typ} {item.name} is used nowhere"
        for item in found
        if item.name not in UNUSED
    ]
    note("UNUSED", set(UNUSED) - {item.name for item in found})
    return faults


if __name__ == "__main__":
    faults = size_faults() + shadow_faults() + unused_faults()
    print(*faults, sep="\n", end="\n" if faults else "")
    sys.exit(bool(faults))
