"""What an effect says about itself, and how the catalogue of effects is found.

An effect is one file in `dynamics/effects/` or `sensing/effects/`, named as the effect with underscores. It holds
`NAME`, `SENTENCE` (for users), `PARAMETERS`, `NEEDS` (names of surroundings or sensors it cannot do without) and the
functions by which it changes the motion or a measurement. Adding a file adds the effect.

Functions of the motion, component by component (`massprops.dynamics.kernels`), p a sequence of parameters, `around` a
`massprops.dynamics.surroundings.Sky`; the first four are compiled as well (`massprops.dynamics.march`):

- `torque(t, q, w, p, inertia, around)`: external torque, body axes, over the body's mean moment [rad/s^2];
- `inertia(t, six, p)`: (Ixx, Iyy, Izz, Ixy, Ixz, Iyz) at time t in place of `six`;
- `internal(t, z, p)`: angular momentum stored inside the body; with `STATES = 3`, `internal_start(w, p)` and
  `internal_rate(t, w, z, p)` when it has three states z of its own; `corners(p)`: moments at which it bends;
- `jump(p)`: momentum added at the time parameter, body axes; `swing(p)`: turn of the body at that time, body axes, its
  momentum left where it was in space; `displacement(t, p)`: what is added to the path of the
  centre of mass; `shift(t, p)`: what is added to feature points from the centre of mass, body axes;
- `penalty(p)`: numbers, linear in p, that are zero give or take 1 where the data say nothing;
- `starts(span, speed)`: parameter vectors to begin a search with, where zero will not do.

Functions of the measurement:

- `delay(camera, row, p)`: when a row is taken, after its timestamp [s]; `turn(t, p)`: rotation vector of cam0 since
  the start, its own axes; `base(camera, t, p)`: where a camera stands; `lens(x, y, p, focal)`: image coordinates over
  depth; `range_offset(t, p)` [m].
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Attributes:
        name: in `model.yaml`.
        unit: SI.
        size: what is common, in that unit; scales the search.
        limit: largest plausible magnitude; None for no limit. least: smallest plausible value; None for none.
        kind: `number`; `time` for the moment of an event [s since the first timestamp]; `span` for the length of the
            record [s] and `duration` for that of an event [s], which are given, not found; `pace` for a number that means nothing while the effect has no size.
        form: 0 always found; 1 only where the simpler form of the effect leaves something over.
    """

    name: str
    unit: str
    size: float
    limit: float | None = None
    kind: str = "number"
    least: float | None = None
    form: int = 0


GIVEN = ("span", "duration")
"""Kinds of parameters that a search over starts takes as they are."""


@cache
def effects() -> dict[str, ModuleType]:
    """Every effect by its name: those of the motion first."""
    found: dict[str, ModuleType] = {}
    for room in ("dynamics", "sensing"):
        folder = Path(__file__).parent / room / "effects"
        for path in sorted(folder.glob("*.py")):
            if not path.stem.startswith("_"):
                module = import_module(f"massprops.{room}.effects.{path.stem}")
                found[module.NAME] = module
    return found


def searched(effect: ModuleType, form: int = 0) -> list[bool]:
    """Which of an effect's parameters are found in a form of it.

    A free turn at one moment takes up what a moment a little earlier or later, between the same two epochs, would
    change: the moment stays where the search over epochs put it.
    """
    swings = form > 0 and hasattr(effect, "swing")
    return [q.kind not in GIVEN and q.form <= form and not (q.kind == "time" and swings) for q in effect.PARAMETERS]


def places_of(effect: ModuleType, kind: str) -> list[int]:
    """Which of an effect's parameters are of this kind."""
    return [i for i, q in enumerate(effect.PARAMETERS) if q.kind == kind]


def paced(effect: ModuleType) -> bool:
    """Whether slow and fast versions of an effect can look alike."""
    return bool(places_of(effect, "pace"))


def forms(effect: ModuleType) -> int:
    """How many forms an effect has."""
    return 1 + max(q.form for q in effect.PARAMETERS)


def changes_motion(effect: ModuleType) -> bool:
    """Whether the effect acts on the body rather than on the sensors."""
    return any(hasattr(effect, f) for f in ("torque", "inertia", "internal", "jump", "swing", "displacement"))
