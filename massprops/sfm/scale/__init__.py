"""Where metres come from: one source a file, found by the name of the file.

A source is a module with `estimate(inputs: ScaleInputs) -> ScaleEstimate | None`; None when it was not asked for or
the footage has none. One model unit is the greatest length of the object's mesh, the largest distance between two of
its points.
"""

from massprops.sfm.scale.base import Scale, ScaleEstimate, ScaleInputs, choose

__all__ = ["Scale", "ScaleEstimate", "ScaleInputs", "choose", "find_scale", "sources"]


def sources() -> tuple[str, ...]:
    """Names of all sources."""
    from pathlib import Path

    folder = Path(__file__).parent
    return tuple(sorted(p.stem for p in folder.glob("*.py") if p.stem not in ("__init__", "base")))


def find_scale(inputs: ScaleInputs) -> Scale:
    """Asks every source and keeps the most precise.

    Raises:
        InputError: a source was asked for with values that cannot be used.
    """
    from importlib import import_module

    found = [import_module(f"massprops.sfm.scale.{name}").estimate(inputs) for name in sources()]
    return choose([f for f in found if f is not None], inputs.length)
