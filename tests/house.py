"""What `make lint` checks beside ruff and mypy: short functions, few parameters, many fields by name, no name that hides an
import, no statements that stand twice, nothing unused.

`python -m tests.house` prints one line for each fault. What is excepted is named below; an exception that is needed no
longer is noted.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from vulture import Vulture

ROOT = Path(__file__).parents[1]
MOST_LINES, MOST_PARAMETERS = 60, 7
MOST_OF_KERNELS = 10
"""Parameters of a function that numba compiles: it takes numbers and arrays one by one."""
COMPILED = ("massprops/estimators/filters/", "massprops/dynamics/kernels.py")
"""Where functions are compiled by their callers, without a decorator."""

LONG: set[str] = set()
"""Functions, as `path:name`, that are longer still: no new one."""

WIDE = {
    # options of a command, each of them documented
    "cli/campaign.py:command",
    "cli/estimate.py:command",
    "massprops/api/verbs.py:estimate",
    "massprops/api/verbs.py:diagnose",
    "massprops/api/verbs.py:reproduce",
    # the terms of one equation
    "massprops/dynamics/alignment.py:align",
    "massprops/dynamics/sensitivities.py:sensitivities",
    "massprops/dynamics/sensitivities.py:_at_start",
    "massprops/dynamics/sensitivities.py:_across",
    "massprops/dynamics/sensitivities.py:_outputs",
    "massprops/campaigns/papers/_pesce2017_state.py:covariance_of",
    "massprops/campaigns/papers/_pesce2017_transition.py:predict",
    "massprops/campaigns/papers/_pesce2017_update.py:update",
    "massprops/estimators/gp/coregionalised.py:_nll",
    # what is measured, the options, and where progress goes
    "massprops/campaigns/papers/_pesce2017_together.py:update_again",
    "massprops/core/outputs.py:deliver",
    "massprops/diagnosis/discovery/regression.py:regression_of",
    "massprops/diagnosis/search/candidate_fits.py:fit_candidates",
    "massprops/estimators/batch/outcome.py:estimate_of",
    "massprops/estimators/rates.py:_attitude_fit",
    "massprops/sfm/attitude.py:to_sequence",
    "massprops/sfm/surface_tracks.py:with_surface",
    "massprops/simulation/effect_size.py:sized",
    "massprops/simulation/tracks.py:_measure",
    "massprops/surface/reconstruct.py:reconstruct_surface",
    "massprops/surface/placed.py:placed",
}
"""Functions, as `path:name`, with up to ten parameters, and why: no new one without a reason."""

MOST_BY_PLACE = 7
"""Values that an object may be made of without their names."""


def place_faults() -> list[str]:
    """Objects made of many values in a row, of which a reader cannot tell which is which."""
    return [
        f"{path.relative_to(ROOT)}:{node.lineno}: {node.func.id} is made of {len(node.args)} values without their names"
        for path in product()
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id.lstrip("_")[:1].isupper()
        if len(node.args) > MOST_BY_PLACE and not any(isinstance(a, ast.Starred) for a in node.args)
    ]


REPEATED_LINES = 6
"""Lines of statements that must not stand twice."""

UNUSED = {
    "format_commands": "typer calls it",
    "trajectories": "compiled by its name",
    "sensor_type": "a key that other programs write, read and left",
    "comment": "the same",
    "camera_model": "the same",
    "distortion_model": "the same",
    "sigma_velocity": "written by its name",
}
"""Names that no line of ours uses, and why they stay."""


def product() -> list[Path]:
    """Every Python file of the product."""
    return sorted(p for folder in ("massprops", "cli") for p in (ROOT / folder).rglob("*.py"))


def sizes(path: Path) -> list[tuple[str, int, int, int, bool]]:
    """Name, line, length and number of parameters of every function of a file, and whether numba compiles it."""
    found = []
    compiled_here = str(path.relative_to(ROOT)).startswith(COMPILED)
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            given = node.args.args + node.args.kwonlyargs + node.args.posonlyargs
            count = sum(argument.arg not in ("self", "cls") for argument in given)
            length = (node.end_lineno or node.lineno) - node.lineno + 1
            compiled = compiled_here or any("njit" in ast.unparse(d) for d in node.decorator_list)
            found.append((node.name, node.lineno, length, count, compiled))
    return found


def size_faults() -> list[str]:
    """Functions that are too long or take too much."""
    faults: list[str] = []
    long, wide = set(), set()
    for path in product():
        where = str(path.relative_to(ROOT))
        for name, line, length, count, compiled in sizes(path):
            key = f"{where}:{name}"
            if length > MOST_LINES:
                long.add(key)
                if key not in LONG:
                    faults.append(f"{where}:{line}: {name} has {length} lines, more than {MOST_LINES}: split it")
            if count > MOST_PARAMETERS and not compiled:
                wide.add(key)
            most = MOST_OF_KERNELS if compiled or key in WIDE else MOST_PARAMETERS
            if count > most:
                faults.append(f"{where}:{line}: {name} takes {count} parameters, more than {most}")
    note("LONG", LONG - long)
    note("WIDE", WIDE - wide)
    return faults


def blocks(tree: ast.AST) -> Iterator[list[ast.stmt]]:
    """Every list of statements that follow one another, imports and docstrings left out, which end a list."""
    for node in ast.walk(tree):
        for field in ("body", "orelse", "finalbody"):
            block: list[ast.stmt] = []
            statements = getattr(node, field, None)
            for statement in statements if isinstance(statements, list) else []:
                text = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
                if text or isinstance(statement, ast.Import | ast.ImportFrom):
                    yield block
                    block = []
                else:
                    block.append(statement)
            yield block


def repeated(files: Mapping[str, str]) -> list[str]:
    """Statements of `REPEATED_LINES` lines or more that stand in two places, by their text."""
    places: dict[str, list[str]] = {}
    for where, source in files.items():
        for block in blocks(ast.parse(source)):
            texts = [ast.unparse(statement) + "\n" for statement in block]
            for i in range(len(block)):
                text = ""
                for part in texts[i:]:
                    text += part
                    if text.count("\n") >= REPEATED_LINES:
                        places.setdefault(text, []).append(f"{where}:{block[i].lineno}")
                        break
    return [f"{first}: stands again at {', '.join(more)}" for first, *more in places.values() if more]


def repeat_faults() -> list[str]:
    """Statements that stand twice in the product."""
    return repeated({str(path.relative_to(ROOT)): path.read_text() for path in product()})


SHADOWED: set[str] = set()
"""Names of functions' own, as `path:function:name`, that hide an import of their file: no new one."""


def shadow_faults() -> list[str]:
    """Parameters and variables of a function that have the name of something the file imports at its top."""
    found = {}
    for path in product():
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
    faults = size_faults() + place_faults() + shadow_faults() + repeat_faults() + unused_faults()
    print(*faults, sep="\n", end="\n" if faults else "")
    sys.exit(bool(faults))
