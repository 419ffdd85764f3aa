"""The schemas as text: `python docs/generate/file_schemas.py` prints `docs/files.md`."""

from __future__ import annotations

import dataclasses
import inspect
from typing import Any, get_type_hints

from massprops.documents.body import BodyFile
from massprops.documents.campaign import CampaignFile
from massprops.documents.environment import EnvironmentFile
from massprops.documents.fields import field_of, inner
from massprops.documents.filter import FilterFile
from massprops.documents.limits import DEEPEST, MOST_VALUES
from massprops.documents.loading import LARGEST_BYTES
from massprops.documents.massprops_json import MassFile
from massprops.documents.model import ModelFile
from massprops.documents.sensor import CameraFile, GyroscopeFile, RangeFile
from massprops.documents.tables import CONVERTED, TABLES, Table
from massprops.simulation.scenario import Scenario
from massprops.simulation.track_scenario import TrackScenario

HEAD = f"""# Files that are read and written

Made from the schemas in `massprops/documents` by `python docs/generate/file_schemas.py`; a test holds it current.
A key without a default must be given. An unknown key is refused, with the nearest known one; in `sensor.yaml`, which
other programs write too, it is left unread with a warning unless it is nearly a known one.

YAML and JSON have at most {LARGEST_BYTES // 1_000_000} MB, {MOST_VALUES} values with every alias written out, and
{DEEPEST} levels. Whole numbers have 64 bits. Dates are text; tags are refused; a name given twice is refused.

Tables are CSV in UTF-8, with or without a byte-order mark; cells are parted by commas, or by semicolons or tabs. The
first line, after `#`, names the columns in any order, with units in brackets. Without that line, order and units are
those below. Further columns are not read. A unit that is not known is refused; these are converted:
"""


def page() -> str:
    """`docs/files.md`."""
    parts = [HEAD, *(f"- `{unit}`: {', '.join(f'`{u}`' for u in known)}" for unit, known in CONVERTED.items())]
    parts += ["\n## Tables of a sequence", *map(_table, TABLES)]
    sequence: tuple[tuple[str, Any], ...] = (
        ("camN/sensor.yaml", CameraFile), ("range0/sensor.yaml", RangeFile), ("imu0/sensor.yaml", GyroscopeFile),
        ("body.yaml", BodyFile), ("environment.yaml", EnvironmentFile),
    )  # fmt: skip
    others: tuple[tuple[str, Any], ...] = (
        ("massprops.json", MassFile), ("Filter YAML (`export --to filter`, `estimate --prior`)", FilterFile),
        ("model.yaml", ModelFile), ("Scenario with images (`simulate`)", Scenario),
        ("Scenario of tracks (`simulate`, `kind: tracks`)", TrackScenario), ("Campaign YAML", CampaignFile),
    )  # fmt: skip
    parts += ["\n## Documents of a sequence", *(_document(title, kind) for title, kind in sequence)]
    parts += ["\n## Other documents", *(_document(title, kind) for title, kind in others)]
    return "\n".join(parts).rstrip() + "\n"


def _table(table: Table) -> str:
    rows = [f"| `{c.name}` | {c.unit or '–'} | {c.about} |" for c in table.columns]
    head = [f"\n### `{table.place}`\n", f"{_sentence(table.about)}.\n", f"`{table.header}`\n"]
    return "\n".join([*head, "| column | unit | meaning |", "|---|---|---|", *rows])


def _document(title: str, kind: Any, level: int = 3) -> str:
    """A table of the document's keys, and of the documents within it."""
    lines = [f"\n{'#' * level} {title}\n", (inspect.getdoc(kind) or "").splitlines()[0] + "\n"]
    lines += ["| key | kind | unit | range | default | meaning |", "|---|---|---|---|---|---|"]
    within = []
    hints = get_type_hints(kind)
    for part in dataclasses.fields(kind):
        field = field_of(kind, part.name)
        nested = inner(hints[part.name])
        what, unit, words = ("names below", "", "") if nested else field.described()
        if nested is not None:
            within.append((part.name, nested))
        lines.append(f"| `{part.name}` | {what} | {unit} | {words} | {_default(part)} | {field.about} |")
    return "\n".join([*lines, *(_document(f"`{name}`", inside, level + 1) for name, inside in within)])


def _default(part: Any) -> str:
    if part.default is dataclasses.MISSING:
        return "must be given"
    if part.default is None:
        return "–"
    if isinstance(part.default, bool):
        return str(part.default).lower()
    return f"{list(part.default)}" if isinstance(part.default, tuple) else f"{part.default}" or "–"


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


__all__ = ["page"]

if __name__ == "__main__":
    print(page(), end="")
