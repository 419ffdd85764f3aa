"""The functions of the package, from their signatures and docstrings."""

from __future__ import annotations

import inspect
import re
from functools import cached_property
from importlib import import_module
from types import FunctionType

import massprops

FIRST = (
    "reconstruct",
    "open_run",
    "mass_properties",
    "estimate",
    "sequence_from_arrays",
    "crosscheck",
    "diagnose",
    "compare",
    "export",
)
"""What most look for; the others follow."""
RESULTS = (
    ("massprops.run.reconstruct", "Run"),
    ("massprops.api.results", "Solid"),
    ("massprops.api.results", "Estimates"),
    ("massprops.estimators.result", "Estimate"),
    ("massprops.consistency.crosscheck", "CrossCheck"),
    ("massprops.api.results", "Diagnosis"),
    ("massprops.exchange.compare", "Comparison"),
    ("massprops.api.results", "Simulation"),
    ("massprops.api.results", "Campaign"),
)
"""What the functions return: module and class, in the order of the functions."""


def pages() -> dict[str, str | bytes]:
    parts = [
        "# Python",
        "",
        "The functions of `massprops` do what the commands do, with the same options and defaults. They take files or "
        "arrays. Without `out`, nothing stays on disk. Errors are `massprops.InputError` (the input is wrong) and "
        "`massprops.NotPossible` (the data cannot give the result).",
        "",
    ]
    for name in dict.fromkeys((*FIRST, *massprops.__all__)):
        function = getattr(massprops, name)
        if isinstance(function, FunctionType):
            parts += section(name, function)
    parts += ["## What the functions return", ""]
    for module, name in RESULTS:
        parts += result(getattr(import_module(module), name))
    return {"python.md": "\n".join(parts) + "\n"}


def result(kind: type) -> list[str]:
    """The attributes and methods of a result, its own first and then those that it inherits."""
    lead, _, rest = (inspect.getdoc(kind) or "").partition("\nAttributes:\n")
    said = {m[1]: " ".join(m[2].split()) for m in re.finditer(r"^    (\w+): (.*(?:\n {8}.*)*)", rest, re.M)}
    listed = {name: words for name, words in said.items() if name not in HIDDEN}
    for owner in kind.__mro__:
        if not owner.__module__.startswith("massprops"):
            continue
        for name, value in vars(owner).items():
            shown = isinstance(value, FunctionType | property | cached_property)
            if name.startswith("_") or not shown or name in (*listed, *HIDDEN):
                continue
            call = (
                f"({', '.join(list(inspect.signature(value).parameters)[1:])})"
                if isinstance(value, FunctionType)
                else ""
            )
            listed[name + call] = (inspect.getdoc(value) or "").split("\n\n")[0].replace("\n", " ")
    rows = [f"| `{name}` | {(w[:1].upper() + w[1:]).replace('|', chr(92) + '|')} |" for name, w in listed.items() if w]
    return [f"### {kind.__name__}", "", " ".join(lead.split()), "", "| attribute | |", "|---|---|", *rows, ""]


HIDDEN = ("facts", "write", "kept", "outcome")
"""Of use to the package alone."""


def section(name: str, function: FunctionType) -> list[str]:
    doc = inspect.getdoc(function)
    lead, _, rest = doc.partition("\nArgs:\n")
    parameters = inspect.signature(function).parameters
    lines = [f"## {name}", "", lead.strip(), "", "| argument | default | |", "|---|---|---|"]
    for entry in re.finditer(r"^    (\w+): (.*(?:\n {8}.*)*)", rest.partition("\n\n")[0], re.M):
        default = parameters[entry[1]].default
        shown = "" if default is inspect.Parameter.empty else f"`{default!r}`"
        text = " ".join(entry[2].split()).replace("|", "\\|")
        lines.append(f"| `{entry[1]}` | {shown} | {text} |")
    for title in ("Returns", "Raises"):
        found = re.search(rf"^{title}:\n((?:    .*\n?)+)", doc, re.M)
        if found:
            lines += ["", f"**{title}** " + " ".join(found[1].split())]
    example = re.search(r"^Example:\n((?:    .*\n?)+)", doc, re.M)
    if example:
        code = re.sub(r"\s+# doctest: \+SKIP", "", inspect.cleandoc(example[1]))
        lines += ["", "```python", code, "```"]
    return [*lines, ""]
