"""The element that shows a mesh to turn: its data packed small, its buttons, its script."""

from __future__ import annotations

import json
from importlib.resources import files
from typing import Any

import numpy as np

from massprops.report.html import packed, swatch, text
from massprops.report.meshes import Shape
from massprops.report.scene import Scene, packed_scene

MARK = 'class="viewer"'
MODES = {"colour": "colour", "measured": "measured", "deviation": "deviation from CAD", "images": "number of images"}
"""What a mesh can be coloured by, and the name of the button."""
MOST_IMAGES = 12
"""Images at which the colour of `images` is full."""


def viewer(
    shape: Shape,
    centre: np.ndarray | None = None,
    axes: np.ndarray | None = None,
    others: np.ndarray | None = None,
    scene: Scene | None = None,
    limit: float | None = None,
) -> str:
    """HTML of one viewer; the page adds `script()` once.

    Args:
        shape: the mesh; its vertices are kept to 1/32767 of the body's reach.
        centre: (3,) centre of mass.
        axes: (3, 3) principal axes as columns, drawn through the centre.
        others: (3, 3) principal axes by another source as columns, drawn thinner and longer.
        scene: cameras, cloud, film.
        limit: distance to the CAD [m] of the full colours; None leaves that colouring out.
    """
    scene = Scene() if scene is None else scene
    middle = 0.5 * (shape.vertices.min(0) + shape.vertices.max(0))
    size = float(np.linalg.norm(shape.vertices - middle, axis=1).max()) or 1.0
    content = {
        **_mesh(shape, middle, size, limit),
        **packed_scene(scene, middle, size),
        "mostImages": MOST_IMAGES,
        "centre": None if centre is None else np.round((np.asarray(centre) - middle) / size, 5).tolist(),
        "axes": [] if axes is None or centre is None else np.round(np.asarray(axes).T, 6).tolist(),
        "others": [] if others is None or centre is None else np.round(np.asarray(others).T, 6).tolist(),
    }
    content["reach"] = 1.5
    if len(scene.frusta):
        content["reach"] = max(1.5, 1.02 * float(np.linalg.norm(scene.frusta - middle, axis=2).max()) / size)
    modes = _modes(shape, scene, limit)
    return (
        f'<div {MARK}><div class="stage"><canvas tabindex="0" role="img" aria-label="the mesh in 3D: arrow keys turn it, '
        'arrow keys with Shift move it, plus and minus zoom"></canvas>'
        '<img class="film" alt="the frame of the footage at this time" hidden>'
        '<p class="note" hidden>This browser cannot show 3D, because WebGL is off.</p>'
        "<noscript>The mesh cannot be shown, because scripts are off.</noscript></div>"
        f"{_controls(content, modes, scene.still)}{_keys(shape, modes, limit, bool(content['axes']))}"
        f'<script type="application/json">{json.dumps(content, allow_nan=False)}</script></div>'
    )


def _mesh(shape: Shape, middle: np.ndarray, size: float, limit: float | None) -> dict[str, Any]:
    wide = len(shape.vertices) > 65535
    closed = np.zeros(len(shape.faces), bool) if shape.inferred is None else shape.inferred
    filled = ~shape.observed & ~closed
    distance = None
    if shape.distance is not None and limit:
        share = np.clip(np.nan_to_num(shape.distance) / limit, -1, 1)
        distance = packed(np.round(share * 127).astype(np.int8))
    return {
        "vertices": packed(np.round((shape.vertices - middle) / size * 32767).astype("<i2")),
        "faces": packed(shape.faces.astype("<u4" if wide else "<u2")),
        "wide": wide,
        "filled": packed(np.packbits(filled, bitorder="little")) if filled.any() else None,
        "inferred": packed(np.packbits(closed, bitorder="little")) if closed.any() else None,
        "rgb": None if shape.rgb is None else packed(np.asarray(shape.rgb, np.uint8)),
        "distance": distance,
    }


def _modes(shape: Shape, scene: Scene, limit: float | None) -> list[str]:
    """Colourings that there is data for, the one to begin with first."""
    there = {
        "colour": shape.rgb is not None,
        "measured": True,
        "deviation": shape.distance is not None and bool(limit),
        "images": scene.seen_in is not None,
    }
    return [mode for mode in MODES if there[mode]]


def _controls(content: dict[str, Any], modes: list[str], still: bool) -> str:
    def buttons(kind: str, names: dict[str, str], pressed: str = "") -> str:
        state = {k: f' aria-pressed="{"true" if k == pressed else "false"}"' if pressed else "" for k in names}
        return "".join(f'<button type="button" data-{kind}="{k}"{state[k]}>{v}</button>' for k, v in names.items())

    parts = []
    if len(modes) > 1:
        shown = buttons("mode", {m: MODES[m] for m in modes}, modes[0])
        parts.append(f'<div class="group" role="group" aria-label="colour">{shown}</div>')
    views = {"reset": "reset view", "front": "along +y", "side": "along −x", "top": "along −z"}
    parts.append(f'<div class="group" role="group" aria-label="view direction">{buttons("view", views)}</div>')
    boxes = [("axes", "principal axes and centre of mass", True)] if content["axes"] else []
    boxes += [("cameras", "cameras", False)] if content["frusta"] else []
    boxes += [("cloud", "measured points", False)] if content["points"] else []
    parts += [
        f'<label><input type="checkbox" data-show="{key}"{" checked" if on else ""} autocomplete="off">{name}</label>'
        for key, name, on in boxes
    ]
    film = ""
    if content["film"]:
        does = "go round the object, image by image" if still else "play the motion"
        film = (
            f'<div class="controls clock"><button type="button" data-play aria-pressed="false">{does}</button>'
            f'<input type="range" min="0" max="{len(content["film"]) - 1}" value="0" step="1" autocomplete="off" '
            'aria-label="time of the footage"><output>–</output></div>'
        )
    return f'<div class="controls">{"".join(parts)}</div>{film}'


def _keys(shape: Shape, modes: list[str], limit: float | None, axes: bool) -> str:
    """A legend for each colouring; the script shows the one in use."""
    legends = {"colour": [], "measured": [swatch("#bdc4cc", "measured")], "deviation": [], "images": []}
    inferred = shape.inferred if shape.inferred is not None else np.zeros(len(shape.faces), bool)
    if not (shape.observed | inferred).all():
        legends["measured"].append(swatch("#db332a", "filled in, not measured"))
    if inferred.any():
        legends["measured"].append(swatch("#0a84e3", "closed at the plane it stood on"))
    if limit:
        end = f"{1000 * limit:g} mm" if limit < 1 else f"{limit:g} m"
        named = (
            ("#2350aa", f"{end} or more inside"),
            ("#f5f5f5", "on the CAD surface"),
            ("#be1e2d", f"{end} or more outside"),
        )
        legends["deviation"] = [swatch(colour, name) for colour, name in named]
    named = (("#db332a", "seen in no image"), ("#fbe7b2", "in few"), ("#14688c", f"in {MOST_IMAGES} or more"))
    legends["images"] = [swatch(colour, name) for colour, name in named]
    parts = []
    for mode in modes:
        hidden = "" if mode == modes[0] else " hidden"
        if legends[mode]:
            parts.append(f'<p class="soft keys" data-keys="{text(mode)}"{hidden}>{"".join(legends[mode])}</p>')
    if axes:
        named = (("#f27326", "axis of I1"), ("#40b359", "I2"), ("#4d8cfa", "I3"), ("#fac72e", "centre of mass"))
        parts.append(f'<p class="soft keys">{"".join(swatch(colour, name) for colour, name in named)}</p>')
    return "".join(parts)


def script() -> str:
    """The script that brings every viewer of a page to life."""
    return f"<script>{files(__package__).joinpath('viewer.js').read_text()}</script>"
