"""CSV: one quantity a row, with its unit and its 90 % interval."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from massprops.exchange.body import Body

NAME = "csv"
SUFFIX = ".csv"
NEEDS_METRES = False
MESHES = False


def render(body: Body, meshes: Mapping[str, str]) -> str:
    """The table as text. Inertia about the centre of mass, mesh axes, products -int x y dm."""
    lines = ["quantity,value,unit,low_90,high_90,note"]
    notes = {"mass": body.assumptions, "volume": body.remarks[1:2]}
    for name, value, unit, low, high in _rows(body):
        note = " ".join(notes.get(name, ())).replace('"', "'")
        lines.append(f"{name},{value:.17g},{unit},{low},{high}," + (f'"{note}"' if note else ""))
    return "\n".join(lines) + "\n"


def _rows(body: Body) -> Iterator[tuple[str, float, str, str, str]]:
    length, mass = ("m", "kg") if body.metric else ("model", "model mass")
    d, interval = body.document, body.document.get("interval_90", {})
    factor = body.mass / d["mass"]

    def row(
        name: str, value: float, unit: str, bounds: Any = None, scale: float = 1.0
    ) -> tuple[str, float, str, str, str]:
        low, high = ("", "") if bounds is None else (f"{scale * bounds[0]:.17g}", f"{scale * bounds[1]:.17g}")
        return name, value, unit, low, high

    yield row("volume", d["volume"], f"{length}^3", interval.get("volume"))
    yield row("mass", body.mass, mass, interval.get("mass"), factor)
    for i, axis in enumerate("xyz"):
        bounds = interval.get("center_of_mass")
        yield row(f"center_of_mass_{axis}", body.center_of_mass[i], length, bounds[i] if bounds else None)
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        bounds = interval.get("inertia")
        yield row(
            f"I_{'xyz'[i]}{'xyz'[j]}",
            body.inertia[i, j],
            f"{mass} {length}^2",
            bounds[i][j] if bounds else None,
            factor,
        )
    for i in range(3):
        bounds = interval.get("principal_moments")
        value = factor * d["principal_moments"][i]
        yield row(f"I{i + 1}", value, f"{mass} {length}^2", bounds[i] if bounds else None, factor)
    for k in ("k1", "k2"):
        yield row(k, d["inertia_ratios"][k], "1", interval.get(k))
