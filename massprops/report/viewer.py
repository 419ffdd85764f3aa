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
    inferred: np.ndarray | None = None,
    rgb: np.ndarray | None = None,
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
        inferred: (f,) bool; faces that were closed at the plane of support are blue, not red.
        rgb: (v, 3) uint8 photographs' colours, shown on request in place of where each face comes from.
        others: (3, 3) principal axes by another source as columns, drawn thinner and longer.
    """
    middle = 0.5 * (vertices.min(0) + vertices.max(0))
    size = float(np.linalg.norm(vertices - middle, axis=1).max()) or 1.0
    wide = len(vertices) > 65535
    places = np.zeros((0, 3)) if cameras is None else (cameras - middle) / size
    closed = np.zeros(len(faces), bool) if inferred is None else inferred
    filled = np.zeros(len(faces), bool) if observed is None else ~observed & ~closed
    has_filled, has_closed = bool(filled.any()), bool(closed.any())
    content = {
        "vertices": packed(np.round((vertices - middle) / size * 32767).astype("<i2")),
        "faces": packed(faces.astype("<u4" if wide else "<u2")),
        "wide": wide,
        "filled": packed(np.packbits(filled, bitorder="little")) if has_filled else None,
        "inferred": packed(np.packbits(closed, bitorder="little")) if has_closed else None,
        "rgb": None if rgb is None else packed(np.asarray(rgb, np.uint8)),
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
    if has_closed:
        boxes = [("filled", "filled parts in red, inferred in blue", True)]
    boxes += [("photo", "colours of the photographs", False)] if rgb is not None else []
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
