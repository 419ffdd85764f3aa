"""What the file of an effect holds, and the catalogue of all effects.

An effect is one file in `dynamics/effects/` or `sensing/effects/`, named as the effect with underscores. Adding a file adds
the effect. It holds the functions by which it changes the motion or a measurement, and

- `NAME`, `SENTENCE` (for users), `FORMULA` (the same in symbols), `PARAMETERS`;
- `NOTE`: what the parameters mean, where their names do not say it;
- `NEEDS`: names of surroundings or sensors it cannot do without;
- `BODY`: names of the parameters that belong to the body and are the same in all its records, where it has such.

A user's own effect is such a file too: `--effect FILE.py` (`massprops.effect_file`) adds it for one command, an entry
point of the group `massprops.effects`, whose value is a module, for good.

Functions of the motion, component by component (`massprops.dynamics.kernels`), p a sequence of parameters, `environment` a
`massprops.dynamics.environment.EnvironmentState`; the first four are compiled as well (`massprops.dynamics.compiled_integration`):

- `torque(t, q, w, p, inertia, environment)`: external torque, body axes, over the body's mean moment [rad/s^2];
- `inertia(t, six, p)`: (Ixx, Iyy, Izz, Ixy, Ixz, Iyz) at time t in place of `six`;
- `internal(t, z, p)`: angular momentum stored inside the body; with `STATES = 3`, `internal_start(w, p)` and
  `internal_rate(t, w, z, p)` when it has three states z of its own, and `moving_inertia(six, z, p)` in place of `six` when
  they move its mass, and `internal_pace(p)`: how fast they may change [1/s]; `corners(p)`: moments at which it bends;
- `jump(p)`: momentum added at the time parameter, body axes; `swing(p)`: turn of the body at that time, body axes, its
  momentum left where it was in space; `displacement(t, p)`: what is added to the path of the
  centre of mass; `shift(t, p)`: what is added to feature points from the centre of mass, body axes;
- `penalty(p)`: numbers, linear in p, that are zero give or take 1 where the data say nothing;
- `starts(span, speed)`: parameter vectors to begin a search with, where zero will not do;
- `LAW_OF`: name of the effect of the same cause whose other law this is; it is tried where that one leads;
- `BESIDE`: name of the effect that this one is only told beside, as alone it would be the same;
- `LARGEST_TURN`: rotation [rad] within which the torque changes little, where that is less than 0.4.

Where something that an effect follows was measured beside the motion, `measured(given)` makes the effect of that record: `given`
is what was measured, plain lists and numbers that `model.yaml` can hold, and the answer is by name what takes the place of
the file's own, None for nothing (`of_record`). There a parameter in `BODY` may be a number of the body times one of the record:
`BODY_NUMBERS` has, by parameter, the name of the body's number and the record's factor.

Functions of the measurement:

- `delay(camera, row, p)`: when a row is taken, after its timestamp [s]; `turn(t, p)`: rotation vector of cam0 since
  the start, its own axes; `base(camera, t, p)`: where a camera stands; `lens(x, y, p, focal)`: image coordinates over
  depth; `range_offset(t, p)` [m].
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from types import ModuleType
from typing import Any

from massprops.effect_contract import GIVEN, KNOWN_NEEDS, Parameter, changes_motion, faults
from massprops.errors import InputError
from massprops.packaged import modules_of, packaged

_added: dict[str, ModuleType] = {}
"""Effects of the user's own files, by name."""


def effects() -> dict[str, ModuleType]:
    """Every effect by its name, those of the motion first: the catalogue's, installed packages', the user's."""
    every = {**catalogue(), **_packaged()[0], **_added}
    return dict(sorted(every.items(), key=lambda pair: not changes_motion(pair[1])))


def add(effect: ModuleType) -> None:
    """Makes an effect known to this process.

    Raises:
        InputError: another effect has its name.
    """
    known = {**catalogue(), **_packaged()[0]}
    if effect.NAME in known:
        raise InputError(f"{effect.__file__}: NAME {effect.NAME!r} is an effect of the catalogue; choose another")
    _added[effect.NAME] = effect


def of_record(effect: ModuleType, given: dict[str, Any]) -> ModuleType:
    """The effect as what was measured beside one record makes it (`measured` of its file); `GIVEN` holds that.

    Raises:
        InputError: the effect follows nothing that is measured, or `given` is not that.
    """
    make = getattr(effect, "measured", None)
    if make is None:
        raise InputError(f"effect {effect.NAME} follows nothing that is measured: leave out given")
    measured_effect = ModuleType(effect.__name__)
    try:
        parts = {**effect.__dict__, "GIVEN": given, **make(given)}
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"effect {effect.NAME}: given {error}") from None
    measured_effect.__dict__.update({k: v for k, v in parts.items() if v is not None})
    return measured_effect


@contextmanager
def in_place(modules: Iterable[ModuleType]) -> Iterator[None]:
    """These effects in place of those of their names, for as long as the context lasts."""
    before = dict(_added)
    _added.update({m.NAME: m for m in modules})
    try:
        yield
    finally:
        _added.clear()
        _added.update(before)


def remove(name: str) -> None:
    """Forgets an effect that was added."""
    _added.pop(name, None)


def is_users(effect: ModuleType) -> bool:
    """Whether an effect comes from the user or an installed package, not from massprops."""
    return catalogue().get(effect.NAME) is not effect


def refused() -> dict[str, str]:
    """Entry points of installed packages that are left out, with what is wrong with them."""
    return _packaged()[1]


@cache
def _packaged() -> tuple[dict[str, ModuleType], dict[str, str]]:
    """Effects of installed packages, entry points of the group `massprops.effects`, and those refused."""
    return packaged("massprops.effects", faults, catalogue())


@cache
def catalogue() -> dict[str, ModuleType]:
    """The effects that are files of massprops, by name."""
    rooms = ("massprops.dynamics.effects", "massprops.sensing.effects")
    return {module.NAME: module for room in rooms for module in modules_of(room)}


def searched(effect: ModuleType, form: int = 0) -> list[bool]:
    """Which of an effect's parameters are found in a form of it.

    A free turn at one moment takes up what a moment a little earlier or later, between the same two epochs, would
    change: the moment stays where the search over epochs put it.
    """
    swings = form > 0 and hasattr(effect, "swing")
    return [q.kind not in GIVEN and q.form <= form and not (q.kind == "time" and swings) for q in effect.PARAMETERS]


def of_body(effect: ModuleType) -> dict[str, tuple[str, float]]:
    """By name, an effect's parameters that belong to the body: what the body's own number is called, and its factor in this record
    (`BODY_NUMBERS`)."""
    numbers = getattr(effect, "BODY_NUMBERS", {})
    return {name: numbers.get(name, (name, 1.0)) for name in getattr(effect, "BODY", ())}


def places_of(effect: ModuleType, kind: str) -> list[int]:
    """Indices of an effect's parameters of this kind."""
    return [i for i, q in enumerate(effect.PARAMETERS) if q.kind == kind]


def has_pace(effect: ModuleType) -> bool:
    """Whether slow and fast versions of an effect can look alike."""
    return bool(places_of(effect, "pace"))


def forms(effect: ModuleType) -> int:
    """How many forms an effect has."""
    return 1 + max(int(q.form) for q in effect.PARAMETERS)


__all__ = [
    "GIVEN", "KNOWN_NEEDS", "Parameter", "add", "catalogue", "changes_motion", "effects", "forms", "has_pace", "in_place", "is_users",
    "of_body", "of_record", "places_of", "refused", "remove", "searched",
]  # fmt: skip
