"""Where the camera was round the object, and which directions were seen."""

from __future__ import annotations

import numpy as np

from massprops.report.data import RunData
from massprops.report.html import text

TITLE, ORDER = "Camera path and coverage", 4
SEEN_WITHIN = 35.0


def coverage(
    directions: np.ndarray, within_deg: float = SEEN_WITHIN, count: int = 4000
) -> tuple[np.ndarray, np.ndarray]:
    """Which directions of the sphere lie within an angle of a view.

    Args:
        directions: (n, 3) unit vectors from the object to the cameras.
        within_deg: [deg].
        count: points on the sphere, spread evenly.

    Returns:
        sphere (count, 3) unit, seen (count,) bool.
    """
    i = np.arange(count) + 0.5
    z, turn = 1 - 2 * i / count, np.pi * (1 + 5**0.5) * i
    ring = np.sqrt(1 - z**2)
    sphere = np.column_stack([ring * np.cos(turn), ring * np.sin(turn), z])
    return sphere, (sphere @ directions.T).max(axis=1) > np.cos(np.radians(within_deg))


def render(data: RunData) -> str:
    """Top and side views of the path, and the map of directions."""
    if data.views is None or len(data.views) == 0:
        return ""
    centres = data.views.centres * data.factor
    com = data.document.get("center_of_mass")
    middle = (
        np.array(com) if com else (data.shape.vertices.mean(0) if data.shape is not None else np.median(centres, 0))
    )
    offset = centres - middle
    direction = offset / np.linalg.norm(offset, axis=1, keepdims=True)
    sphere, seen = coverage(direction)
    return (
        f'<div class="two"><div>{_path(offset, data, middle)}<p class="soft">Camera path in the mesh\'s axes: from above '
        f"(x, y) and from the side (x, z); the object in the middle. Distances in {text(data.length_unit)}.</p></div>"
        f"<div>{_map(sphere, seen, direction)}<p>{100 * seen.mean():.0f} % of all directions were seen within "
        f"{SEEN_WITHIN:.0f}°.</p><p class='soft'>Longitude and latitude in the mesh's axes; dots are the views.</p></div></div>"
    )


def _path(offset: np.ndarray, data: RunData, middle: np.ndarray) -> str:
    reach = float(np.abs(offset).max()) * 1.08 or 1.0
    parts = ['<svg viewBox="0 0 640 320" role="img" aria-label="camera path">']
    for k, (a, b) in enumerate(((0, 1), (0, 2))):
        cx = 160 + 320 * k

        def at(p: np.ndarray, a: int = a, b: int = b, cx: int = cx) -> str:
            return f"{cx + 150 * p[a] / reach:.1f},{160 - 150 * p[b] / reach:.1f}"

        if data.shape is not None:
            some = data.shape.vertices[:: max(1, len(data.shape.vertices) // 1500)] - middle
            parts += [
                f'<circle cx="{at(p).split(",")[0]}" cy="{at(p).split(",")[1]}" r="0.8" fill="currentColor" opacity="0.35"/>'
                for p in some
            ]
        parts.append(f'<polyline class="s0" opacity="0.5" points="{" ".join(at(p) for p in offset)}"/>')
        parts += [
            f'<circle cx="{at(p).split(",")[0]}" cy="{at(p).split(",")[1]}" r="2.2" fill="#d6622b"/>' for p in offset
        ]
    return "".join(parts) + "</svg>"


def _map(sphere: np.ndarray, seen: np.ndarray, direction: np.ndarray) -> str:
    def at(p: np.ndarray) -> tuple[float, float]:
        return 320 + 300 * np.arctan2(p[1], p[0]) / np.pi, 160 - 150 * np.arcsin(np.clip(p[2], -1, 1)) / (np.pi / 2)

    parts = [
        '<svg viewBox="0 0 640 320" role="img" aria-label="directions seen"><rect x="20" y="10" width="600" height="300" fill="none" class="grid"/>'
    ]
    for p, s in zip(sphere[::2], seen[::2], strict=True):
        x, y = at(p)
        parts.append(
            f'<rect x="{x - 4:.0f}" y="{y - 4:.0f}" width="8" height="8" fill="{"#2c9a57" if s else "#db382e"}" opacity="0.45"/>'
        )
    parts += ['<circle cx="{:.0f}" cy="{:.0f}" r="2.5" fill="currentColor"/>'.format(*at(p)) for p in direction]
    return "".join(parts) + "</svg>"
