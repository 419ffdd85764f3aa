"""Parameters drawn at random for each run, from the run's seed and the parameter's name alone."""

from __future__ import annotations

import math
import zlib
from typing import Any

import numpy as np

from massprops.documents.fields import unknown
from massprops.documents.loading import excerpt
from massprops.errors import InputError

KINDS = {
    "uniform": "[low, high]",
    "log-uniform": "[low, high], both above 0",
    "normal": "[mean, sigma]",
    "integer": "[lowest, highest]",
    "choice": "a list of values",
}


def check_draw(where: str, name: str, draw: Any) -> None:
    """Refuses an invalid draw.

    Raises:
        InputError: not one known distribution with its numbers.
    """
    if not isinstance(draw, dict) or len(draw) != 1:
        raise InputError(
            f"{where}: draw of {excerpt(name)}: give one of {', '.join(KINDS)}, for example {{uniform: [0, 1]}}"
        )
    ((kind, values),) = draw.items()
    if kind not in KINDS:
        raise unknown(f"draw for {name} is", kind, KINDS, where)
    expected = f"{where}: draw of {excerpt(name)}: {kind} takes {KINDS[kind]}, not {excerpt(values)}"
    if not isinstance(values, list) or not values:
        raise InputError(expected)
    if kind == "choice":
        return
    if len(values) != 2 or not all(_is_number(v) for v in values):
        raise InputError(expected)
    low, high = values
    wrong = {
        "uniform": low > high,
        "log-uniform": not 0 < low <= high,
        "normal": high < 0,
        "integer": low > high or int(low) != low or int(high) != high,
    }
    if wrong[kind]:
        raise InputError(expected)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def extremes(draw: dict[str, Any]) -> list[Any]:
    """Values at which a drawn parameter is checked before any run."""
    ((kind, values),) = draw.items()
    return [values[0]] if kind == "normal" else list(values)


def drawn(draws: dict[str, Any], seed: int) -> dict[str, Any]:
    """The values of one run. Each depends on the seed and on its own name, not on what else is drawn."""
    return {
        name: _value(draw, np.random.default_rng([seed, zlib.crc32(name.encode())])) for name, draw in draws.items()
    }


def _value(draw: dict[str, Any], rng: np.random.Generator) -> Any:
    ((kind, values),) = draw.items()
    if kind == "choice":
        return values[int(rng.integers(len(values)))]
    if kind == "integer":
        return int(rng.integers(int(values[0]), int(values[1]) + 1))
    if kind == "normal":
        return float(values[0] + values[1] * rng.standard_normal())
    u = rng.random()
    if kind == "log-uniform":
        return float(values[0] * (values[1] / values[0]) ** u)
    return float(values[0] + (values[1] - values[0]) * u)
