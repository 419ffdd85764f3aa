"""What the object may be, where nothing in the images decides: a picture of each reading, and the option that asks for it."""

from __future__ import annotations

from typing import Any

from massprops.capture.images import printable
from massprops.report.data import RunData
from massprops.report.html import data_uri, number, text

TITLE, ORDER = "Which object", 0.5


def render(data: RunData) -> str:
    """One figure for each reading of each placement; nothing where one reading fits."""
    figures, names = [], {f.get("name"): f.get("source_name") for f in data.facts["footage"].get("frames") or []}
    for placement in data.facts["shape"].get("placements") or []:
        for reading in placement.get("readings") or []:
            figures.append(_figure(data, reading, str(names.get(reading.get("image")) or reading.get("image") or "")))
    if not figures:
        return ""
    return (
        "<p>The images can be read in two ways, and nothing in them decides which is right. The numbers on this page are for "
        "the marked one. To measure the other, run the same command with the option shown below it.</p>"
        f'<div class="sheet wide">{"".join(figures)}</div>'
    )


def _figure(data: RunData, reading: dict[str, Any], name: str) -> str:
    import cv2

    path = (data.folder / "work" / "shape" / str(reading.get("picture", ""))).resolve()
    image = cv2.imread(str(path)) if (data.folder / "work" / "shape").resolve() in path.parents else None
    shown = "" if image is None else f'<img alt="{text(reading["reading"])}" src="{data_uri(image)}">'
    unit = data.length_unit if data.document else "units of the reconstruction"
    extent = " × ".join(number(float(v) * (data.factor if data.document else 1.0), 3) for v in reading["extent"])
    used = " <b>(measured here)</b>" if reading.get("used") else ""
    return (
        f"<figure>{shown}<figcaption>{text(reading['reading'])}{used}"
        f'<span class="below">{extent} {text(unit)}; in {text(printable(name))}; <code>{text(reading["option"])}</code>'
        "</span></figcaption></figure>"
    )
