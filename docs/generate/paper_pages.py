"""The papers: title, DOI, and what is reproduced of each, from their files."""

from __future__ import annotations

import inspect

from massprops.campaigns.papers import load_paper, references
from massprops.campaigns.papers._references import Reference


def _doi(reference: Reference) -> str:
    if not reference.doi:
        return ""
    return f" DOI [{reference.doi}](https://doi.org/{reference.doi})."


def pages() -> dict[str, str | bytes]:
    parts = [
        "# The papers",
        "",
        "`massprops reproduce PAPER CASE` runs a case and prints our numbers beside those of the paper. The results are in "
        "[all measurements](measurements.md#the-papers).",
        "",
    ]
    for name, reference in references().items():
        paper = load_paper(name)
        said = inspect.getdoc(paper).split("\n", 1)
        parts += [
            f"## {name}",
            "",
            f"{reference.authors}: *{reference.title}*. {reference.journal} ({reference.year})." + _doi(reference),
            "",
            said[1].strip() if len(said) > 1 else "",
            "",
            "| case | what | runs |",
            "|---|---|---|",
            *(f"| `{case}` | {what} | {paper.RUNS[case]} |" for case, what in paper.CASES.items()),
            "",
        ]
    return {"papers.md": "\n".join(parts)}
