"""Where the camera was round the object, and which directions were seen."""

from __future__ import annotations

import numpy as np

from massprops.geometry import vectors
from massprops.report.data import RunData
from massprops.report.html import data_uri, number, swatch, text
from massprops.report.svg import curve, dot, dots, drawing, pane, picture, words

TITLE, ORDER = "Camera path and coverage", 4
SEEN_WITHIN = 35.0
"""[deg]."""
POINTS = 4000
"""On the sphere, where what is seen is counted."""
SEEN, BARELY, UNSEEN = (0.05, 0.35, 0.52), (0.66, 0.85, 0.90), (0.93, 0.55, 0.40)
WIDE, HIGH = 640, 320


def coverage(directions: np.ndarray) -> float:
    """Share of the sphere of directions that lies within `SEEN_WITHIN` of a view; directions: (n, 3) unit vectors from the
    object to the cameras."""
    return float(((vectors.sphere(POINTS) @ directions.T).max(axis=1) > np.cos(np.radians(SEEN_WITHIN))).mean())


def render(data: RunData) -> str:
    """Three views of the path, and the map of directions."""
    centres = data.camera_centres
    if len(centres) == 0:
        return ""
    middle = data.centre if data.centre is not None else np.median(centres, axis=0)
    offset = centres - middle
    distance, direction = np.linalg.norm(offset, axis=1), vectors.unit(offset)
    tumbling = data.facts["footage"].get("motion") == "tumbling"
    whose = "The camera, seen from the turning object" if tumbling else "The camera around the object"
    unit = data.length_unit if data.document else "units of the reconstruction"
    return (
        f'<div class="two"><div><h3>Path</h3>{_path(offset, data, middle)}<p class="soft">{whose}, in the mesh\'s axes; '
        f"from the first image (blue) to the last (orange). Distance {number(distance.min(), 3)} to {number(distance.max(), 3)} {text(unit)}"
        f"{'; in 3D under “Answer”, with “cameras” on' if data.shape is not None else ''}.</p></div>"
        f"<div><h3>Directions seen: {100 * coverage(direction):.0f} %</h3>{_map(direction)}"
        f'<p class="soft keys">{swatch("#0d5985", "a view is here")}{swatch("#a8d9e6", f"{SEEN_WITHIN:.0f}° from a view")}'
        f"{swatch('#ed8c66', 'farther: seen at a steep angle or not at all')}</p><p class='soft'>Every direction from the centre of "
        "mass, on an equal-area map (Mollweide). The middle is +x, the top +z; dots are the views.</p></div></div>"
    )


def _path(offset: np.ndarray, data: RunData, middle: np.ndarray) -> str:
    reach = float(np.abs(offset).max()) * 1.1 or 1.0
    some = np.zeros((0, 3))
    if data.shape is not None:
        some = data.shape.vertices[:: max(1, len(data.shape.vertices) // 900)] - middle
    parts = []
    for k, (a, b) in enumerate(((0, 1), (0, 2), (1, 2))):
        cx = 106 + 214 * k

        def at(points: np.ndarray, a: int = a, b: int = b, cx: int = cx) -> np.ndarray:
            return np.column_stack([cx + 98 * points[:, a] / reach, 106 - 98 * points[:, b] / reach])

        parts.append(pane(cx - 104, 2, 208, 208, 6))
        parts.append(dots(at(some), 0.7, 'opacity="0.4"'))
        places = at(offset)
        parts.append(curve(places, 'class="s5" opacity="0.6"'))
        for i, (x, y) in enumerate(places):
            t = i / max(1, len(places) - 1)
            colour = f"rgb({38 + 191 * t:.0f},{115:.0f},{217 - 178 * t:.0f})"
            parts.append(dot(x, y, 2.2, f'fill="{colour}"'))
        parts.append(words(cx, 226, f"{'xyz'[a]} to the right, {'xyz'[b]} up"))
    return drawing(parts, (WIDE, 236), "camera path from three sides")


def mollweide(direction: np.ndarray) -> np.ndarray:
    """(n, 2) places of unit vectors (n, 3) on the map: x in [-2, 2], y in [-1, 1] (Snyder 1987, section 31)."""
    longitude = np.arctan2(direction[:, 1], direction[:, 0])
    latitude = np.arcsin(np.clip(direction[:, 2], -1, 1))
    theta = latitude.copy()
    for _ in range(30):
        slope = 2 + 2 * np.cos(2 * theta)
        theta -= (2 * theta + np.sin(2 * theta) - np.pi * np.sin(latitude)) / np.where(slope > 1e-9, slope, 1e9)
    return np.column_stack([2 * longitude / np.pi * np.cos(theta), np.sin(theta)])


def _from_mollweide(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(n, 3) unit vectors of places on the map."""
    theta = np.arcsin(y)
    latitude = np.arcsin(np.clip((2 * theta + np.sin(2 * theta)) / np.pi, -1, 1))
    longitude = np.pi * x / (2 * np.maximum(np.cos(theta), 1e-9))
    return np.column_stack(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)]
    )


def _map(direction: np.ndarray) -> str:
    x, y = np.meshgrid((np.arange(WIDE) + 0.5) / WIDE * 4 - 2, 1 - (np.arange(HIGH) + 0.5) / HIGH * 2)
    inside = (x / 2) ** 2 + y**2 <= 1
    unit = _from_mollweide(x[inside], y[inside])
    nearest = np.degrees(np.arccos(np.clip((unit @ direction.T).max(axis=1), -1, 1)))
    share = np.clip(nearest / SEEN_WITHIN, 0, 1)[:, None]
    seen = (1 - share) * np.array(SEEN) + share * np.array(BARELY)
    image = np.zeros((HIGH, WIDE, 4), np.uint8)
    rgb = np.where(nearest[:, None] <= SEEN_WITHIN, seen, np.array(UNSEEN))
    image[inside] = np.concatenate([255 * rgb[:, ::-1], np.full((len(rgb), 1), 255)], axis=1)
    parts = [picture(data_uri(image, "png"), WIDE, HIGH)]

    def points(unit: np.ndarray) -> np.ndarray:
        return (mollweide(unit) * [1, -1] + [2, 1]) * [WIDE / 4, HIGH / 2]

    arc = np.radians(np.linspace(-90, 90, 37))
    for longitude in np.radians([-179.99, -120, -60, 0, 60, 120, 179.99]):
        line = np.column_stack([np.cos(arc) * np.cos(longitude), np.cos(arc) * np.sin(longitude), np.sin(arc)])
        parts.append(curve(points(line), 'class="graticule"'))
    for latitude in np.radians([-60, -30, 0, 30, 60]):
        ends = np.array([[-np.cos(latitude), s * 1e-9, np.sin(latitude)] for s in (-1, 1)])
        parts.append(curve(points(ends), 'class="graticule"'))
    parts += [dot(a, b, 2.6, 'class="view"') for a, b in points(direction)]
    for name, axis in (("+x", (1, 0, 0)), ("+y", (0, 1, 0)), ("−y", (0, -1, 0)), ("+z", (0, 0, 1)), ("−z", (0, 0, -1))):
        (a, b) = points(np.array([axis], float))[0]
        shift = {"+z": -4, "−z": 13}.get(name, 4)
        parts.append(words(a, b + shift, name, style=f'class="{"pole" if name[1] == "z" else "axis"}"'))
    return drawing(parts, (WIDE, HIGH), "map of the directions seen", rim=(8, 14))
