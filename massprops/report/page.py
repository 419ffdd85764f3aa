"""Puts the sections of a run into one HTML file."""

from __future__ import annotations

import pkgutil
from importlib import import_module
from importlib.resources import files
from pathlib import Path
from types import ModuleType

from massprops.report import sections
from massprops.report.data import RunData, read_run
from massprops.report.html import text
from massprops.run.files import write_whole


def all_sections() -> list[ModuleType]:
    """Every module of `sections`, by its ORDER."""
    found = [import_module(f"{sections.__name__}.{m.name}") for m in pkgutil.iter_modules(sections.__path__)]
    return sorted(found, key=lambda module: module.ORDER)


def write_report(run: str | Path) -> Path:
    """Writes `report.html` of a run folder from whatever is in it.

    Args:
        run: the run folder; every file in it may be absent.

    Returns:
        the page.
    """
    folder = Path(run)
    path = folder / "report.html"
    write_whole(path, page(read_run(folder)))
    return path


def page(data: RunData) -> str:
    """The whole page as text."""
    parts, links = [], []
    for module in all_sections():
        body = module.render(data)
        if not body:
            continue
        name = module.__name__.rsplit(".", 1)[-1]
        parts.append(f'<section id="{name}"><h2>{text(module.TITLE)}</h2>{body}</section>')
        links.append(f'<a href="#{name}">{text(module.TITLE)}</a>')
    return document(f"massprops · {data.folder.resolve().name}", "".join(parts), "".join(links))


def document(title: str, body: str, links: str = "") -> str:
    """A page with the house's style; no address outside the file."""
    style = files(__package__).joinpath("style.css").read_text()
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{text(title)}</title><style>{style}</style></head><body>"
        f"<header><h1>{text(title)}</h1><nav>{links}</nav></header><main>{body}</main></body></html>"
    )
