"""The functions of the package, from their signatures and docstrings."""

from __future__ import annotations

import inspect
import re
from types import FunctionType

import massprops

FIRST = (
    "reconstruct",
    "mass_properties",
    "estimate",
    "sequence_from_arrays",
    "crosscheck",
    "diagnose",
    "compare",
    "export",
)
"""What most look for; the others follow."""


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
    return {"python.md": "\n".join(parts) + "\n"}


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
