"""Small pieces of HTML and SVG. Everything that comes from outside goes through `text`."""

from __future__ import annotations

import base64
import html
import re
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


def unit(written: str) -> str:
    """A unit with its powers raised: s^-1 as s⁻¹."""
    return re.sub(r"\^(-?\d+)", lambda power: power[1].translate(RAISED), written)


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
    if abs(value) < 1e4 and (value == 0 or abs(value) >= 1e-3):
        return f"{value:.6g}".replace("-", "−")
    whole, times, power = number(value, 4).partition("×")
    return (whole.rstrip("0").rstrip(".") if "." in whole else whole) + times + power


def swatch(colour: str, name: str) -> str:
    """A square of a colour with its name, for legends."""
    return f'<span class="key-item"><span class="swatch" style="background:{text(colour)}"></span>{text(name)}</span>'


def data_uri(image: np.ndarray, kind: str = "jpeg", quality: int = 72) -> str:
    """An (h, w, 3 or 4) BGR image as a data address, of a JPEG of this quality or a PNG."""
    import cv2

    done, data = cv2.imencode(f".{kind}", image, [cv2.IMWRITE_JPEG_QUALITY, quality] if kind == "jpeg" else [])
    return f"data:image/{kind};base64," + base64.b64encode(data.tobytes()).decode() if done else ""


def packed(array: np.ndarray) -> str:
    """The bytes of an array of any shape in base64."""
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
