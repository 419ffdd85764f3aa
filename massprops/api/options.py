"""Options of the functions that have many, written once: names and types here, their meaning in the docstrings.

A function takes `**options: Unpack[KIND]`, so that type checkers and editors know them; `with_options` gives it the
signature that it would have were they written out, and `filled` the value of each.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from os import PathLike
from typing import TYPE_CHECKING, Any, TypedDict, TypeVar

from massprops.run.job import ReconstructOptions as _Run

if TYPE_CHECKING:
    import numpy as np

    from massprops.sequence import Environment

    Place = str | PathLike[str]
    Progress = Callable[[str, int, int], None]

Verb = TypeVar("Verb", bound=Callable[..., Any])


class ReconstructOptions(TypedDict, total=False):
    """Of `reconstruct`."""

    motion: str
    masks: Place | None
    object: str | Sequence[str]
    box: str | Sequence[str]
    keep_support: bool
    frames: int
    max_size: int
    focal: float | None
    mapper: str
    sparse: Place | None
    dense_views: int
    density: float | None
    scale: float | None
    scale_sigma: float
    distance: tuple[str, str, float] | None
    marker: str | None
    seed: int
    threads: int
    force: bool
    rate_hz: float
    progress: Progress | None


OF_RUN = {field.name: field.default for field in fields(_Run) if field.name not in ("source", "more")}
RECONSTRUCT = {**OF_RUN, "force": False, "rate_hz": 25.0}
"""Defaults; None where there is none here."""


class SimulateOptions(TypedDict, total=False):
    """Of `simulate`."""

    frames: int | None
    size: tuple[int, int] | None
    rate: float | None
    fill: float | None
    phase: float | None
    distortion: tuple[float, float] | None
    noise: float | None
    background: str | None
    stereo: float | None
    range: float | None
    hidden_mass: tuple[float, float, float, float] | None
    effects: str | Sequence[str] | None
    effect: Place | Sequence[Place] | None
    model: Place | None
    features: int | None
    sigma: float | None
    outliers: float | None
    attitude: float | None
    rates: float | None
    video: bool
    seed: int
    force: bool
    progress: Progress | None


SIMULATE = {"video": False, "seed": 0, "force": False}


class ArrayOptions(TypedDict, total=False):
    """Of `sequence_from_arrays`."""

    tracks: np.ndarray | None
    camera_matrix: np.ndarray | None
    size: tuple[int, int] | None
    distortion: Sequence[float]
    baseline: float
    sigma_px: float | None
    attitude: np.ndarray | None
    attitude_sigma: float
    rates: np.ndarray | None
    rate_sigma: float | None
    ranges: np.ndarray | None
    range_sigma: float | None
    environment: Environment | None
    out: Place | None


ARRAYS = {"distortion": (0.0, 0.0, 0.0, 0.0), "baseline": 0.0, "attitude_sigma": 0.01}


def with_options(kind: type, defaults: Mapping[str, Any]) -> Callable[[Verb], Verb]:
    """Gives a function that takes `**options` the signature with each of them, as keywords."""

    def signed(verb: Verb) -> Verb:
        plain = inspect.signature(verb)
        explicit_parameters = [p for p in plain.parameters.values() if p.kind is not p.VAR_KEYWORD]
        keywords = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=defaults.get(name), annotation=_text(type_))
            for name, type_ in kind.__annotations__.items()
        ]
        verb.__signature__ = plain.replace(parameters=[*explicit_parameters, *keywords])  # type: ignore[attr-defined]
        return verb

    return signed


def filled(verb: Callable[..., Any], options: Mapping[str, Any]) -> dict[str, Any]:
    """Every option of a function, with its default where it is not given.

    Raises:
        TypeError: an option that the function does not have.
    """
    known = inspect.signature(verb).parameters.values()
    defaults = {p.name: p.default for p in known if p.kind is p.KEYWORD_ONLY}
    for name in options:
        if name not in defaults:
            raise TypeError(f"{verb.__name__}() got an unexpected keyword argument '{name}'")
    return {**defaults, **options}


def _text(annotation: Any) -> str:
    return str(getattr(annotation, "__forward_arg__", annotation))
