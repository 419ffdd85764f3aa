"""What a file must hold to be an effect (`massprops.effects` says it in words), and what is wrong with one that does not.

Every effect of the catalogue passes these checks as well as a user's own.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from massprops.documents.loading import excerpt

KNOWN_NEEDS = (
    "orbit", "sun direction", "magnetic field", "assumed inertia", "camera", "tracks", "stereo", "range", "mesh",
)  # fmt: skip
"""Words of `NEEDS`."""
KINDS = ("number", "time", "span", "duration", "direction", "pace")
GIVEN = ("span", "duration", "direction")
"""Kinds that a fit takes as they are."""
MOST_PARAMETERS = 100
EPOCHS = 5
"""Times at which functions are tried."""


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Attributes:
        name: in `model.yaml`.
        unit: SI.
        size: what is common, in that unit; scales the search.
        limit: largest plausible magnitude; None for no limit. least: smallest plausible value; None for none.
        kind: `number`; `time` for the moment of an event [s since the first timestamp]; `span` for the length of the
            record [s] and `duration` for that of an event [s], `direction` for a part
            of a direction in body axes, which are given, not found; `pace` for a number that
            means nothing while the effect has no size.
        form: 0 always found; 1 only where the simpler form of the effect leaves something over.
    """

    name: str
    unit: str
    size: float
    limit: float | None = None
    kind: str = "number"
    least: float | None = None
    form: int = 0


class _Environment(NamedTuple):
    """Surroundings to try a function in, as `massprops.dynamics.environment.EnvironmentState`."""

    position: tuple[Any, Any, Any] = (7e6, 1e5, -2e5)
    sun: tuple[float, float, float] = (0.6, 0.0, 0.8)
    field: tuple[float, float, float] = (2e-5, 1e-5, -3e-5)
    mu: float = 3.986e14


Hook = Callable[[ModuleType, Any, Any, Any, Any], Any]
HOOKS: dict[str, tuple[int, Hook]] = {
    # name: how many components it gives, and how it is called with time, attitude, rate and parameters
    "torque": (3, lambda m, t, q, w, p: m.torque(t, q, w, p, (0.9, 1.0, 1.1, 0.01, 0.0, 0.02), _Environment())),
    "inertia": (6, lambda m, t, q, w, p: m.inertia(t, (0.9, 1.0, 1.1, 0.01, 0.0, 0.02), p)),
    "internal": (3, lambda m, t, q, w, p: m.internal(t, w, p)),
    "internal_start": (3, lambda m, t, q, w, p: m.internal_start(w, p)),
    "internal_rate": (3, lambda m, t, q, w, p: m.internal_rate(t, w, w, p)),
    "moving_inertia": (6, lambda m, t, q, w, p: m.moving_inertia((0.9, 1.0, 1.1, 0.01, 0.0, 0.02), w, p)),
    "jump": (3, lambda m, t, q, w, p: m.jump(p)),
    "swing": (3, lambda m, t, q, w, p: m.swing(p)),
    "displacement": (3, lambda m, t, q, w, p: m.displacement(t, p)),
    "shift": (3, lambda m, t, q, w, p: m.shift(t, p)),
    "delay": (1, lambda m, t, q, w, p: (m.delay(0, 0.0 * t + 0.1, p),)),
    "turn": (3, lambda m, t, q, w, p: m.turn(t, p)),
    "lens": (2, lambda m, t, q, w, p: m.lens(0.01 * t, 0.02 * t, p, 1000.0)),
    "range_offset": (1, lambda m, t, q, w, p: (m.range_offset(t, p),)),
}
MOTION = ("torque", "inertia", "internal", "jump", "swing", "displacement")
"""Functions by which an effect acts on the body rather than on the sensors."""


def changes_motion(effect: ModuleType) -> bool:
    """Whether the effect acts on the body rather than on the sensors; one that needs a measurement to act follows the motion."""
    return any(hasattr(effect, f) for f in (*MOTION, "measured"))


def acts(effect: ModuleType) -> bool:
    """Whether the effect acts as it is, without what was measured beside a record."""
    return any(callable(getattr(effect, f, None)) for f in (*HOOKS, "base"))


def first_line(error: BaseException) -> str:
    """An error's kind and first line."""
    lines = str(error).splitlines()
    return f"{type(error).__name__}: {excerpt(lines[0])}" if lines else type(error).__name__


def faults(effect: ModuleType) -> str:
    """What is wrong with an effect in one line that says what to do; empty when nothing is."""
    wrong = _words(effect) or _parameters(effect)
    if wrong:
        return wrong
    used = [name for name in HOOKS if callable(getattr(effect, name, None))]
    if not acts(effect) and not callable(getattr(effect, "measured", None)):
        return f"it has none of the functions by which an effect acts: give one of {', '.join(HOOKS)}"
    for name in used:
        wrong = _result(effect, name)
        if wrong:
            return wrong
    return _columns(effect)


def is_hyphenated(name: Any) -> bool:
    """Whether a name is one of small letters and digits joined by hyphens."""
    return isinstance(name, str) and re.fullmatch(r"[a-z][a-z0-9]*(-[a-z0-9]+)*", name) is not None


def _words(effect: ModuleType) -> str:
    name = getattr(effect, "NAME", None)
    if not is_hyphenated(name) or len(str(name)) > 60:
        return "NAME must be small letters and digits joined by hyphens, such as 'sunlit-jet'"
    for word, absent in (("SENTENCE", None), ("FORMULA", ""), ("NOTE", "")):
        if not isinstance(getattr(effect, word, absent), str):
            return f"{word} must be a text"
    needs = getattr(effect, "NEEDS", None)
    if not isinstance(needs, tuple) or any(n not in KNOWN_NEEDS for n in needs):
        return f"NEEDS must be a tuple of any of: {', '.join(KNOWN_NEEDS)}; () for nothing"
    return ""


def _parameters(effect: ModuleType) -> str:
    given = getattr(effect, "PARAMETERS", None)
    if not isinstance(given, tuple) or not 0 < len(given) <= MOST_PARAMETERS:
        return f"PARAMETERS must be a tuple of 1 to {MOST_PARAMETERS} massprops.effects.Parameter"
    for q in given:
        if not isinstance(q, Parameter) or not isinstance(q.name, str) or not isinstance(q.unit, str):
            return "PARAMETERS must hold massprops.effects.Parameter(name, unit, size)"
        if not isinstance(q.size, int | float) or not np.isfinite(q.size) or q.size <= 0 or q.kind not in KINDS:
            return f"parameter {excerpt(q.name)}: size must be above 0 and kind one of {', '.join(KINDS)}"
    if len({q.name for q in given}) != len(given):
        return "two PARAMETERS have the same name"
    body = getattr(effect, "BODY", ())
    if not isinstance(body, tuple) or not set(body) <= {q.name for q in given}:
        return "BODY must be a tuple of names of PARAMETERS"
    return ""


def _tried(effect: ModuleType) -> list[tuple[str, tuple[int, ...], Any, Any, Any, Any]]:
    """Arguments that a function must take: numbers, arrays, complex numbers (for derivatives by the complex step)."""
    size = [0.5 * float(q.size) for q in effect.PARAMETERS]
    t = np.linspace(0.5, 30.0, EPOCHS)
    q = tuple(np.full(EPOCHS, v) for v in (0.5, 0.5, -0.5, 0.5))
    w = (0.1 + 0.01 * t, 0.2 - 0.01 * t, 0.05 * t)
    one: list[Any] = [tuple(float(v[1]) for v in part) for part in (q, w)]
    # what is given and not found stays a plain number
    step = [v if parameter.kind in GIVEN else v + 1e-20j for v, parameter in zip(size, effect.PARAMETERS, strict=True)]
    return [
        ("numbers", (), float(t[1]), one[0], one[1], size),
        ("arrays", (EPOCHS,), t, q, w, size),
        ("complex numbers", (), complex(t[1]), tuple(map(complex, one[0])), tuple(map(complex, one[1])), step),
    ]


def _result(effect: ModuleType, name: str) -> str:
    count, call = HOOKS[name]
    for what, shape, t, q, w, p in _tried(effect):
        try:
            got = call(effect, t, q, w, p)
        except Exception as error:  # noqa: BLE001  a user's own code
            return f"{name}() fails on {what}: {first_line(error)}"
        if not isinstance(got, tuple | list) or len(got) != count:
            return f"{name}() must give {count} components, not {excerpt(type(got).__name__)}" + (
                f" of {len(got)}" if isinstance(got, tuple | list) else ""
            )
        for part in got:
            try:
                array = np.asarray(part)
                fits = array.dtype.kind in "ifc" and array.shape in ((), shape) and bool(np.isfinite(array).all())
            except (TypeError, ValueError):
                fits = False
            if not fits:
                wanted = f"an array of {EPOCHS}" if shape else "one number"
                return f"{name}() must give finite numbers, for {what} {wanted} a component"
    return ""


def _columns(effect: ModuleType) -> str:
    """What is wrong with `momentum_columns`, `momentum_prior` and `starts`."""
    t = np.linspace(0.5, 30.0, EPOCHS)
    w = np.stack([0.1 + 0.01 * t, 0.2 - 0.01 * t, 0.05 * t], axis=1)
    if callable(getattr(effect, "momentum_columns", None)):
        names = getattr(effect, "MOMENTUM_UNKNOWNS", tuple(q.name for q in effect.PARAMETERS))
        scan = getattr(effect, "momentum_scan", lambda t, w: [{}])
        try:
            held = (list(scan(t, w)) or [{}])[0]
            parts = effect.momentum_columns(t, np.broadcast_to(np.eye(3), (EPOCHS, 3, 3)).copy(), w, held)
        except Exception as error:  # noqa: BLE001  a user's own code
            return f"momentum_columns() fails: {first_line(error)}"
        if callable(getattr(effect, "momentum_moved", None)):
            return _moved(effect, held, parts)
        wanted = (EPOCHS, 3, len(names))
        if not isinstance(parts, dict) or not parts or not set(parts) <= {"torque", "momentum", "internal", "rate"}:
            return "momentum_columns() must give a dictionary with torque, momentum, internal or rate"
        if not all(_is_columns(v, len(names)) for v in parts.values()):
            return f"momentum_columns() must give arrays of {wanted} for {EPOCHS} times"
    if callable(getattr(effect, "momentum_prior", None)):
        count = len(getattr(effect, "MOMENTUM_UNKNOWNS", effect.PARAMETERS))
        try:
            prior = np.asarray(effect.momentum_prior(), float)
        except Exception as error:  # noqa: BLE001  a user's own code
            return f"momentum_prior() fails: {first_line(error)}"
        if prior.ndim != 2 or len(prior) != count or not prior.size or not np.isfinite(prior).all():
            return f"momentum_prior() must give a matrix of finite numbers with {count} rows, one for each parameter"
    if callable(getattr(effect, "starts", None)):
        try:
            rows = list(effect.starts(30.0, 0.2))
        except Exception as error:  # noqa: BLE001  a user's own code
            return f"starts() fails: {first_line(error)}"
        if any(len(row) != len(effect.PARAMETERS) for row in rows):
            return f"starts() must give vectors of the {len(effect.PARAMETERS)} parameters"
    return ""


def _is_columns(values: Any, count: int) -> bool:
    """An array (n, 3, k), or a list of arrays (n, 3), k of them or several times as many."""
    if isinstance(values, list):
        return len(values) > 0 and len(values) % count == 0 and all(np.shape(v) == (EPOCHS, 3) for v in values)
    return bool(np.shape(values) == (EPOCHS, 3, count))


def superposes(effect: ModuleType) -> bool:
    """Whether a torque is linear in its parameters: twice one set and once another add up."""
    rng = np.random.default_rng(0)
    size = np.array([float(q.size) for q in effect.PARAMETERS])
    a, b = (size * rng.uniform(0.5, 1.5, len(size)) for _ in range(2))
    _, _, t, q, w, _ = _tried(effect)[1]

    def torque(p: np.ndarray) -> np.ndarray:
        return np.stack([np.broadcast_to(x, (EPOCHS,)) for x in HOOKS["torque"][1](effect, t, q, w, list(p))])

    left, right = torque(2.0 * a + b), 2.0 * torque(a) + torque(b)
    return bool(np.allclose(left, right, rtol=1e-9, atol=1e-12 * float(np.abs(right).max() or 1.0)))


def _moved(effect: ModuleType, held: dict[str, float], parts: Any) -> str:
    """What is wrong with `momentum_moved`, given the columns about the first values of the scan."""
    sides = list(parts.values()) if isinstance(parts, dict) else []
    count = len(sides[0]) if sides and isinstance(sides[0], list) else (np.shape(sides[0]) or (0,))[-1] if sides else 0
    if not count or not all(_is_columns(v, count) for v in sides):
        return f"momentum_columns() must give arrays of ({EPOCHS}, 3, any) for {EPOCHS} times"
    try:
        moved = effect.momentum_moved(dict(held), np.full(count, 0.1))
        fine = all(np.isfinite(moved[name]) for name in effect.MOMENTUM_UNKNOWNS)
    except Exception as error:  # noqa: BLE001  a user's own code
        return f"momentum_moved() fails: {first_line(error)}"
    return "" if fine else "momentum_moved() must give a finite number for each of MOMENTUM_UNKNOWNS"
