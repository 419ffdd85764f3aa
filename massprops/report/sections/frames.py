"""Contact sheet: frames with their silhouettes."""

from __future__ import annotations

import numpy as np

from massprops.capture.images import printable
from massprops.report.data import RunData
from massprops.report.html import data_uri, swatch, text
from massprops.report.thumbnail import thumbnail
from massprops.sfm.footage import frame_file, mask_file, silhouette_file

TITLE, ORDER = "Frames and silhouettes", 3
MOST, WIDTH = 24, 280


def render(data: RunData) -> str:
    """Up to `MOST` frames, object outlined, doubt tinted."""
    footage = data.facts["footage"]
    frames = footage.get("frames") or []
    if not frames:
        return ""
    registered = set(data.views.names) if data.views is not None else set()
    chosen = [frames[i] for i in np.unique(np.linspace(0, len(frames) - 1, MOST).astype(int))]
    figures = []
    for frame in chosen:
        image = _thumbnail(data, str(frame["name"]))
        if image is None:
            continue
        lost = bool(registered) and frame["name"] not in registered
        stamp = frame.get("timestamp_ns", -1)
        note = _short(printable(str(frame.get("source_name") or frame["name"]))) + (
            f" · {stamp / 1e9:.2f} s" if stamp >= 0 else ""
        )
        figures.append(
            f'<figure{" class=lost" if lost else ""}><img loading="lazy" alt="{text(note)}" src="{data_uri(image)}">'
            f'<figcaption title="{text(note)}">{"not placed · " if lost else ""}{text(note)}</figcaption></figure>'
        )
    summary = f"{footage.get('used', len(frames))} of {footage.get('given', len(frames))} frames used"
    if footage.get("motion"):
        means = {
            "tumbling": "the object turns in front of a still camera",
            "static": "the camera moves around a still object",
        }
        summary += f"; kind of motion: {footage['motion']}, {means.get(footage['motion'], '')}"
    if footage.get("motion_reason"):
        summary += f" ({footage['motion_reason']})"
    if left_out := footage.get("left_out"):
        summary += ". Left out: " + ", ".join(f"{printable(e['source_name'])} ({e['reason']})" for e in left_out)
    keys = swatch("#6edc60", "silhouette") + swatch("#e63c28", "unclear: may be an unlit part of the object")
    return f'<p>{text(summary)}.</p><p class="soft keys">{keys}</p><div class="sheet">{"".join(figures)}</div>'


def _short(name: str) -> str:
    """The file's name; of long ones, such as nanoseconds, the leading zeros or the beginning left out."""
    stem, dot, suffix = name.rsplit("/", 1)[-1].rpartition(".")
    if len(stem) > 12:
        stem = stem.lstrip("0") or "0" if stem.isdigit() else f"…{stem[-11:]}"
    return stem + dot + suffix


def _thumbnail(data: RunData, name: str) -> np.ndarray | None:
    import cv2

    work = data.folder / "work"
    image = cv2.imread(str(frame_file(work, name)))
    if image is None:
        return None
    for path in (silhouette_file(work, name), mask_file(work, name)):
        mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.is_file() else None
        if mask is not None:
            return thumbnail(image, mask, WIDTH)
    return thumbnail(image, None, WIDTH)
