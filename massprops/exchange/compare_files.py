"""What `compare` leaves on disk: the document, our mesh coloured by its distance to the CAD, and the colours' legend."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from massprops.core.files import hash_file, hash_of, json_text
from massprops.core.outputs import Outputs, deliver
from massprops.errors import InputError

if TYPE_CHECKING:
    from massprops.exchange.compare import Comparison

ON, OUTSIDE, INSIDE = (245, 245, 245), (190, 30, 45), (35, 80, 170)
"""Colours of the surface on, outside and inside the CAD's."""


OWNER = "compare"
NAMES = ("compare.json", "compare.ply", "compare_legend.png")


def check_place(folder: Path, run: Path | None, inputs: Sequence[Path], force: bool) -> None:
    """Refuses a folder that a comparison cannot go to; called before the work is done.

    Raises:
        InputError: somebody's files are there, or the results of another body.
    """
    outputs = Outputs(folder)
    outputs.check(OWNER, NAMES, inputs, force)
    if outputs.base is not None and (run is None or not run.samefile(folder)):
        raise InputError(f"{folder}: holds the results of another body: choose another place with -o")


def write_comparison(comparison: Comparison, out: str | Path, inputs: Sequence[Path] = (), force: bool = False) -> Path:
    """Writes `compare.json`, `compare.ply` and `compare_legend.png` into a folder; gives the JSON's path.

    Args:
        comparison: what was found.
        out: the folder, made when it is not there.
        inputs: the files compared.
        force: files that no `compare` wrote may be replaced.

    Raises:
        InputError: the folder holds somebody's files, or cannot be written.
    """
    folder = Path(out)
    limit = colour_limit(comparison.vertex_distance)
    mesh = comparison.mesh.copy()
    mesh.visual.vertex_colors = paint(comparison.vertex_distance / limit)
    mesh.vertex_attributes["distance"] = comparison.vertex_distance.astype(np.float32)
    contents: dict[str, str | bytes] = {
        "compare.json": json_text({**comparison.document(), "colour_limit": limit}),
        "compare.ply": mesh.export(file_type="ply"),
        "compare_legend.png": legend(limit),
    }
    key = hash_of([hash_file(path) for path in inputs])
    deliver(folder, OWNER, contents, key, inputs, force, derived=True)
    return folder / "compare.json"


def colour_limit(distance: np.ndarray) -> float:
    """Distance of the full colours, of distances (v,) [m] of the vertices: 95 % lie below it; two digits, so that the legend is exact."""
    limit = float(np.percentile(np.abs(distance), 95))
    return float(f"{limit:.2g}") if limit > 0 else 1.0


def paint(x: np.ndarray) -> np.ndarray:
    """(n, 4) uint8 colours of -1 (inside) to 1 (outside)."""
    x = np.clip(np.nan_to_num(x), -1, 1)[:, None]
    on, outside, inside = (np.array(c, float) for c in (ON, OUTSIDE, INSIDE))
    rgb = np.where(x > 0, on + x * (outside - on), on - x * (inside - on))
    return np.concatenate([np.round(rgb), np.full((len(rgb), 1), 255)], axis=1).astype(np.uint8)


def legend(limit: float) -> bytes:
    """A PNG of the colours with their distances."""
    import cv2

    bar = np.full((90, 640, 3), 255, np.uint8)
    bar[15:45, 40:600] = paint(np.linspace(-1, 1, 560))[None, :, 2::-1]
    scale, unit = (1000.0, "mm") if limit < 1 else (1.0, "m")
    ends = (f"-{limit * scale:.3g} {unit} (inside CAD)", "0", f"+{limit * scale:.3g} {unit} (outside)")
    for x, label in zip((40, 315, 440), ends, strict=True):
        cv2.putText(bar, label, (x, 70), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (40, 40, 40), 1, cv2.LINE_AA)
    return cv2.imencode(".png", bar)[1].tobytes()
