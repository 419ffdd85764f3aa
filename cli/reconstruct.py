"""`massprops reconstruct`: from footage to mass properties."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from massprops_cli.terminal import say, tell, warn


def command(
    source: Annotated[
        list[Path],
        typer.Argument(
            metavar="INPUT...",
            help="Video, folder of images, or sequence folder; several: placements of one object, turned over between.",
        ),
    ],
    out: Annotated[
        Path, typer.Option("-o", "--out", help="Run folder; the same command continues an interrupted run.")
    ],
    motion: Annotated[
        str, typer.Option(help="auto, tumbling (body moves, camera still) or static (camera moves).")
    ] = "auto",
    masks: Annotated[
        Path | None, typer.Option(help="Silhouettes in COLMAP's naming: IMAGE.jpg.png, black excluded.")
    ] = None,
    object_: Annotated[
        list[str] | None,
        typer.Option(
            "--object",
            metavar="[FILE:]X,Y",
            help="A pixel of the object, in the first image used or in FILE; may be repeated.",
        ),
    ] = None,
    box: Annotated[
        list[str] | None,
        typer.Option(
            "--box",
            metavar="[FILE:]X0,Y0,X1,Y1",
            help="A rectangle in which the object lies, in the first image used or FILE.",
        ),
    ] = None,
    keep_support: Annotated[
        bool, typer.Option("--keep-support", help="A stand, foam or mat below the object belongs to it.")
    ] = False,
    frames: Annotated[int, typer.Option(help="Most frames used per camera.")] = 120,
    max_size: Annotated[int, typer.Option(help="Longer side to which images are reduced [px].")] = 1280,
    focal: Annotated[float | None, typer.Option(help="Focal length of the source images, when known [px].")] = None,
    mapper: Annotated[str, typer.Option(help="incremental or global.")] = "incremental",
    sparse: Annotated[Path | None, typer.Option(help="Existing COLMAP model to use in place of our own.")] = None,
    dense_views: Annotated[int, typer.Option(help="Most reference views of the dense stereo; 0: chosen.")] = 0,
    density: Annotated[
        float | None, typer.Option(help="Constant density [kg/m^3]; not given: 1000, as water, and said so.")
    ] = None,
    scale: Annotated[
        float | None,
        typer.Option(help="Metres per model unit; a model unit is the object's greatest length, so: its length [m]."),
    ] = None,
    scale_sigma: Annotated[float, typer.Option(help="Relative 1-sigma of a given length.")] = 0.0,
    distance: Annotated[
        tuple[str, str, float] | None,
        typer.Option(
            metavar="A B METRES", help="Distance between two points, each 'x,y,z' in model units or a picked name."
        ),
    ] = None,
    marker: Annotated[
        str | None,
        typer.Option(help="ArUco DICTIONARY:SIDE_METRES or ChArUco DICTIONARY:COLSxROWS:SQUARE_METRES in view."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of every random draw.")] = 0,
    threads: Annotated[int, typer.Option(help="Processor threads; 0: all.")] = 0,
    force: Annotated[
        bool, typer.Option("--force", help="Replace files that this command did not write; never an input.")
    ] = False,
    json_output: Annotated[
        bool, typer.Option("--json", help="Print massprops.json on stdout and nothing else.")
    ] = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="No progress.")] = False,
) -> int:
    """Mesh, volume, centre of mass and inertia, each with its interval, from a video or photographs of an object.

    Example: massprops reconstruct video.mp4 -o runs/one --scale 0.42

    Example: massprops reconstruct photos -o runs/two --object IMG_0007.jpg:812,640

    Example: massprops reconstruct upright turned -o runs/three
    """
    import json

    from massprops.run.reconstruct import reconstruct
    from massprops_cli.crosscheck import verdict_line
    from massprops_cli.progress import StageProgress
    from massprops_cli.table import mass_table

    with StageProgress(quiet) as watch:
        run = reconstruct(
            source,
            out,
            watch,
            force,
            motion=motion,
            masks=str(masks) if masks else None,
            object=tuple(object_ or ()),
            box=tuple(box or ()),
            keep_support=keep_support,
            frames=frames,
            max_size=max_size,
            focal=focal,
            mapper=mapper,
            sparse=str(sparse) if sparse else None,
            dense_views=dense_views,
            density=density,
            scale=scale,
            scale_sigma=scale_sigma,
            distance=distance,
            marker=marker,
            seed=seed,
            threads=threads,
        )
    for warning in run.warnings:
        warn(warning)
    if run.exit_code:
        tell(f"massprops: {' '.join(run.reason.split())}")
    if (run.folder / "massprops.json").is_file() and "mass" in run.stages and run.stages["mass"]["status"] == "done":
        if json_output:
            say(json.dumps(run.properties))
        else:
            say(mass_table(run.properties))
            say(verdict_line(run.folder))
    elif json_output:
        say(json.dumps({"exit_code": run.exit_code, "reason": run.reason}))
    if not json_output:
        say(f"report: {run.folder / 'report.html'}")
    return run.exit_code
