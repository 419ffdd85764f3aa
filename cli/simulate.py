"""`massprops simulate`: a tumbling body with known truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from massprops import simulate
from massprops.documents.limits import excerpt
from massprops.errors import InputError
from massprops_cli.options import Force, Quiet, argument, as_json, defaults, option, takes
from massprops_cli.terminal import say

D = defaults(simulate)


@dataclass(frozen=True)
class Options:
    scenario: Annotated[str, argument(simulate, "scenario", "SCENARIO")]
    out: Annotated[Path, option(simulate, "out", "-o", "--out")]
    frames: Annotated[int | None, option(simulate, "frames")] = D.frames
    size: Annotated[str | None, option(simulate, "size", metavar="WIDTHxHEIGHT")] = D.size
    rate: Annotated[float | None, option(simulate, "rate")] = D.rate
    fill: Annotated[float | None, option(simulate, "fill")] = D.fill
    phase: Annotated[float | None, option(simulate, "phase")] = D.phase
    distortion: Annotated[str | None, option(simulate, "distortion", metavar="K1,K2")] = D.distortion
    noise: Annotated[float | None, option(simulate, "noise")] = D.noise
    background: Annotated[str | None, option(simulate, "background")] = D.background
    stereo: Annotated[float | None, option(simulate, "stereo", metavar="BASELINE")] = D.stereo
    range: Annotated[float | None, option(simulate, "range", "--range", metavar="SIGMA")] = D.range
    hidden_mass: Annotated[str | None, option(simulate, "hidden_mass", metavar="SHARE:X,Y,Z")] = D.hidden_mass
    effects: Annotated[list[str] | None, option(simulate, "effects", metavar="NAME[:SIZE]")] = D.effects
    effect: Annotated[list[Path] | None, option(simulate, "effect", metavar="FILE")] = D.effect
    model: Annotated[Path | None, option(simulate, "model", metavar="MODEL_YAML")] = D.model
    features: Annotated[int | None, option(simulate, "features")] = D.features
    sigma: Annotated[float | None, option(simulate, "sigma")] = D.sigma
    outliers: Annotated[float | None, option(simulate, "outliers")] = D.outliers
    attitude: Annotated[float | None, option(simulate, "attitude", "--attitude", metavar="SIGMA")] = D.attitude
    rates: Annotated[float | None, option(simulate, "rates", "--rates", metavar="SIGMA")] = D.rates
    video: Annotated[bool, option(simulate, "video", "--video")] = D.video
    seed: Annotated[int, option(simulate, "seed")] = D.seed
    force: Force = False
    json_output: Annotated[bool, as_json("the folder as JSON")] = False
    quiet: Quiet = False


@takes(Options)
def command(given: Options) -> None:
    """Make test data with known truth: images of a tumbling body, or only the tracks of its points.

    Options that you do not give take the scenario's own values.

    Example: massprops simulate spacecraft -o sequences/one --frames 72 --size 640x480 --video

    Example: massprops simulate tracks -o sequences/two --effects viscous-damping:6
    """
    import json

    from massprops.effect_file import with_effects
    from massprops.simulation import simulate
    from massprops.simulation.options import changes
    from massprops.simulation.simulate import is_tracks
    from massprops_cli.progress import StageProgress

    asked = vars(given) | {
        "size": _size(given.size),
        "distortion": _distortion(given.distortion),
        "hidden_mass": _hidden(given.hidden_mass),
    }
    wanted = changes(asked, is_tracks(given.scenario), "--")
    with with_effects(given.effect or []), StageProgress(given.quiet) as watch:
        folder = simulate(
            given.scenario,
            given.out,
            given.video,
            lambda done, total, what: watch("simulate", 0, 1, done, total, what),
            given.force,
            **wanted,
        )
    say(json.dumps({"sequence": str(folder)}) if given.json_output else str(folder))


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    try:
        width, height = (int(v) for v in text.lower().split("x"))
    except ValueError:
        raise InputError(f"--size {excerpt(text)}: give it as WIDTHxHEIGHT, for example 640x480") from None
    return width, height


def _distortion(text: str | None) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        return tuple(float(v) for v in text.split(","))
    except ValueError:
        raise InputError(f"--distortion {excerpt(text)}: give it as K1,K2, for example -0.1,0.02") from None


def _hidden(text: str | None) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        share, place = text.split(":")
        return (float(share), *(float(v) for v in place.split(",")))
    except ValueError:
        raise InputError(f"--hidden-mass {excerpt(text)}: give it as SHARE:X,Y,Z, for example 0.08:0.4,0,0.2") from None
