"""Several inputs: placements of one object, each in a folder or video of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from massprops.capture.footage import Source, open_sources
from massprops.errors import InputError


@dataclass(frozen=True)
class Input:
    """One input: its number, the name that tells its images from the others', and its frames."""

    placement: int
    label: str
    source: Source


def open_inputs(paths: Sequence[Path], focal: float | None = None) -> list[Input]:
    """The placements that the user has sorted already.

    Args:
        paths: a folder of images or a video each.
        focal: as of `open_sources`.

    Raises:
        InputError: as `open_sources`; one is given twice, or is a sequence folder.
    """
    seen = [p.resolve() for p in paths]
    for k, path in enumerate(paths):
        if seen.index(seen[k]) != k:
            raise InputError(
                f"{path}: given twice: each INPUT must show another placement of the object; leave one out"
            )
    out = []
    for k, (path, label) in enumerate(zip(paths, labels(paths), strict=True)):
        if path.is_dir() and any((path / f"cam{i}").is_dir() for i in (0, 1)):
            raise InputError(
                f"{path}: a sequence folder; several INPUTs are placements of a still object, each a folder of images or "
                "a video"
            )
        out.append(Input(k, label, open_sources(path, focal)[0]))
    return out


def labels(paths: Sequence[Path]) -> list[str]:
    """A name for each input: its own, numbered where two are alike."""
    names = [p.resolve().name for p in paths]
    return [n if names.count(n) == 1 else f"{n}-{k + 1}" for k, n in enumerate(names)]


def same_cameras(cameras: list[dict[str, Any]], frames: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """One entry for a camera that took images of several inputs; its number is written into the frames.

    Images of one device and size share a camera, as they do within a folder.

    Args:
        cameras: entries of `footage.json`, with different numbers.
        frames: likewise; changed in place.
    """
    kept: dict[tuple[Any, ...], dict[str, Any]] = {}
    number: dict[int, int] = {}
    for camera in cameras:
        key = (
            camera["device"],
            tuple(sorted(camera["source_size"])),
            tuple(sorted((camera["width"], camera["height"]))),
        )
        if key in kept:
            kept[key]["images"] += camera["images"]
        else:
            kept[key] = dict(camera)
        first = kept[key]
        number[camera["id"]] = first["id"]
        # a video held upright and one held sideways
        if (first["width"], first["height"]) != (camera["width"], camera["height"]):
            for frame in frames:
                if frame["camera"] == camera["id"]:
                    frame["turn"] = (frame["turn"] + 1) % 4
    for frame in frames:
        frame["camera"] = number[frame["camera"]]
    return list(kept.values())
