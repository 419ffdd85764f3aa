"""The results of the functions: a few attributes that people want, a short line at the prompt, a report."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from massprops.core.displayed import Displayed, number
from massprops.errors import InputError
from massprops.mass.measured import Measured

if TYPE_CHECKING:
    import numpy as np
    import trimesh

    from massprops.estimators.outcome import Outcome
    from massprops.estimators.result import Estimate
    from massprops.sequence import Sequence as Recording
    from massprops.sequence.truth import Truth


class Kept:
    """A folder that exists as long as this object: the caller's own, or a temporary one."""

    def __init__(self, folder: Path | None = None) -> None:
        self.spare = None if folder is not None else tempfile.TemporaryDirectory(prefix="massprops-")
        self.folder = Path(self.spare.name if self.spare is not None else folder or "")

    def facts(self) -> dict[str, str]:
        """The folder, where it is the caller's own."""
        return {"folder": str(self.folder)} if self.spare is None else {}


class _Reported(Displayed):
    """A result whose page is written when it is first asked for, where no folder was given."""

    folder: Path | None
    write: Callable[[Path], Any]

    def report(self) -> Path:
        """The path of the report of this result. If you gave no folder, it is removed together with this object."""
        if self.folder is not None:
            return self.folder / "report.html"
        return self._temporary_folder / "report.html"

    @cached_property
    def _temporary_folder(self) -> Path:
        kept = Kept()
        self.__dict__["_kept"] = kept
        self.write(kept.folder / "result")
        return kept.folder / "result"


@dataclass(frozen=True, repr=False)
class Solid(Measured):
    """Mass properties of a finished mesh.

    Attributes:
        mesh: the body as it was measured, in metres.
        document: as `massprops.json`.
    """

    mesh: trimesh.Trimesh
    document: dict[str, Any]

    @property
    def properties(self) -> dict[str, Any]:
        """As `massprops.json`."""
        return self.document

    @property
    def warnings(self) -> list[str]:
        """One line each."""
        return list(self.document["warnings"])


@dataclass(frozen=True, repr=False)
class Estimates(_Reported, Sequence["Estimate"]):
    """One `Estimate` per method that ran, by index or by name. `k1`, `k2` and `interval` are those of the best one.

    Attributes:
        outcome: also contains which methods were skipped, and the verdict on the prior.
        folder: with `estimates.json`, None where none was given.
        write: writes them into a folder.
    """

    outcome: Outcome
    folder: Path | None
    write: Callable[[Path], Any] = field(repr=False)

    @overload
    def __getitem__(self, key: int | str) -> Estimate: ...
    @overload
    def __getitem__(self, key: slice) -> list[Estimate]: ...
    def __getitem__(self, key: int | str | slice) -> Estimate | list[Estimate]:
        if not isinstance(key, str):
            return self.outcome.estimates[key]
        for one in self.outcome.estimates:
            if one.name == key:
                return one
        raise KeyError(f"{key}: not among {[e.name for e in self]}")

    def __len__(self) -> int:
        return len(self.outcome.estimates)

    @property
    def best(self) -> Estimate | None:
        """The smoother if it is reliable, else the first method that is; None if none is."""
        sound = self.outcome.sound
        return next((e for e in sound if e.name == "smoother"), sound[0] if sound else None)

    @property
    def verdict(self) -> str:
        """`observable`, or `unobservable` if no method gives the ratios; see `reason`."""
        return "observable" if self.best is not None else "unobservable"

    @property
    def reason(self) -> str:
        """Why no method gives the ratios; empty if one does."""
        return self.outcome.reason

    @property
    def k1(self) -> float | None:
        """ln(I1/I2)."""
        return None if self.best is None else self.best.k1

    @property
    def k2(self) -> float | None:
        """ln(I2/I3)."""
        return None if self.best is None else self.best.k2

    @property
    def interval(self) -> dict[str, np.ndarray]:
        """90 % intervals of `k1` and `k2`, each (2,)."""
        return {} if self.best is None else self.best.interval

    @property
    def inertia(self) -> np.ndarray | None:
        """(3, 3) in body axes, with trace 1 because the motion shows no scale."""
        return None if self.best is None else self.best.inertia

    def facts(self) -> dict[str, str]:
        """The best one's ratios, then which others ran."""
        if self.best is None:
            return {"verdict": self.verdict, "reason": self.reason}
        return {**self.best.facts(), "of": ", ".join(e.name for e in self)}


@dataclass(frozen=True, repr=False)
class Diagnosis(_Reported):
    """Which effect is missing in the model.

    Attributes:
        document: as `diagnosis.json`.
        model: as `model.yaml`: the model with the effect.
        folder: with these files, None where none was given.
        write: writes them into a folder.
    """

    document: dict[str, Any]
    model: dict[str, Any]
    folder: Path | None
    write: Callable[[Path], Any] = field(repr=False)

    @property
    def verdict(self) -> str:
        """`none`, `named`, `ambiguous` or `unexplained`."""
        return str(self.document["verdict"])

    @property
    def reason(self) -> str:
        """One sentence."""
        return str(self.document["reason"])

    @property
    def effects(self) -> dict[str, dict[str, float | None]]:
        """Parameters of each named effect, by its name; None if the data do not show a parameter."""
        return {e["name"]: e.get("parameters", {}) for e in self.document["effects"]}

    @property
    def gap(self) -> dict[str, dict[str, float | None]]:
        """Residuals divided by the noise, `before` and `after`, of the fitted and the held-out data."""
        return {part: self.document["gap"][part] for part in ("fitted", "held_out")}

    def facts(self) -> dict[str, str]:
        """Verdict, effects with their parameters, reason."""
        shown = {"verdict": self.verdict}
        for name, parameters in self.effects.items():
            shown[name] = ", ".join(f"{k} {number(v)}" for k, v in parameters.items())
        return {**shown, "reason": self.reason}


@dataclass(frozen=True, repr=False)
class Campaign(Displayed):
    """Many runs.

    Attributes:
        table: as `table.json`: percentiles of every column at every point.
        rows: one dict per run: the values from the grid, `seed`, the columns, `error`.
        kept: the folder.
    """

    table: dict[str, Any]
    rows: list[dict[str, Any]]
    kept: Kept

    @property
    def folder(self) -> Path:
        """The folder of the campaign. If you gave none, it is removed together with this object."""
        return self.kept.folder

    def column(self, name: str) -> np.ndarray:
        """(runs,) one column, NaN if a run has no value."""
        import numpy as np

        if not any(name in row for row in self.rows):
            raise InputError(
                f"{name}: no such column; there are {', '.join(dict.fromkeys(k for r in self.rows for k in r))}"
            )
        return np.array([float("nan") if row.get(name) is None else row[name] for row in self.rows], float)

    @property
    def text(self) -> str:
        """The tables as the command line prints them."""
        from massprops.campaigns.text import text_of

        return text_of(self.table)

    def report(self) -> Path:
        """The page with box plots."""
        return self.folder / "report.html"

    def facts(self) -> dict[str, str]:
        """Runs done and failed."""
        return {
            "name": self.table["name"],
            "runs": str(self.table["done"]),
            "failed": str(self.table["failed"]),
            **self.kept.facts(),
        }


@dataclass(frozen=True, repr=False)
class Simulation(Displayed, os.PathLike[str]):
    """A sequence with known truth; the other functions accept it instead of a folder.

    Attributes:
        kept: the folder.
    """

    kept: Kept

    def __fspath__(self) -> str:
        return str(self.folder)

    @property
    def folder(self) -> Path:
        """The sequence folder. If you gave none, it is removed together with this object."""
        return self.kept.folder

    @cached_property
    def sequence(self) -> Recording:
        """What the sensors measured, as arrays."""
        from massprops.sequence import read_sequence

        return read_sequence(self.folder)

    @cached_property
    def truth(self) -> Truth:
        """The true motion and body; no estimator reads it."""
        from massprops.sequence.truth import read_truth

        truth = read_truth(self.folder)
        assert truth is not None
        return truth

    @cached_property
    def frames(self) -> np.ndarray:
        """(n, h, w) uint8 images of the first camera; (0, 0, 0) if there are only tracks."""
        import numpy as np
        from PIL import Image

        files = [p for _, p in self.sequence.cameras[0].images] if 0 in self.sequence.cameras else []
        return np.stack([np.array(Image.open(p)) for p in files]) if files else np.zeros((0, 0, 0), np.uint8)

    def facts(self) -> dict[str, str]:
        """How long, what, where."""
        truth = self.truth
        length = f"{len(truth.timestamp_ns)} epochs"
        return {"length": length, **self.kept.facts()}
