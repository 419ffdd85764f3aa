"""The page of `massprops masks`: every image of a run with its silhouette laid over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from massprops.capture.images import printable
from massprops.report.html import data_uri, swatch, text
from massprops.report.page import of_sections
from massprops.report.thumbnail import thumbnail

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
    keys = swatch("#6edc60", "silhouette") + swatch("#e63c28", "unclear")
    rows = "".join(f"<li>{text(printable(n))}: {text(why)}</li>" for n, why in sheet.refused)
    parts = (
        ("silhouettes", "Silhouettes", f"{_summary(sheet)}<p class='soft keys'>{keys}</p>{grid}"),
        ("refused", "Images that could not be read", f"<ul>{rows}</ul>" if rows else ""),
    )
    return of_sections(f"massprops · silhouettes of {run}", parts, str(sheet.folder))


def _summary(sheet: Sheet) -> str:
    used = [s for s in sheet.images if not s.left_out]
    sentences = [f"{len(used)} of {len(sheet.images)} images were used for the shape."]
    values = np.array([s.iou for s in used if s.iou is not None])
    if len(values):
        worst = min((s for s in used if s.iou is not None), key=lambda s: s.iou or 0.0)
        sentences.append(
            f"Agreement of their silhouettes with the final mesh (intersection over union): median {np.median(values):.3f}, "
            f"worst {values.min():.3f} in {printable(worst.name)}."
        )
    else:
        sentences.append("The run has no mesh to compare them with.")
    sentences.append(
        "To correct one, paint its mask in this folder: white for the object, black for the rest. Keep the size of the "
        "image. Then run massprops reconstruct again with --masks and this folder."
    )
    return f"<p>{text(' '.join(sentences))}</p>"


def _figure(s: Silhouette, width: int, pictures: Pictures) -> str:
    name = printable(s.name)
    picture = data_uri(thumbnail(*pictures(s.stored), width))
    if s.left_out:
        verdict, kind = f"left out: {s.left_out}", " class=lost"
    elif s.iou is None:
        verdict, kind = "", ""
    else:
        verdict, kind = f"agreement {s.iou:.3f}", ""
        if s.iou < LOOK:
            verdict = f"<b class=bad>{text(verdict)}, please check</b>"
    shown = verdict if verdict.startswith("<b") else text(verdict)
    return (
        f'<figure{kind}><img loading="lazy" alt="{text(name)}" src="{picture}">'
        f'<figcaption title="{text(name)}">{text(name)}<span class="below">{shown}</span></figcaption></figure>'
    )
