"""One page a script of the gallery: what it says, its code, what it printed, its picture."""

from __future__ import annotations

import ast
from pathlib import Path

SECTION = "Gallery"
FOLDER = Path(__file__).parents[1] / "gallery"


def scripts() -> list[Path]:
    return sorted(p for p in FOLDER.glob("[0-9]*.py"))


def title(path: Path) -> str:
    return ast.get_docstring(ast.parse(path.read_text())).split("\n")[0].rstrip(".")


def nav() -> list[dict[str, str]]:
    return [{title(p): f"gallery/{p.stem}.md"} for p in scripts()]


def pages() -> dict[str, str | bytes]:
    made: dict[str, str | bytes] = {"gallery/index.md": overview()}
    for path in scripts():
        text = path.read_text()
        doc = ast.get_docstring(ast.parse(text))
        lead, _, rest = doc.partition("\n")
        code = text[text.index('"""', 3) + 3 :].strip()
        printed = (FOLDER / "output" / f"{path.stem}.txt").read_text().rstrip()
        made[f"gallery/{path.stem}.md"] = (
            f"# {lead.rstrip('.')}\n\n{rest.strip()}\n\n![{lead}](output/{path.stem}.png)\n\n"
            f"```text\n{printed}\n```\n\n```python\n{code}\n```\n"
        )
    return made


def overview() -> str:
    lines = [
        "# Gallery",
        "",
        "Scripts that run as they are. `make gallery` runs all of them and makes these pictures; "
        "`make gallery SHORT=1` runs a short form of each.",
        "",
    ]
    for path in scripts():
        lines += [f"## [{title(path)}]({path.stem}.md)", "", f"![{title(path)}](output/{path.stem}.png)", ""]
    return "\n".join(lines)
