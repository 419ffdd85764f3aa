"""`massprops reconstruct`: from footage to a run folder."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from massprops.capture.choice import check_early, parse
from massprops.core.inputs import hash_input, readable
from massprops.core.outputs import claim, verify
from massprops.errors import InputError
from massprops.mass.measured import Measured
from massprops.native import missing
from massprops.run.job import ReconstructOptions
from massprops.run.runner import Watch, run_stages
from massprops.run.stages.publish import sources

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True, repr=False)
class Run(Measured):
    """A finished or stopped run, with its volume, inertia and the rest as attributes: those that the run recommends.

    Attributes:
        folder: the run folder.
        exit_code: 0 done, 2 wrong input, 3 in part.
        reason: why it is not 0.
        warnings: one line each.
        stages: per stage: seconds, cpu_seconds, peak_memory_mb, facts.
    """

    folder: Path
    exit_code: int = 0
    reason: str = ""
    warnings: list[str] = field(default_factory=list)
    stages: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def properties(self) -> dict[str, Any]:
        """The whole `massprops.json`.

        Raises:
            InputError: the run has none.
        """
        path = self.folder / "massprops.json"
        if not path.is_file():
            raise InputError(f"{self.folder}: no massprops.json in this run: {self.reason or 'finish it first'}")
        verify(self.folder, path.name)
        document: dict[str, Any] = json.loads(path.read_text())
        return document

    @property
    def verdict(self) -> str | None:
        """Of the cross-check: `consistent`, `inconsistent` or `unobservable`; None where it was not made."""
        path = self.folder / "crosscheck.json"
        return str(json.loads(path.read_text())["verdict"]) if path.is_file() else None

    def report(self) -> Path:
        """The page of this run, `report.html`."""
        return self.folder / "report.html"

    def facts(self) -> dict[str, str]:
        """Volume, mass and moments; where there are none, why."""
        if not (self.folder / "massprops.json").is_file():
            return {"stopped": self.reason or "not finished", "folder": str(self.folder)}
        verdict = {"shape against motion": self.verdict} if self.verdict else {}
        return {**super().facts(), **verdict, "folder": str(self.folder)}

    @cached_property
    def mesh(self) -> trimesh.Trimesh:
        """The closed mesh, `mesh.ply`, in the units of `properties`."""
        import trimesh

        path = self.folder / "mesh.ply"
        if not path.is_file():
            raise InputError(f"{self.folder}: no mesh.ply in this run: {self.reason or 'finish it first'}")
        verify(self.folder, path.name)
        return trimesh.load(path, force="mesh", process=False)


NAMES = {
    "reconstruct": (
        *("run.yaml", "massprops.json", "mesh.ply", "mesh.glb", "cloud.ply"),
        *("sparse/", "masks/", "sequence/", "work/"),
    ),
    "crosscheck": ("crosscheck.json",),
    "report": ("report.json", "report.html"),
}
"""What a run writes into its folder, by the name under which the folder's record knows it."""

RANGES = {
    "frames": (3, 5000, "frames"),
    "max_size": (160, 8000, "pixels"),
    "dense_views": (0, 2000, "views"),
    "threads": (0, 1024, "threads"),
    "focal": (10.0, 1e6, "pixels"),
    "density": (1e-6, 1e9, "kg/m^3"),
    "scale": (1e-9, 1e9, "metres per model unit"),
    "scale_sigma": (0.0, 0.5, "relative, one sigma"),
    "seed": (0, 2**31 - 1, ""),
}


def checked_options(source: str | Path | Sequence[str | Path], options: dict[str, Any]) -> ReconstructOptions:
    """Options with every value in its range.

    Raises:
        InputError: no such source, an unknown option, or a value out of range.
    """
    given = [source] if isinstance(source, str | Path) else list(source)
    if not given:
        raise InputError("no input: give a video, a folder of images or a sequence folder")
    paths = [readable(Path(path)) for path in given]
    for path in paths:
        if not path.exists():
            raise InputError(f"{path}: no such file or folder: give a video, a folder of images or a sequence folder")
    source, more = paths[0], tuple(str(p.resolve()) for p in paths[1:])
    if more and options.get("motion") == "tumbling":
        raise InputError("--motion tumbling: several INPUTs are placements of a still object; give one")
    known = {f.name for f in fields(ReconstructOptions)} - {"more"}
    for name in options:
        if name not in known:
            raise InputError(f"{name}: no such option; there are {', '.join(sorted(known - {'source'}))}")
    for name, (low, high, unit) in RANGES.items():
        value = options.get(name)
        if value is not None and not low <= value <= high:
            raise InputError(
                f"--{name.replace('_', '-')} {value}: give a value from {low:g} to {high:g} {unit}".rstrip()
            )
    for name, allowed in (("motion", ("auto", "tumbling", "static")), ("mapper", ("incremental", "global"))):
        if options.get(name, allowed[0]) not in allowed:
            raise InputError(f"--{name} {options[name]}: give one of {', '.join(allowed)}")
    for name in ("masks", "sparse"):
        if options.get(name) is not None:
            folder = Path(options[name])
            if not folder.is_dir():
                raise InputError(f"--{name} {folder}: no such folder")
            options[name] = str(folder.resolve())
    for name in ("object", "box"):
        given = options.get(name) or ()
        options[name] = (given,) if isinstance(given, str) else tuple(given)
    _check_early(source, bool(more), options)
    for one in fields(ReconstructOptions):  # 150 and 150.0 are one option: stages that are done stay so
        if str(one.type).startswith("float") and options.get(one.name) is not None:
            options[one.name] = float(options[one.name])
    if options.get("distance") is not None:
        options["distance"] = (*options["distance"][:2], float(options["distance"][2]))
    return ReconstructOptions(source=str(source.resolve()), more=more, **options)


def _check_early(source: Path, several: bool, options: dict[str, Any]) -> None:
    """What would otherwise be told after an hour's work."""
    pointed = [parse(name, value) for name in ("object", "box") for value in options[name]]
    for one in pointed if not several else ():
        check_early(one, source)
    if (pointed or options.get("keep_support")) and options.get("masks") is not None:
        raise InputError("--masks says already what the object is: leave out --object, --box and --keep-support")
    if options.get("sparse") is not None:
        from massprops.sfm.model_folder import find_model

        find_model(Path(options["sparse"]))
    if options.get("distance") is not None:
        from massprops.sfm.scale import distance

        distance.check(options["distance"], distance.read_named(source))
    if options.get("marker") is not None:
        from massprops.sfm.scale import marker

        marker.parse(options["marker"])


def reconstruct(
    source: str | Path | Sequence[str | Path],
    out: str | Path,
    watch: Watch | None = None,
    force: bool = False,
    **options: Any,
) -> Run:
    """From a video, a folder of images or a sequence folder to a run folder.

    Args:
        source: the footage; of several folders or videos, each shows another placement of the one object.
        out: the run folder; an interrupted or older run there is continued.
        watch: told of progress.
        force: files in the folder that no `reconstruct` wrote may be replaced; inputs may not.
        options: fields of `ReconstructOptions`.

    Returns:
        the run; its `exit_code` is 3 when the data did not give everything, with the reason.

    Raises:
        InputError: the input or an option is wrong.

    Example:
        >>> run = massprops.reconstruct("video.mp4", "runs/one", scale=0.42)  # doctest: +SKIP
        >>> run.properties["volume"], run.properties["interval_90"]["volume"]  # doctest: +SKIP
    """
    chosen = checked_options(source, options)
    if lacks := missing("pycolmap") or missing("PyMaxflow"):
        raise InputError(lacks)
    run = readable(Path(out)).resolve()
    origin = Path(chosen.source)
    for place in (origin, *map(Path, chosen.more)):
        if run == place or place in run.parents and place.is_dir() and run.parent == place:
            raise InputError(f"{out}: the run folder must not be the footage or lie directly in it: choose another -o")
    given = sources(chosen)
    with claim(run, "reconstruct", NAMES["reconstruct"], given, force) as outputs:
        for by in ("crosscheck", "report"):
            outputs.check(by, NAMES[by], given, force)
        inputs = hash_input(origin)
        for number, extra in enumerate(given[1:]):
            name = f"{number + 2}:{extra.name}" if number < len(chosen.more) else extra.name
            inputs.update({f"{name}/{k}": v for k, v in hash_input(extra).items()})
        outcome = run_stages(run, chosen, inputs, watch, force=force)
    if outcome.exit_code == 2:
        raise InputError(outcome.reason)
    return Run(run, outcome.exit_code, outcome.reason, outcome.warnings, outcome.stages)
