"""Puts the sections of a run into one HTML file."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any, Protocol, cast

from massprops.core.files import json_text, write_whole
from massprops.core.outputs import Outputs, claim
from massprops.packaged import modules_of
from massprops.report import sections
from massprops.report.data import RunData, read_run
from massprops.report.html import text
from massprops.report.viewer import MARK, script

OWNER = "report"
"""What the record of a folder calls the files of this page."""
UNREADABLE = "This section could not be made from the run's files"


class Section(Protocol):
    """What a file of `sections` holds: its heading, its place, and what it makes of a run, "" for nothing."""

    __name__: str
    TITLE: str
    ORDER: float

    def render(self, data: RunData) -> str:
        """HTML."""
        ...


def all_sections() -> list[Section]:
    """Every module of `sections`, by its ORDER."""
    return sorted(cast("list[Section]", modules_of(sections.__name__)), key=lambda section: section.ORDER)


def write_report(run: str | Path) -> Path:
    """Writes `report.html` of a run folder from whatever is in it.

    Args:
        run: the run folder; every file in it may be absent.

    Returns:
        the page.

    Raises:
        InputError: the folder holds a `report.html` that is not of a run, or cannot be written.
    """
    folder = Path(run)
    with claim(folder, OWNER, ["report.html"]) as outputs:
        return publish_report(outputs)


def publish_report(
    outputs: Outputs, key: str | None = None, verdict: dict[str, Any] | None = None, force: bool = False
) -> Path:
    """Writes `report.html`, and `report.json` where the verdict is given, into a folder that the caller holds."""
    data = read_run(outputs.folder)
    if verdict is None:  # the page again, of the same run: its key stays
        key = (outputs.files.get("report.json") or {"key": None})["key"]
    else:
        data = replace(data, verdict={"format": "massprops-report/1", **verdict})
    new = outputs.staging()
    if verdict is not None:
        write_whole(new / "report.json", json_text(data.verdict))
    write_whole(new / "report.html", page(data))
    outputs.publish(OWNER, key, force=force, derived=True, keep=("report.json",))
    return outputs.folder / "report.html"


def page(data: RunData) -> str:
    """The whole page as text."""
    parts = []
    for module in all_sections():
        name = module.__name__.rsplit(".", 1)[-1]
        try:
            body = module.render(data)
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            # files of a run that stopped, or that were edited by hand, must not cost the user the rest of the page
            body = f'<div class="warning">{UNREADABLE} ({text(type(error).__name__)}: {text(error)})</div>'
        parts.append((name, module.TITLE, body))
    source = (data.manifest.get("inputs") or {}).get("source")
    return of_sections(f"massprops · {data.folder.resolve().name}", parts, str(source or ""))


def of_sections(title: str, parts: Iterable[tuple[str, str, str]], subtitle: str = "") -> str:
    """A page of sections, each (anchor, heading, HTML), with links to them; those without content are left out."""
    shown = [part for part in parts if part[2]]
    body = "".join(f'<section id="{name}"><h2>{text(heading)}</h2>{inner}</section>' for name, heading, inner in shown)
    links = "".join(f'<a href="#{name}">{text(heading)}</a>' for name, heading, _ in shown)
    return document(title, body or "<section><p>This folder holds no results yet.</p></section>", links, subtitle)


def script_source(code: str) -> str:
    """Which scripts a page may run: the one of ours, by its hash, and no other that a text might smuggle in."""
    inner = code.removeprefix("<script>").removesuffix("</script>")
    digest = base64.b64encode(hashlib.sha256(inner.encode()).digest()).decode()
    return f"'sha256-{digest}'" if code else "'none'"


def document(title: str, body: str, links: str = "", subtitle: str = "") -> str:
    """A page with the house's style; no address outside the file, and a policy that forbids any."""
    style = files(__package__).joinpath("style.css").read_text()
    code = script() if MARK in body else ""
    policy = (
        f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {script_source(code)}; "
        "base-uri 'none'; form-action 'none'"
    )
    return Template(files(__package__).joinpath("page.html").read_text()).substitute(
        policy=policy,
        title=text(title),
        style=style,
        below=f'<p class="soft breaks">{text(subtitle)}</p>' if subtitle else "",
        links=links,
        body=body,
        code=code,
    )
