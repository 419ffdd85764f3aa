"""How results are displayed: one line at the prompt, a small table in a notebook."""

from __future__ import annotations

import html
from typing import Any


class Displayed:
    """Gives a class a short `repr` and a table in notebooks, both made from its `facts`."""

    def facts(self) -> dict[str, str]:
        """What is shown, by name; the most important first."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {', '.join(f'{name} {value}' for name, value in self.facts().items())}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th style='text-align:left'>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>"
            for name, value in self.facts().items()
        )
        return f"<table><caption>{html.escape(type(self).__name__)}</caption>{rows}</table>"


def number(value: Any, bounds: Any = None, unit: str = "") -> str:
    """A value with its 90 % interval and unit, four digits; `-` for none."""
    if value is None:
        return "-"
    between = f" [{bounds[0]:.4g}, {bounds[1]:.4g}]" if bounds is not None else ""
    return f"{value:.4g}{between}{' ' + unit if unit else ''}"
