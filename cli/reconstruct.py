"""`massprops reconstruct`: from footage to mass properties."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from massprops import reconstruct
from massprops.errors import InputError
from massprops.run.job import ReconstructOptions
from massprops_cli.options import Force, Quiet, argument, as_json, defaults, option, takes
from massprops_cli.terminal import say, tell, warn, warn_of_density

if TYPE_CHECKING:
    from massprops.run.reconstruct import Run

D = defaults(reconstruct)


@dataclass(frozen=True)
class Options:
    source: Annotated[list[Path], argument(reconstruct, "source", "INPUT...")]
    out: Annotated[Path, option(reconstruct, "out", "-o", "--out")]
    motion: Annotated[str, option(reconstruct, "motion")] = D.motion
    masks: Annotated[Path | None, option(reconstruct, "masks")] = D.masks
    object: Annotated[list[str] | None, option(reconstruct, "object", "--object", metavar="[FILE:]X,Y")] = D.object
    box: Annotated[list[str] | None, option(reconstruct, "box", metavar="[FILE:]X0,Y0,X1,Y1")] = D.box
    keep_support: Annotated[bool, option(reconstruct, "keep_support", "--keep-support")] = D.keep_support
    frames: Annotated[int, option(reconstruct, "frames")] = D.frames
    max_size: Annotated[int, option(reconstruct, "max_size")] = D.max_size
    focal: Annotated[float | None, option(reconstruct, "focal")] = D.focal
    mapper: Annotated[str, option(reconstruct, "mapper")] = D.mapper
    sparse: Annotated[Path | None, option(reconstruct, "sparse")] = D.sparse
    dense_views: Annotated[int, option(reconstruct, "dense_views")] = D.dense_views
    density: Annotated[float | None, option(reconstruct, "density")] = D.density
    scale: Annotated[float | None, option(reconstruct, "scale")] = D.scale
    scale_sigma: Annotated[float, option(reconstruct, "scale_sigma")] = D.scale_sigma
    distance: Annotated[tuple[str, str, float] | None, option(reconstruct, "distance", metavar="A B METRES")] = (
        D.distance
    )
    marker: Annotated[str | None, option(reconstruct, "marker")] = D.marker
    seed: Annotated[int, option(reconstruct, "seed")] = D.seed
    threads: Annotated[int, option(reconstruct, "threads")] = D.threads
    force: Force = False
    json_output: Annotated[bool, as_json("massprops.json")] = False
    quiet: Quiet = False


@takes(Options)
def command(given: Options) -> int:
    """Turn a video or photographs of an object into a mesh, its volume, centre of mass and inertia, with intervals.

    Example: massprops reconstruct video.mp4 -o runs/one --scale 0.42

    Example: massprops reconstruct photos -o runs/two --object IMG_0007.jpg:812,640

    Example: massprops reconstruct upright turned -o runs/three
    """
    from massprops.run.reconstruct import reconstruct
    from massprops_cli.progress import StageProgress

    asked = {name: getattr(given, name) for name in OF_RUN}
    with StageProgress(given.quiet, given.out) as watch:
        run = reconstruct(given.source, given.out, watch, given.force, **asked)
    for warning in run.warnings:
        warn(warning)
    if run.exit_code:
        tell(f"massprops: {' '.join(run.reason.split())}")
    _print(run, given.json_output)
    return run.exit_code


OF_RUN = [field.name for field in fields(Options) if field.name in ReconstructOptions.__dataclass_fields__]
OF_RUN.remove("source")
"""Options that the run is told as they stand."""


def _print(run: Run, json_output: bool) -> None:
    """The mass properties where there are any, the verdict and where the report lies."""
    import json

    from massprops_cli.crosscheck import verdict_line
    from massprops_cli.table import mass_table

    if _has_properties(run):
        warn_of_density(run.density_assumed and run.metric)
        if json_output:
            say(json.dumps(run.properties))
        else:
            say(mass_table(run.properties))
            say(verdict_line(run.folder))
    elif json_output:
        say(json.dumps({"exit_code": run.exit_code, "reason": run.reason}))
    if not json_output:
        say(f"report: {run.folder / 'report.html'}")


def _has_properties(run: Run) -> bool:
    """Whether this run left mass properties.

    Raises:
        InputError: they are not what it wrote. Where the run stopped, as on a full disk, that was told before.
    """
    path = run.folder / "massprops.json"
    if not path.is_file() or run.stages.get("mass", {}).get("status") != "done":
        return False
    try:
        return bool(run.properties)
    except InputError:
        if not run.exit_code:
            raise
        return False
