"""The schemas as text: `python docs/generate/file_schemas.py` prints `docs/files.md`."""

from __future__ import annotations

import dataclasses
import inspect
import sys
from pathlib import Path
from typing import Any, get_type_hints

sys.path.insert(0, str(Path(__file__).parent))

from result_files import text

from massprops.documents.body import BodyFile
from massprops.documents.campaign import CampaignFile
from massprops.documents.environment import EnvironmentFile
from massprops.documents.fields import field_of, inner
from massprops.documents.filter import FilterFile
from massprops.documents.limits import DEEPEST, MOST_VALUES
from massprops.documents.loading import LARGEST_BYTES
from massprops.documents.massprops_json import MassFile
from massprops.documents.model import ModelFile
from massprops.documents.sensor import CameraFile, GyroscopeFile, RangeFile, RotorFile
from massprops.documents.tables import CONVERTED, TABLES, Table
from massprops.simulation.scenario import Scenario
from massprops.simulation.track_scenario import TrackScenario

HEAD = f"""# Files and fields

This page is generated from the schemas in `massprops/documents`, which also check the files, by `python
docs/generate/file_schemas.py`.

A key without a default must be given. An unknown key is an error, and the message names the nearest known key. The exception is
`sensor.yaml`, which other programs write as well: there an unknown key is ignored with a warning, unless it looks like a
misspelt one.

YAML and JSON files may have at most {LARGEST_BYTES // 1_000_000} MB, {MOST_VALUES} values (counting every alias) and {DEEPEST}
levels. Integers have 64 bits. Dates are read as text. Tags, and names that occur twice, are errors.

Tables are CSV files in UTF-8, with or without a byte-order mark, separated by commas, semicolons or tabs. The first line, after
`#`, names the columns in any order, with units in brackets. Without that line, order and units must be those below. Other
columns are ignored. An unknown unit is an error. These units are converted:
"""


def page() -> str:
    """`docs/files.md`."""
    parts = [HEAD, *(f"- `{unit}`: {', '.join(f'`{u}`' for u in known)}" for unit, known in CONVERTED.items())]
    parts += ["\n" + text()]
    parts += ["\n## Tables of a sequence", *map(_table, TABLES)]
    sequence: tuple[tuple[str, Any], ...] = (
        ("camN/sensor.yaml", CameraFile), ("range0/sensor.yaml", RangeFile), ("imu0/sensor.yaml", GyroscopeFile),
        ("rotor0/sensor.yaml", RotorFile),
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
