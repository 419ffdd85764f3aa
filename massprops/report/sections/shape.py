"""The mesh, to turn: measured grey, filled in red, principal axes drawn."""

from __future__ import annotations

import json
from importlib.resources import files

import numpy as np

from massprops.report.data import RunData
from massprops.report.html import packed

TITLE, ORDER = "Shape", 1


def render(data: RunData) -> str:
    """The viewer with its mesh inside."""
    if data.shape is None:
        return ""
    v = data.shape.vertices
    middle = 0.5 * (v.min(0) + v.max(0))
    size = float(np.linalg.norm(v - middle, axis=1).max())
    small = np.round(np.clip((v - middle) / size, -1, 1) * 32767).astype("<i2")
    axes, centre = np.array(data.document.get("principal_axes", [])), data.document.get("center_of_mass")
    mesh = {
        "vertices": packed(small),
        "faces": packed(data.shape.faces.astype("<u4")),
        "observed": packed(data.shape.observed.astype(np.uint8)),
        "middle": [0.0, 0.0, 0.0],
        "centre": ((np.array(centre) - middle) / size).tolist() if centre else [0.0, 0.0, 0.0],
        "axes": axes.T.tolist() if axes.size == 9 else [],
    }
    script = files("massprops.report").joinpath("viewer.js").read_text()
    return (
        '<div class="viewer" id="viewer"><canvas></canvas></div>'
        '<p class="soft"><span class="swatch" style="background:#bac2c9"></span>measured'
        '<span class="swatch" style="background:#db382e"></span>filled in'
        '<span class="swatch" style="background:#f2734d"></span>axis of I1<span class="swatch" style="background:#73d973">'
        '</span>I2<span class="swatch" style="background:#73a6ff"></span>I3 · drag to turn, wheel or pinch to come closer</p>'
        f'<script type="application/json" id="mesh">{json.dumps(mesh)}</script><script>{script}</script>'
    )
