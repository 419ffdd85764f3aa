"""The element that shows a mesh to turn: its data packed small, its buttons, its script."""

from __future__ import annotations

import json
from importlib.resources import files

import numpy as np

from massprops.report.html import packed

MARK = 'class="viewer"'


def viewer(
    vertices: np.ndarray,
    faces: np.ndarray,
    observed: np.ndarray | None = None,
    distance: np.ndarray | None = None,
    centre: np.ndarray | None = None,
    axes: np.ndarray | None = None,
    cameras: np.ndarray | None = None,
    others: np.ndarray | None = None,
) -> str:
    """HTML of one viewer; the page adds `script()` once.

    Args:
        vertices: (v, 3) any unit; kept to 1/32767 of the body's reach.
        faces: (f, 3).
        observed: (f,) bool; faces that were filled in are red.
        distance: (v,) -1 (inside, blue) to 1 (outside, red), in place of `observed`.
        centre: (3,) centre of mass.
        axes: (3, 3) principal axes as columns, drawn through the centre.
        cameras: (n, 3) camera centres, drawn on request.
        others: (3, 3) principal axes by another source as columns, drawn thinner and longer.
    """
    middle = 0.5 * (vertices.min(0) + vertices.max(0))
    size = float(np.linalg.norm(vertices - middle, axis=1).max()) or 1.0
    wide = len(vertices) > 65535
    places = np.zeros((0, 3)) if cameras is None else (cameras - middle) / size
    has_filled = observed is not None and not observed.all()
    content = {
        "vertices": packed(np.round((vertices - middle) / size * 32767).astype("<i2")),
        "faces": packed(faces.astype("<u4" if wide else "<u2")),
        "wide": wide,
        "filled": packed(np.packbits(~observed, bitorder="little")) if observed is not None and has_filled else None,
        "distance": None
        if distance is None
        else packed(np.round(np.clip(np.nan_to_num(distance), -1, 1) * 127).astype(np.int8)),
        "centre": None if centre is None else np.round((np.asarray(centre) - middle) / size, 5).tolist(),
        "axes": [] if axes is None or centre is None else np.round(np.asarray(axes).T, 6).tolist(),
        "others": [] if others is None or centre is None else np.round(np.asarray(others).T, 6).tolist(),
        "cameras": np.round(places, 4).tolist(),
        "reach": max(1.5, float(np.linalg.norm(places, axis=1).max()) * 1.02) if len(places) else 1.5,
    }
    boxes = [("filled", "filled parts in red", True)] if has_filled else []
    boxes += [("axes", "principal axes, centre of mass", True)] if content["axes"] else []
    boxes += [("cameras", "camera path", False)] if len(places) else []
    switches = "".join(
        f'<label><input type="checkbox" data-show="{key}"{" checked" if on else ""} autocomplete="off">{name}</label>'
        for key, name, on in boxes
    )
    views = "".join(
        f'<button type="button" data-view="{key}">{name}</button>'
        for key, name in (("reset", "start"), ("front", "along +y"), ("side", "along −x"), ("top", "along −z"))
    )
    return (
        f'<div {MARK}><div class="stage"><canvas tabindex="0" role="img" aria-label="the mesh in 3D; arrow keys turn it">'
        '</canvas><p class="note" hidden>This browser shows no 3D: WebGL is off.</p>'
        "<noscript>Scripts are off: the mesh cannot be shown.</noscript></div>"
        f'<div class="controls">{views}{switches}</div>'
        f'<script type="application/json">{json.dumps(content, allow_nan=False)}</script></div>'
    )


def script() -> str:
    """The script that brings every viewer of a page to life."""
    return f"<script>{files(__package__).joinpath('viewer.js').read_text()}</script>"
