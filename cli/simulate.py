"""`massprops simulate`: a tumbling body with known truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from massprops.errors import InputError
from massprops_cli.terminal import say


def command(
    scenario: Annotated[
        str,
        typer.Argument(metavar="SCENARIO", help="spacecraft, asteroid, bracket, tracks, a YAML file or a mesh file."),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="Sequence folder to write.")],
    frames: Annotated[int | None, typer.Option(help="Number of images.")] = None,
    size: Annotated[str | None, typer.Option(help="WIDTHxHEIGHT [px].")] = None,
    rate: Annotated[float | None, typer.Option(help="Rotation of the body per image [deg].")] = None,
    fill: Annotated[float | None, typer.Option(help="Greatest length of the body over the image's height.")] = None,
    phase: Annotated[float | None, typer.Option(help="Angle at the body between camera and Sun [deg].")] = None,
    distortion: Annotated[
        str | None, typer.Option(metavar="K1,K2", help="Radial distortion of the lens, as OpenCV's.")
    ] = None,
    noise: Annotated[float | None, typer.Option(help="1-sigma of the darkest pixels [grey levels].")] = None,
    background: Annotated[str | None, typer.Option(help="black or still.")] = None,
    stereo: Annotated[
        float | None, typer.Option(metavar="BASELINE", help="Second camera, this far to the right [m].")
    ] = None,
    range_sigma: Annotated[
        float | None, typer.Option("--range", metavar="SIGMA", help="Range sensor with this noise [m].")
    ] = None,
    hidden_mass: Annotated[
        str | None, typer.Option(metavar="SHARE:X,Y,Z", help="Mass that the mesh does not show; moves the motion only.")
    ] = None,
    effects: Annotated[
        list[str] | None,
        typer.Option(
            "--effects",
            metavar="NAME[:SIZE]",
            help="An effect at work, may be repeated. SIZE is how far it moves the tracks [px rms], or parameter=value,…",
        ),
    ] = None,
    effect: Annotated[
        list[Path] | None,
        typer.Option("--effect", metavar="FILE", help="An effect file of your own, may be repeated."),
    ] = None,
    model: Annotated[
        Path | None, typer.Option("--model", metavar="MODEL_YAML", help="What 'diagnose' wrote: its effects act.")
    ] = None,
    features: Annotated[int | None, typer.Option(help="Feature points, for tracks.")] = None,
    sigma: Annotated[float | None, typer.Option(help="1-sigma of the tracks [px], for tracks.")] = None,
    outliers: Annotated[float | None, typer.Option(help="Share of wrong tracks, for tracks.")] = None,
    attitude_sigma: Annotated[
        float | None, typer.Option("--attitude", metavar="SIGMA", help="An attitude history too [rad], for tracks.")
    ] = None,
    rate_sigma: Annotated[
        float | None, typer.Option("--rates", metavar="SIGMA", help="Body rates too [rad/s], for tracks.")
    ] = None,
    video: Annotated[bool, typer.Option("--video", help="Also write cam0/video.mp4 (H.264).")] = False,
    seed: Annotated[int, typer.Option(help="Of motion, Sun, texture and noise.")] = 0,
    force: Annotated[
        bool, typer.Option("--force", help="Replace files that this command did not write; never an input.")
    ] = False,
    json_output: Annotated[
        bool, typer.Option("--json", help="Print the folder as JSON on stdout and nothing else.")
    ] = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="No progress.")] = False,
) -> None:
    """Render a body of known mass properties under one sun, or only its tracks, with the truth beside them.

    Example: massprops simulate spacecraft -o sequences/one --frames 72 --size 640x480 --video

    Example: massprops simulate tracks -o sequences/two --effects viscous-damping:6
    """
    import json

    from massprops.effect_file import with_effects
    from massprops.simulation import simulate
    from massprops.simulation.simulate import is_tracks
    from massprops_cli.progress import StageProgress

    asked = {
        "features": features,
        "sigma_px": sigma,
        "outliers": outliers,
        "attitude_sigma": attitude_sigma,
        "rate_sigma": rate_sigma,
    }
    of_tracks = {k: v for k, v in asked.items() if v is not None}
    if of_tracks and not is_tracks(scenario):
        raise InputError("--features, --sigma, --outliers, --attitude and --rates are for the scenario 'tracks'")
    with with_effects(effect or []), StageProgress(quiet) as watch:
        folder = simulate(
            scenario,
            out,
            video,
            lambda done, total, what: watch("simulate", 0, 1, done, total, what),
            force,
            frames=frames,
            size=_size(size),
            rate_deg=rate,
            fill=fill,
            sun_phase_deg=phase,
            distortion=_distortion(distortion),
            noise=noise,
            background=background,
            stereo_m=stereo,
            range_sigma_m=range_sigma,
            hidden_mass=_hidden(hidden_mass),
            effects=tuple(effects) if effects else None,
            model=model,
            seed=seed,
            **of_tracks,
        )
    say(json.dumps({"sequence": str(folder)}) if json_output else str(folder))


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    try:
        width, height = (int(v) for v in text.lower().split("x"))
    except ValueError:
        raise InputError(f"--size {text}: give it as WIDTHxHEIGHT, for example 640x480") from None
    return width, height


def _distortion(text: str | None) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        return tuple(float(v) for v in text.split(","))
    except ValueError:
        raise InputError(f"--distortion {text}: give it as K1,K2, for example -0.1,0.02") from None


def _hidden(text: str | None) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        share, place = text.split(":")
        return (float(share), *(float(v) for v in place.split(",")))
    except ValueError:
        raise InputError(f"--hidden-mass {text}: give it as SHARE:X,Y,Z, for example 0.08:0.4,0,0.2") from None
