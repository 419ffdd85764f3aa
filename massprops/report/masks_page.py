"""The page of `massprops masks`: every image of a run with its silhouette laid over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from massprops.capture.images import printable
from massprops.report.html import data_uri, swatch, text
from massprops.report.outline import outlined
from massprops.report.page import document

WIDTH, LEAST_WIDTH = 480, 200
"""Of a picture [px]; where there are many, they are smaller, so that the page stays light."""
FULL = 80
"""Images up to which pictures are as wide as they may be."""
LOOK = 0.9
"""Agreement with the mesh below which a picture is marked: good silhouettes of bench scenes agree by 0.95 and more."""


@dataclass(frozen=True)
class Silhouette:
    """One image of a run.

    Attributes:
        name: of the user's file, or made of a video frame's index.
        stored: the frame's name in the run.
        file: where the mask was written, relative to the folder.
        iou: intersection over union with the final mesh, or None.
        left_out: why the image says nothing of the shape, or empty.
    """

    name: str
    stored: str
    file: str
    iou: float | None = None
    left_out: str = ""


@dataclass(frozen=True)
class Sheet:
    """What `masks` wrote: the folder, its page, the images in order, and those that the run never took in."""

    folder: Path
    page: Path
    images: list[Silhouette] = field(default_factory=list)
    refused: list[tuple[str, str]] = field(default_factory=list)


Pictures = Callable[[str], tuple[np.ndarray, np.ndarray | None]]
"""`pictures(stored)`: the frame (h, w, 3) BGR and its silhouette (h, w), None where it has none."""


def masks_page(run: str, sheet: Sheet, pictures: Pictures) -> str:
    """The whole page as text; one file, no address outside it.

    Args:
        run: the run's name.
        sheet: its silhouettes.
        pictures: asked for each of them.
    """
    shown = sheet.images
    width = max(LEAST_WIDTH, round(WIDTH * min(1.0, FULL / max(1, len(shown))) ** 0.5))
    figures = "".join(_figure(s, width, pictures) for s in shown)
    grid = f'<div class="sheet wide">{figures}</div>'
    keys = swatch("#6edc60", "silhouette") + swatch("#e63c28", "cannot tell")
    parts = [f"<section><h2>Silhouettes</h2>{_summary(sheet)}<p class='soft keys'>{keys}</p>{grid}</section>"]
    if sheet.refused:
        rows = "".join(f"<li>{text(printable(n))}: {text(why)}</li>" for n, why in sheet.refused)
        parts.append(f"<section><h2>Images that could not be read</h2><ul>{rows}</ul></section>")
    return document(f"massprops · silhouettes of {run}", "".join(parts), "", str(sheet.folder))


def _summary(sheet: Sheet) -> str:
    used = [s for s in sheet.images if not s.left_out]
    said = [f"{len(used)} of {len(sheet.images)} images say what the shape is."]
    values = np.array([s.iou for s in used if s.iou is not None])
    if len(values):
        worst = min((s for s in used if s.iou is not None), key=lambda s: s.iou or 0.0)
        said.append(
            f"Their silhouettes agree with the final mesh by {np.median(values):.3f} in the median (intersection over "
            f"union); worst is {printable(worst.name)} with {values.min():.3f}."
        )
    else:
        said.append("The run has no mesh yet to compare them with.")
    said.append(
        "To mend one, paint in its mask in this folder, white for the object and black for the rest, at the size it has; "
        "then give the folder to massprops reconstruct with --masks."
    )
    return f"<p>{text(' '.join(said))}</p>"


def _figure(s: Silhouette, width: int, pictures: Pictures) -> str:
    name = printable(s.name)
    picture = data_uri(outlined(*pictures(s.stored), width))
    if s.left_out:
        said, kind = f"left out: {s.left_out}", " class=lost"
    elif s.iou is None:
        said, kind = "", ""
    else:
        said, kind = f"agrees by {s.iou:.3f}", ""
        if s.iou < LOOK:
            said = f"<b class=bad>{text(said)}: look here</b>"
    shown = said if said.startswith("<b") else text(said)
    return (
        f'<figure{kind}><img loading="lazy" alt="{text(name)}" src="{picture}">'
        f'<figcaption title="{text(name)}">{text(name)}<span class="below">{shown}</span></figcaption></figure>'
    )
