"""Where the scripts of the gallery put their picture, and whether the short form is asked for."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

SHORT = bool(os.environ.get("SHORT"))
BLUE, RED, GREEN, GREY = "#1f5f99", "#b5403a", "#3a7d44", "#8a8a8a"


def save(figure) -> None:
    """Writes the picture of the script that runs."""
    folder = Path(os.environ.get("GALLERY_OUT", Path(__file__).parent / "output"))
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(
        folder / f"{Path(sys.argv[0]).stem}.png",
        dpi=90,
        bbox_inches="tight",
        pad_inches=0.3,
        metadata={"Software": None},
    )
    plt.close(figure)
