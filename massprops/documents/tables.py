"""The tables of a sequence: columns, units and ranges of every `data.csv`, and the units that are converted."""

from __future__ import annotations

from dataclasses import dataclass, field

TIME = {"ns": 1.0, "us": 1e3, "µs": 1e3, "μs": 1e3, "ms": 1e6, "s": 1e9}
LENGTH = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3}
DEGREE = 0.017453292519943295
ANGLE = {"rad": 1.0, "mrad": 1e-3, "deg": DEGREE, "°": DEGREE, "arcmin": DEGREE / 60, "arcsec": DEGREE / 3600}
RATE = {f"{name} s^-1": size for name, size in ANGLE.items()} | {
    "rpm": 6 * DEGREE,
    "rev s^-1": 360 * DEGREE,
    "deg h^-1": DEGREE / 3600,
    "hz": 360 * DEGREE,
}
CONVERTED = {
    "ns": TIME,
    "m": LENGTH,
    "rad": ANGLE,
    "rad s^-1": RATE,
    "m s^-2": {"m s^-2": 1.0},
    "px": {"px": 1.0, "pixel": 1.0, "pixels": 1.0},
}
"""By the documented unit: units that a header may name instead, and how many of the documented one each is."""
NO_UNIT = {"": 1.0, "1": 1.0, "-": 1.0}


@dataclass(frozen=True)
class Column:
    """One column. unit: as documented, empty for none; text: not a number; others: names in other programs' files."""

    name: str
    unit: str = ""
    about: str = ""
    text: bool = False
    others: tuple[str, ...] = ()
    low: float = float("-inf")
    high: float = float("inf")

    @property
    def title(self) -> str:
        """The column's cell in a header."""
        plain = self.text or (not self.unit and not self.name.startswith("q_"))
        return self.name if plain else f"{self.name} [{self.unit}]"

    def factor(self, unit: str | None) -> float | None:
        """What a value in `unit` is multiplied by; None for a unit that is not known. No unit is the documented one."""
        if unit is None:
            return 1.0
        return CONVERTED.get(self.unit, NO_UNIT).get(normalised_unit(unit))


@dataclass(frozen=True)
class Table:
    """One `data.csv`, by its columns in the documented order."""

    place: str
    about: str
    columns: tuple[Column, ...] = field(default_factory=tuple)

    @property
    def header(self) -> str:
        """The header line."""
        return "#" + ",".join(c.title for c in self.columns)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(c.name for c in self.columns)


def normalised_unit(unit: str) -> str:
    """A unit in one spelling: `deg/s`, `deg*s^-1` and `Deg s-1` are `deg s^-1`."""
    text = " ".join(unit.replace("·", " ").replace("*", " ").split()).casefold()
    top, slash, bottom = text.partition("/")
    if slash and bottom:
        text = f"{top.strip()} {bottom.strip()}^-1"
    return text.replace("s-1", "s^-1").replace("degrees", "deg").replace("radians", "rad").replace("meters", "m")


STAMP = Column("timestamp", "ns", "time of the row", others=("time", "t"), low=-(2.0**62), high=2.0**62)
QUATERNION = tuple(Column(f"q_{a}", "", "Hamilton, unit", low=-2, high=2) for a in "wxyz")
RATES = tuple(
    Column(f"w_{a}", "rad s^-1", "angular velocity, body axes", others=(f"w_RS_S_{a}",), low=-1e5, high=1e5)
    for a in "xyz"
)

IMAGES = Table(
    "camN/data.csv", "images of a camera", (STAMP, Column("filename", "", "file in `camN/data/`", text=True))
)
TRACKS = Table(
    "tracks0/data.csv",
    "feature points followed through the images",
    (
        STAMP,
        Column("camera", "", "0 or 1"),
        Column("feature", "", "whole number, the same physical point for ever"),
        Column("u", "px", "to the right"),
        Column("v", "px", "down"),
    ),
)
RANGE = Table(
    "range0/data.csv",
    "distance from cam0's centre to the target's centre of mass",
    (STAMP, Column("range", "m", "distance", low=-1e15, high=1e15)),
)
GYROSCOPE = Table("imu0/data.csv", "body rates; further columns are not read", (STAMP, *RATES))
ROTOR = Table(
    "rotor0/data.csv",
    "a wheel inside the body whose rate was measured",
    (STAMP, Column("rate", "rad s^-1", "rate of the wheel against the body, about its axis", low=-1e6, high=1e6)),
)
ATTITUDE = Table(
    "attitude0/data.csv",
    "rotation of body vectors into the camera frame cam0",
    (STAMP, *QUATERNION, Column("sigma", "rad", "1-sigma of the rotation, about each axis", low=0, high=1e3)),
)
ACCELEROMETER = Table(
    "imu0/data.csv",
    "specific force beside the body rates, where there is any: whether the record is free flight",
    (STAMP, *(Column(f"a_{a}", "m s^-2", "specific force, body axes", others=(f"a_RS_S_{a}",)) for a in "xyz")),
)
STATE = Table(
    "truth/state_groundtruth_estimate0/data.csv",
    "true motion of a simulated body; no estimator reads it",
    (STAMP, *(Column(f"p_{a}", "m", "centre of mass in cam0") for a in "xyz"), *QUATERNION, *RATES),
)
TABLES = (IMAGES, TRACKS, RANGE, GYROSCOPE, ROTOR, ATTITUDE, STATE)
