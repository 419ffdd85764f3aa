"""Where metres come from: one source a file, found by the name of the file.

A source is a module with `estimate(inputs: ScaleInputs) -> ScaleEstimate | None`; None when it was not asked for or
the footage has none. One model unit is the greatest length of the object's mesh, the largest distance between two of
its points. An installed package brings a source by an entry point of the group `massprops.scale_sources`, a module that
has a `NAME` besides.
"""

from functools import cache
from importlib import import_module
from typing import Protocol, cast

from massprops.packaged import Wanted, faults_by, is_text, names_of, packaged, takes
from massprops.sfm.scale._base import Scale, ScaleEstimate, ScaleInputs, choose

__all__ = ["Scale", "ScaleEstimate", "ScaleInputs", "choose", "find_scale", "sources"]

WANTED: Wanted = {"estimate": takes(1)}


class Source(Protocol):
    """What such a file holds."""

    def estimate(self, inputs: ScaleInputs) -> ScaleEstimate | None:
        """See the top of this file."""
        ...


@cache
def sources() -> dict[str, Source]:
    """Every source by its name."""
    built_in = {name: import_module(f"{__name__}.{name}") for name in names_of(__name__)}
    by_name = built_in | packaged("massprops.scale_sources", faults_by({"NAME": is_text, **WANTED}), built_in)[0]
    return cast("dict[str, Source]", by_name)


def find_scale(inputs: ScaleInputs) -> Scale:
    """Asks every source and keeps the most precise.

    Raises:
        InputError: a source was asked for with values that cannot be used.
    """
    estimates = [source.estimate(inputs) for source in sources().values()]
    return choose([f for f in estimates if f is not None], inputs.length)
