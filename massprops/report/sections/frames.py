"""Contact sheet: frames with their silhouettes."""

from __future__ import annotations

import numpy as np

from massprops.report.data import RunData
from massprops.report.html import data_uri, text

TITLE, ORDER = "Frames and silhouettes", 3
MOST, WIDTH = 24, 220


def render(data: RunData) -> str:
    """Up to `MOST` frames, object outlined, doubt tinted."""
    import cv2

    capture = data.folder / "work" / "capture"
    frames = data.facts["footage"].get("frames", [])
    if not frames:
        return ""
    registered = set(data.views.names) if data.views is not None else set()
    chosen = [frames[i] for i in np.unique(np.linspace(0, len(frames) - 1, MOST).astype(int))]
    figures = []
    for frame in chosen:
        image = cv2.imread(str(capture / "frames" / frame["name"]))
        if image is None:
            continue
        factor = WIDTH / image.shape[1]
        image = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
        for folder in (data.folder / "work" / "silhouettes" / "masks", data.folder / "masks", capture / "masks"):
            mask = cv2.imread(str(folder / f"{frame['name']}.png"), cv2.IMREAD_GRAYSCALE)
            if mask is not None:
                _outline(cv2, image, cv2.resize(mask, image.shape[1::-1], interpolation=cv2.INTER_NEAREST))
                break
        note = frame["name"].split("/")[-1] + (
            "" if frame["name"] in registered or not registered else " · not registered"
        )
        figures.append(
            f'<figure><img alt="{text(note)}" src="{data_uri(image)}"><figcaption>{text(note)}</figcaption></figure>'
        )
    kind = data.facts["footage"]
    said = f"{kind.get('used', '?')} of {kind.get('given', '?')} frames used; taken as {kind.get('motion')}: {kind.get('motion_reason')}."
    return f'<p class="soft">{text(said)}</p><div class="sheet">{"".join(figures)}</div>'


def _outline(cv2, image: np.ndarray, mask: np.ndarray) -> None:  # type: ignore[no-untyped-def]
    doubt = mask == 128
    image[doubt] = (0.6 * image[doubt] + 0.4 * np.array([60, 60, 200])).astype(np.uint8)
    lines, _ = cv2.findContours((mask == 255).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(image, lines, -1, (90, 220, 90), 1)
