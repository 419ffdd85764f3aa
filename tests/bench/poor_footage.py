"""Tumbling bodies filmed badly: the tool's own renderer, with one thing wrong at a time.

The motion is sampled several times a frame, so that a shutter that stays open, or that opens row after row, shows it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh
from backdrop import stars_and_limb

from massprops.mass.integrals import greatest_length
from massprops.mass.properties import MassProperties, mass_properties
from massprops.simulation.motion import distance_for, tumbling
from massprops.simulation.render import Renderer, lens_of
from massprops.simulation.scenario import Scenario, load_scenario
from massprops.simulation.simulate import write_video

SAMPLES = 6
"""Moments of a frame from which those are taken at which the shutter is open."""
ROW_SAMPLES = 48
"""As above where rows are read one after the other: fine enough that the image moves by less than a third of a pixel
from one band of rows to the next. With 6 it was torn by two pixels at two rows, which no camera does."""


@dataclass(frozen=True)
class Poor:
    """One thing wrong.

    Attributes:
        changes: of the scenario.
        open_deg: turn of the body while the shutter is open [deg].
        rows_deg: turn of the body from the first row's exposure to the last one's [deg].
        dark: every other so many frames are in the Earth's shadow; 0 for none.
        farther: distance in the last frame over that in the first.
        sky: draws stars and the Earth's limb.
        crf: of H.264.
    """

    changes: dict[str, Any]
    open_deg: float = 0.0
    rows_deg: float = 0.0
    dark: int = 0
    farther: float = 1.0
    sky: bool = False
    crf: int = 14


USUAL: dict[str, Any] = {"frames": 54, "size": (400, 300), "rate_deg": 7.0}
KINDS: dict[str, Poor] = {
    "14 images": Poor({"frames": 14, "rate_deg": 24.0}),
    "20 images": Poor({"frames": 20, "rate_deg": 17.0}),
    "320x240": Poor({"size": (320, 240)}),
    "heavy H.264": Poor({}, crf=36),
    "night's noise": Poor({"noise": 14.0}),
    "motion blur": Poor({}, open_deg=2.0),
    "rolling shutter": Poor({}, rows_deg=3.0),
    "eclipse": Poor({}, dark=9),
    "distance threefold": Poor({}, farther=3.0),
    "stars and limb": Poor({}, sky=True),
}


@dataclass(frozen=True)
class Filmed:
    """What was written, and the truth."""

    video: Path
    body: MassProperties
    length: float


def film(name: str, scenario: str, seed: int, folder: Path) -> Filmed:
    """Draws one body with one thing wrong; nothing of the truth is written."""
    poor = KINDS[name]
    chosen = load_scenario(scenario, seed=seed, **{**USUAL, **poor.changes})
    mesh = trimesh.load(chosen.mesh, force="mesh")
    mesh.apply_translation(-mass_properties(mesh, 1.0).center_of_mass)
    body, length = mass_properties(mesh, chosen.density), greatest_length(np.asarray(mesh.vertices))[0]
    video = folder / "film.mp4"
    if not video.exists():
        part = folder / "drawn"
        part.mkdir(parents=True, exist_ok=True)
        write_video(video, _draw(poor, chosen, mesh, body.inertia, length, part), chosen.rate_hz, poor.crf)
    return Filmed(video, body, length)


def _draw(
    poor: Poor, chosen: Scenario, mesh: trimesh.Trimesh, inertia: np.ndarray, length: float, folder: Path
) -> list[Path]:
    samples = ROW_SAMPLES if poor.rows_deg else SAMPLES
    path = tumbling(
        replace(
            chosen,
            frames=chosen.frames * samples,
            rate_hz=chosen.rate_hz * samples,
            rate_deg=chosen.rate_deg / samples,
        ),
        inertia,
        length,
        np.zeros(3),
    )
    renderer = Renderer(mesh, chosen, lens_of(chosen))
    backdrop = stars_and_limb(chosen.size, chosen.seed) if poor.sky else None
    black, lit = renderer.backdrop, renderer.scenario
    rng = np.random.default_rng([chosen.seed, 3])
    files = []
    for i in range(chosen.frames):
        if backdrop is not None:
            renderer.backdrop = backdrop(i, black)
        dark = bool(poor.dark) and (i // max(poor.dark, 1)) % 2 == 1
        renderer.scenario = replace(lit, exposure=0.01 * lit.exposure) if dark else lit
        grow = 1.0 + (poor.farther - 1.0) * i / max(chosen.frames - 1, 1)
        away = np.array([0.0, 0.0, (grow - 1.0) * distance_for(chosen, length)])
        moments = [
            renderer.frame(path.q[k], path.position[k] + away, path.sun[k], rng)[0]
            for k in i * samples + _moments(poor, chosen, samples)
        ]
        files.append(folder / f"{i:04d}.png")
        cv2.imwrite(str(files[-1]), _exposed(moments, poor))
    return files


def _moments(poor: Poor, chosen: Scenario, samples: int) -> np.ndarray:
    """Samples of a frame that are drawn: all that pass while the shutter is open, or while it moves down the image."""
    open_deg = max(poor.open_deg, poor.rows_deg)
    return np.arange(max(1, round(samples * open_deg / chosen.rate_deg)) if open_deg else 1)


def _exposed(moments: list[np.ndarray], poor: Poor) -> np.ndarray:
    """One image (h, w) of the moments: their mean, or each in its rows."""
    if poor.rows_deg:
        bands = np.array_split(np.arange(len(moments[0])), len(moments))
        return np.concatenate([m[rows] for m, rows in zip(moments, bands, strict=True)])
    out: np.ndarray = np.rint(np.mean(moments, axis=0)).astype(np.uint8)
    return out
