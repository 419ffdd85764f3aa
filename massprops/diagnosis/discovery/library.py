"""The terms that a law is made of: torques in body axes over the mean moment, as expressions with units.

Each term is text, evaluated here along a path and written as it stands into the effect file of a law: there is one
version of it. Names in an expression: `w_x` rates [rad/s]; `s_x` direction of the Sun, `b_x` of the magnetic field, `n_x`
of the planet's centre, `X_x`, `Y_x`, `Z_x` the inertial axes, all in body axes; `t` time [s]; `lit(x)` is max(0, x); `begun((t-a)/h)` begins at a, within h, so that its integral over the steps of a path is
a smooth function of a.

Products of two rates are no terms: along free motion they are what a slightly different inertia would do.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from massprops.diagnosis.motion_path import MotionPath
from massprops.dynamics.environment import EnvironmentState

HELPERS = '''def lit(x):
    """max(0, x)."""
    return x * (x.real > 0)


def size(x):
    """|x|."""
    return x * (2.0 * (x.real > 0) - 1.0)


def begun(x):
    """0 before -1/2, 1 from 1/2 on, straight between."""
    return (x + 0.5) * (abs(x.real) < 0.5) + 1.0 * (x.real >= 0.5)
'''
"""What expressions call, as text for the effect file."""
PRELUDE = {
    "w": "w_x, w_y, w_z = w",
    "s": "s_x, s_y, s_z = to_body(*q, *environment.sun)",
    "b": "b_x, b_y, b_z = to_body(*q, *unit(*environment.field))",
    "n": "n_x, n_y, n_z = to_body(*q, *unit(*(-c for c in environment.position)))",
    "X": "X_x, X_y, X_z = to_body(*q, 1.0, 0.0, 0.0)",
    "Y": "Y_x, Y_y, Y_z = to_body(*q, 0.0, 1.0, 0.0)",
    "Z": "Z_x, Z_y, Z_z = to_body(*q, 0.0, 0.0, 1.0)",
}
"""How the names of an expression come about, by their first letter."""
UNIT = '''def unit(x, y, z):
    """A vector of length 1."""
    length = (x * x + y * y + z * z) ** 0.5
    return x / length, y / length, z / length
'''
NEED = {"s": "sun direction", "b": "magnetic field", "n": "orbit"}
XYZ = "xyz"
PLAIN = "rad s^-2"
HARMONICS = (0.5, 1.0, 2.0)
STEPS = 20
STEP = "step"
"""Kind of terms that begin at a moment."""


@dataclass(frozen=True)
class LibraryTerm:
    """A torque by one coefficient.

    Attributes:
        label: for people; torque: expressions of its three components; unit: of the coefficient. moment: at which it begins
            [s], or None. same: labels of terms that are equal to this one along a path (`told_apart`), with their sign.
    """

    label: str
    torque: tuple[str, str, str]
    unit: str
    moment: float | None = None
    same: tuple[str, ...] = ()

    @property
    def axis(self) -> str:
        """Along which it acts."""
        return self.label.rpartition(" along ")[2]


@dataclass(frozen=True)
class Group:
    """Terms that enter a law together first; the needless of them leave it afterwards.

    Attributes:
        kind: of groups alike but for which axis, face or moment they are of. least: whether a coefficient below zero is
            impossible.
    """

    label: str
    terms: tuple[LibraryTerm, ...]
    kind: str
    least: bool = False


def library(
    known: set[str], span: float, frequencies: tuple[float, ...], steps: tuple[float, ...], gap: float
) -> list[Group]:
    """Every group of terms for what is known of the surroundings.

    Args:
        known: words of `NEED`. span: of the record [s]. frequencies: of the body's own motion [rad/s]. steps: times at
            which something may begin [s]. gap: between measurements [s].
    """
    there = {letter for letter, need in NEED.items() if need in known}
    out = [_along_body(*scalar) for scalar in _scalars(there, span, frequencies)]
    out += [_along_inertial(*scalar) for scalar in _times(span, frequencies)]
    for at in steps:
        begins = f"begun((t-{at:.6g})/{gap:.6g})"
        out += [_along_body(begins, PLAIN, STEP, at), _along_inertial(begins, PLAIN, STEP, at)]
    out += _drag()
    for letter, what in (("s", "the Sun"), ("b", "the field"), ("n", "the planet")):
        if letter in there:
            out.append(_across(letter, what))
    return out


def _scalars(there: set[str], span: float, frequencies: tuple[float, ...]) -> list[tuple[str, str, str]]:
    """Expressions of one number, the units of a coefficient before them, and their kind."""
    out = _times(span, frequencies)
    out += [(f"w_{a}", "s^-1", "rate") for a in XYZ]
    out += [(f"w_{a}*size(w_{a})", "rad^-1", "rate squared") for a in XYZ]
    # before the directions: where a face is always lit, what is kept says nothing of a Sun behind it
    if "s" in there:
        lights = [f"lit({sign}s_{a})" for a in XYZ for sign in ("", "-")]
        out += [(x, PLAIN, "light") for x in lights] + [(f"{x}**2", PLAIN, "light squared") for x in lights]
        out += [(f"{x}*w_{a}", "s^-1", "light rate") for x in lights for a in XYZ]
    directions = [letter for letter in "sbn" if letter in there]
    for letter in directions:
        v = [f"{letter}_{a}" for a in XYZ]
        out += [(x, PLAIN, letter) for x in v]
        out += [(f"{v[i]}*{v[j]}", PLAIN, f"{letter} {letter}") for i in range(3) for j in range(i, 3)]
        out += [(f"{x}*w_{a}", "s^-1", f"{letter} rate") for x in v for a in XYZ]
    return out


def _times(span: float, frequencies: tuple[float, ...]) -> list[tuple[str, str, str]]:
    """Expressions of time alone, as in `_scalars`."""
    out = [("1.0", PLAIN, "constant"), (f"(t/{span:.6g})", PLAIN, "trend")]
    for f in frequencies:
        out += [(f"{wave}({f:.6g}*t)", PLAIN, "wave") for wave in ("np.sin", "np.cos")]
    return out


def _along_body(f: str, unit: str, kind: str, moment: float | None = None) -> Group:
    """A torque fixed in the body, as strong as a number."""
    terms = []
    for k, a in enumerate(XYZ):
        torque = tuple(f if i == k else "0.0" for i in range(3))
        terms.append(LibraryTerm(f"{readable(f)} along {a}", torque, unit, moment))  # type: ignore[arg-type]
    return Group(f"{readable(f)} in body axes", tuple(terms), kind)


def _along_inertial(f: str, unit: str, kind: str, moment: float | None = None) -> Group:
    """A torque fixed in space, as strong as a number."""
    terms = []
    for axis in "XYZ":
        torque = tuple(f"{axis}_{a}*{f}" for a in XYZ)
        terms.append(LibraryTerm(f"{readable(f)} along inertial {axis}", torque, unit, moment))  # type: ignore[arg-type]
    return Group(f"{readable(f)} in inertial axes", tuple(terms), f"inertial {kind}")


def _drag() -> list[Group]:
    """Torques against the rate as a whole, which cannot drive it."""
    size = "(w_x*w_x+w_y*w_y+w_z*w_z)**0.5"
    return [
        Group("-w", (LibraryTerm("-w", ("-w_x", "-w_y", "-w_z"), "s^-1"),), "drag", least=True),
        Group(
            "-|w| w",
            (LibraryTerm("-|w| w", (f"-w_x*{size}", f"-w_y*{size}", f"-w_z*{size}"), "rad^-1"),),
            "drag",
            least=True,
        ),
    ]


def _across(letter: str, what: str) -> Group:
    """A vector fixed in the body, crossed with a direction: a dipole, a lever of light."""
    x, y, z = (f"{letter}_{a}" for a in XYZ)
    crossed = ((f"0.0*{x}", f"-{z}", y), (z, f"0.0*{y}", f"-{x}"), (f"-{y}", x, f"0.0*{z}"))
    terms = tuple(LibraryTerm(f"{a} x {letter}", torque, "rad s^-2") for a, torque in zip(XYZ, crossed, strict=True))
    return Group(f"a body vector x direction of {what}", terms, "crossed")


def readable(expression: str) -> str:
    """An expression as a formula for people."""
    out = (
        re.sub(r"begun\(\(t-([^)]*)\)/[^)]*\)", r"(t>\1)", expression)
        .replace("np.", "")
        .replace("*1.0", "")
        .replace("**2", "^2")
    )
    out = out.replace("lit(", "max(0, ").replace("size(", "|").replace("*", " ")
    if "|" in out:
        head, _, tail = out.partition("|")
        out = head + "|" + tail.replace(")", "|", 1)
    return "1" if out == "1.0" else out


def letters_of(expressions: tuple[str, ...]) -> set[str]:
    """First letters of the names in expressions that `PRELUDE` makes."""
    letters = set(re.findall(r"\b([wsbnXYZ])_[xyz]\b", " ".join(expressions)))
    return letters


def columns_of(
    terms: list[LibraryTerm], path: MotionPath, rate: np.ndarray, environment: EnvironmentState | None
) -> np.ndarray:
    """(n, 3, k) torques of unit coefficients along a path; rate (n, 3) the rates to take [rad/s]."""
    from massprops.dynamics.kernels import to_body

    names: dict[str, Any] = {
        "np": np, "to_body": to_body, "t": path.t, "q": tuple(path.q.T), "w": tuple(rate.T), "environment": environment,
    }  # fmt: skip
    used = letters_of(tuple(x for term in terms for x in term.torque))
    # text of our own making alone: no word of it comes from a file or a user
    exec(HELPERS + UNIT + "\n".join(PRELUDE[letter] for letter in sorted(used)), names)  # noqa: S102
    values: dict[str, np.ndarray] = {}
    out = np.zeros((len(path.t), 3, len(terms)))
    for k, term in enumerate(terms):
        for i, x in enumerate(term.torque):
            if x not in values:
                values[x] = eval(x, names)  # noqa: S307
            out[:, i, k] = values[x]
    return out


def told_apart(groups: list[Group], torques: np.ndarray) -> tuple[list[Group], np.ndarray]:
    """The groups that are not zero along a path, those that are equal there in one, and their torques.

    A face that always sees the Sun has light equal to the Sun's component, and its square equal to the component's.

    Args:
        torques: (n, 3, k) of the groups' terms, one after the other.
    """
    kept: dict[bytes, tuple[Group, np.ndarray]] = {}
    at = 0
    for group in groups:
        group_torques = torques[:, :, at : at + len(group.terms)]
        at += len(group.terms)
        if not group_torques.any():
            continue
        sign = np.sign(group_torques.flat[np.flatnonzero(group_torques)[0]])
        key = (sign * group_torques + 0.0).tobytes()
        if key not in kept:
            kept[key] = group, group_torques
            continue
        first, there = kept[key]
        minus = "" if np.array_equal(group_torques, there) else "-"
        both = zip(first.terms, (minus + t.label for t in group.terms), strict=True)
        terms = tuple(t if o in (t.label, *t.same) else replace(t, same=(*t.same, o)) for t, o in both)
        kept[key] = replace(first, terms=terms), there
    return [group for group, _ in kept.values()], np.concatenate([x for _, x in kept.values()], axis=2)


def own_frequencies(times: np.ndarray, rate: np.ndarray) -> tuple[float, ...]:
    """The two strongest frequencies [rad/s] of the rates (m, 3) at times (m,), and their halves and doubles."""
    span = float(times[-1] - times[0])
    trial = 2 * np.pi / span * np.arange(1.0, min(len(times) / 2, 200.0), 0.25)
    x = rate - rate.mean(axis=0)
    x = x * np.hanning(len(times))[:, None]
    strongest: list[float] = []
    for _ in range(2):
        wave = np.exp(-1j * trial[:, None] * times)
        power = np.sum(np.abs(wave @ x) ** 2, axis=1)
        for f in strongest:
            power[np.abs(trial - f) < 4 * np.pi / span * 2] = 0.0
        if not power.max() > 0:
            break
        strongest.append(float(trial[np.argmax(power)]))
    speed = float(np.median(np.linalg.norm(rate, axis=1)))
    every = [h * f for f in (*strongest, speed) for h in HARMONICS]
    apart: list[float] = []
    for f in sorted(every):
        if f * span > np.pi and all(abs(f - g) * span > 1.0 for g in apart):
            apart.append(f)
    return tuple(apart)
