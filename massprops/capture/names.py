"""Names under which frames are stored: the file's own where every tool can read it, else one like it.

COLMAP's lists of pairs are split at spaces, and few tools agree on anything beyond ASCII. A frame is therefore stored
under letters, digits, `.`, `_` and `-` alone; `footage.json` keeps the user's name beside it.
"""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path

LONGEST = 100
"""Characters of a stored name: `NAME.png` must still fit into the 255 bytes of most file systems."""


def stored_names(names: list[str]) -> list[str]:
    """A name for every frame, different from the others even where upper and lower case are one.

    `Photo 001.jpg` becomes `Photo_001.jpg`; formats that are not kept become PNG: `a.heic` is stored as `a.heic.png`.
    A name that is fit as it is stays, whatever the others would like to be called.

    Args:
        names: of the files.
    """
    wanted = [_wish(name) for name in names]
    out: list[str] = [""] * len(names)
    taken: set[str] = set()
    for fit in (True, False):
        for i, (name, wish) in enumerate(zip(names, wanted, strict=True)):
            if out[i] or (fit and (wish != name or wish.lower() in taken)):
                continue
            stem, ending, number = Path(wish).stem, Path(wish).suffix, 2
            while wish.lower() in taken:
                wish, number = f"{stem}-{number}{ending}", number + 1
            out[i] = wish
            taken.add(wish.lower())
    return out


def _wish(name: str) -> str:
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    ending = Path(name).suffix.lower()
    kept = ending in (".png", ".jpg", ".jpeg")
    stem = plain[: -len(ending)] if kept else plain
    stem = re.sub(r"[^A-Za-z0-9._-]+", "_", stem)[-LONGEST:].lstrip("._-")
    if not kept and stem.lower() == ending.lstrip("."):
        stem = ""
    stem = stem or "image"
    return stem + plain[-len(ending) :] if kept else f"{stem}.png"
