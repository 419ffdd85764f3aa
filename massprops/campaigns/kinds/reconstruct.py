"""Reconstructions of a list of videos, each in its own run folder: `videos`, and any option of `reconstruct`."""

from __future__ import annotations

import hashlib
import math
import os
from dataclasses import fields
from pathlib import Path
from typing import Any

from massprops.campaigns.kinds import always
from massprops.errors import InputError

SENTENCE = "Reconstructions of a list of videos, each in its own run folder."
OWN_THREADS = True
SHOWN = ("volume", "mass", "k1", "k2")


def prepared(
    fixed: dict[str, Any], grid: dict[str, Any], folder: Path, where: str
) -> tuple[dict[str, Any], dict[str, Any]]:
    """`videos`, with patterns filled in, as an axis of the grid."""
    fixed = dict(fixed)
    given = fixed.pop("videos", None)
    if given is None and "video" not in grid:
        raise InputError(f"{where}: no videos: give a list of videos, folders of images or sequence folders")
    if given is not None:
        paths: list[str] = []
        for entry in given if isinstance(given, list) else [given]:
            paths += _paths(str(entry), folder, where)
        grid = {"video": list(dict.fromkeys(paths)), **grid}
    elif isinstance(grid["video"], list):
        grid = {**grid, "video": [p for entry in grid["video"] for p in _paths(str(entry), folder, where)]}
    for name in ("masks", "sparse"):
        if fixed.get(name) is not None:
            fixed[name] = str((folder / str(fixed[name])).resolve())
    return fixed, grid


def _paths(entry: str, folder: Path, where: str) -> list[str]:
    path = folder / entry
    if path.exists():
        return [str(path.resolve())]
    root = Path(path.anchor)
    matches = sorted(str(p.resolve()) for p in root.glob(str(path.relative_to(root))))
    if not matches:
        raise InputError(f"{where}: videos: {path}: no such file or folder")
    return matches


def parameters(fixed: dict[str, Any], grid: dict[str, Any]) -> list[str]:
    """`video` and the options of `reconstruct`."""
    from massprops.run.job import ReconstructOptions

    return ["videos", "video", *(f.name for f in fields(ReconstructOptions) if f.name not in ("source", "seed"))]


def check(values: dict[str, Any], where: str) -> None:
    """Refuses what `reconstruct` would refuse."""
    from massprops.run.reconstruct import checked_options

    options = {name: value for name, value in values.items() if name != "video"}
    try:
        checked_options(values["video"], options)
    except TypeError as error:
        raise InputError(f"{where}: an option of reconstruct has the wrong kind ({error})") from None
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


default_runs = always(1)
chunk = always(1)


def basis(plan: Any) -> Any:
    """What the footage holds."""
    from massprops.core.inputs import hash_input

    return {video: _short(hash_input(Path(video))) for video in plan.grid["video"]}


def _short(hashes: dict[str, str]) -> str:
    return hashlib.sha256(repr(sorted(hashes.items())).encode()).hexdigest()


def runs(values: dict[str, Any], seeds: list[int], folder: Path | None) -> list[dict[str, Any]]:
    """Volume, ratios and principal moments of each; a run folder per seed."""
    return [_run(values, seed, folder) for seed in seeds]


def _run(values: dict[str, Any], seed: int, folder: Path | None) -> dict[str, Any]:
    from massprops.run.reconstruct import reconstruct

    if folder is None:
        raise InputError("a reconstruction needs a folder: give -o")
    options = {name: value for name, value in values.items() if name != "video"}
    place = folder / f"{Path(values['video']).stem}-{seed}"
    place.parent.mkdir(parents=True, exist_ok=True)
    run = reconstruct(values["video"], place, seed=seed, **options)
    row: dict[str, Any] = {"run": f"runs/{folder.name}/{place.name}", "exit_code": run.exit_code}
    if (place / "massprops.json").is_file():
        properties = run.properties
        flat = {**properties, **(properties.get("inertia_ratios") or {})}
        row |= {name: flat[name] for name in SHOWN if isinstance(flat.get(name), int | float)}
        row |= {f"I{k + 1}": value for k, value in enumerate(properties.get("principal_moments") or ())}
        row["observed"] = (properties.get("surface") or {}).get("observed_fraction")
        row["registered"] = (properties.get("images") or {}).get("registered")
        bounds = (properties.get("interval_90") or {}).get("volume")
        if bounds and properties.get("volume"):
            row["volume_interval_relative"] = (bounds[1] - bounds[0]) / properties["volume"]
    row = {k: v for k, v in row.items() if v is not None and not (isinstance(v, float) and not math.isfinite(v))}
    if run.exit_code:
        row["error"] = " ".join(run.reason.split()) or f"exit code {run.exit_code}"
    return row


def tables(plan: Any, points: list[Any]) -> list[dict[str, Any]]:
    """One line per reconstruction."""
    names = list(dict.fromkeys(n for p in points for r in p.rows for n in r.data if n not in ("run", "exit_code")))
    folders = [str(Path(p.parameters["video"]).parent) for p in points]
    shared = os.path.commonpath(folders) if folders else "."
    rows = [
        [os.path.relpath(p.parameters["video"], shared), _others(p.cell), r.seed]
        + [*(r.data.get(n) for n in names), r.error or ""]
        for p in points
        for r in p.rows
    ]
    columns = ["video", "options", "seed", *names, "error"]
    return [{"title": "Reconstructions", "columns": columns, "rows": rows, "notes": ["Run folders are under runs/."]}]


def _others(cell: dict[str, Any]) -> str:
    return ", ".join(f"{name} {value}" for name, value in cell.items() if name != "video")


boxes = always([])  # each video is another body
