"""Small pieces of HTML and SVG. Everything that comes from outside goes through `text`."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence

import numpy as np


def text(value: object) -> str:
    """Escaped text."""
    return html.escape(str(value))


def table(
    rows: Iterable[Sequence[object]],
    head: Sequence[object] = (),
    numeric: Sequence[int] | None = None,
    label: str = "table",
) -> str:
    """A table of plain or `Safe` cells; columns in `numeric` are set right, all but the first when None.

    On a narrow screen a wide one is moved sideways, also by the keyboard; label: what it is, for those who listen.
    """

    def line(cells: Sequence[object], tag: str) -> str:
        parts = []
        for i, cell in enumerate(cells):
            right = i > 0 if numeric is None else i in numeric
            content = cell.content if isinstance(cell, Safe) else text(cell)
            parts.append(f"<{tag}{' class=n' if right else ''}>{content}</{tag}>")
        return f"<tr>{''.join(parts)}</tr>"

    top = f"<thead>{line(head, 'th')}</thead>" if head else ""
    return f'<div class="scroll" tabindex="0" role="group" aria-label="{text(label)}"><table>{top}<tbody>{"".join(line(r, "td") for r in rows)}</tbody></table></div>'


class Safe:
    """HTML that is already escaped."""

    def __init__(self, content: str) -> None:
        self.content = content


RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float | None, digits: int = 5) -> str:
    """A number for people: significant digits, a true minus sign, powers of ten only where zeros would hide it."""
    if value is None or not np.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    power = int(np.floor(np.log10(abs(value))))
    if -4 <= power < max(digits, 6):
        rounded = f"{value:.{max(0, digits - 1 - power)}f}" if power < digits else f"{value:.0f}"
        return rounded.replace("-", "−")
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}×10{str(int(exponent)).translate(RAISED)}".replace("-", "−")


def between(bounds: Sequence[float] | None, digits: int = 5) -> str:
    """An interval."""
    return "–" if not bounds else f"{number(bounds[0], digits)} … {number(bounds[1], digits)}"


def round_marks(low: float, high: float) -> list[float]:
    """Three to seven round numbers between two."""
    rough = (high - low) / 4
    power = 10.0 ** np.floor(np.log10(rough))
    step = power * next(m for m in (1, 2, 5, 10) if m * power >= 0.8 * rough)
    marks = np.arange(np.ceil(low / step), np.floor(high / step) + 1)
    return [float(m * step) + 0.0 for m in marks]  # no minus zero


def mark(value: float) -> str:
    """A round number at an axis, without zeros that say nothing."""
    return number(value, 4) if abs(value) >= 1e4 or 0 < abs(value) < 1e-3 else f"{value:.6g}".replace("-", "−")


def swatch(colour: str, name: str) -> str:
    """A square of a colour with its name, for legends."""
    return f'<span class="key-item"><span class="swatch" style="background:{text(colour)}"></span>{text(name)}</span>'


def data_uri(image: np.ndarray, quality: int = 72) -> str:
    """An (h, w, 3) BGR image as a JPEG data address."""
    import cv2

    done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode() if done else ""


def packed(array: np.ndarray) -> str:
    """The bytes of an array in base64."""
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()


def plot(
    series: Sequence[tuple[str, np.ndarray, np.ndarray]],
    x_label: str,
    y_label: str,
    width: int = 640,
    height: int = 240,
    bands: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]] = (),
) -> str:
    """A line plot as inline SVG: series of (name, x, y), bands of (x, low, high)."""
    xs = np.concatenate([np.asarray(s[1], float) for s in series]) if series else np.zeros(1)
    values = [np.asarray(s[2], float) for s in series] + [np.asarray(v, float) for b in bands for v in b[1:]]
    ys = np.concatenate(values) if values else np.zeros(1)
    ys = ys[np.isfinite(ys)]
    if len(ys) == 0 or len(xs) == 0:
        return ""
    x0, x1 = float(xs.min()), float(xs.max())
    y0, y1 = float(ys.min()), float(ys.max())
    x1, pad = (x1 if x1 > x0 else x0 + 1), 0.05 * (y1 - y0) or 0.5 * abs(y0) or 0.5
    y0, y1 = y0 - pad, y1 + pad
    left, right, top, bottom = 80, 12, 10, 34

    def px(x: np.ndarray) -> np.ndarray:
        return left + (np.asarray(x, float) - x0) / (x1 - x0) * (width - left - right)

    def py(y: np.ndarray) -> np.ndarray:
        return top + (y1 - np.clip(np.asarray(y, float), y0, y1)) / (y1 - y0) * (height - top - bottom)

    parts = [
        f'<svg class="plot" viewBox="0 0 {width} {height}" role="img" aria-label="{text(y_label)} over {text(x_label)}">'
    ]
    for tick in round_marks(y0, y1):
        up = float(py(np.array(tick)))
        parts.append(f'<line class="grid" x1="{left}" x2="{width - right}" y1="{up:.1f}" y2="{up:.1f}"/>')
        parts.append(f'<text x="{left - 6}" y="{up + 4:.1f}" text-anchor="end">{mark(tick)}</text>')
    for tick in round_marks(x0, x1):
        along = float(px(np.array(tick)))
        parts.append(f'<text x="{along:.1f}" y="{height - bottom + 16}" text-anchor="middle">{mark(tick)}</text>')
    for x, low, high in bands:
        upper = [f"{a:.1f},{b:.1f}" for a, b in zip(px(x), py(high), strict=True)]
        lower = [f"{a:.1f},{b:.1f}" for a, b in zip(px(x)[::-1], py(low)[::-1], strict=True)]
        parts.append(f'<polygon class="band" points="{" ".join(upper + lower)}"/>')
    for k, (_name, x, y) in enumerate(series):
        good = np.isfinite(np.asarray(y, float))
        path = " ".join(
            f"{a:.1f},{b:.1f}" for a, b in zip(px(np.asarray(x)[good]), py(np.asarray(y)[good]), strict=True)
        )
        parts.append(f'<polyline class="s{k % 8}" points="{path}"/>')
    parts.append(f'<text x="{(left + width) / 2:.0f}" y="{height - 4}" text-anchor="middle">{text(x_label)}</text>')
    parts.append(
        f'<text transform="translate(14 {height / 2:.0f}) rotate(-90)" text-anchor="middle">{text(y_label)}</text></svg>'
    )
    legend = "".join(f'<span class="key s{k % 8}">{text(name)}</span>' for k, (name, _, _) in enumerate(series) if name)
    return "".join(parts) + (f'<div class="legend">{legend}</div>' if legend else "")
