"""An existing COLMAP model in place of our own structure from motion."""

from __future__ import annotations

import zlib  # noqa: F401  must precede pycolmap
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

from massprops.core.text import counted
from massprops.documents.loading import excerpt
from massprops.errors import InputError, NotPossible
from massprops.sfm.footage import FootageRecord
from massprops.sfm.model_bytes import check_lengths
from massprops.sfm.model_folder import find_model
from massprops.sfm.points import SparsePoints
from massprops.sfm.sound import take_out
from massprops.views import Views


def import_sparse(
    folder: Path, footage: FootageRecord
) -> tuple[pycolmap.Reconstruction, Views, SparsePoints, list[str]]:
    """Model, views, points and warnings; images are matched with the footage by name.

    A name matches with or without its folder, and with or without its ending when that leaves no doubt. Cameras are
    rescaled when the stored frames are smaller than the model's images.

    Raises:
        InputError: no model, or one that cannot be read or expressed.
        NotPossible: fewer than three of its images belong to the footage.
    """
    place = find_model(folder)
    check_lengths(place)
    try:
        model = pycolmap.Reconstruction(place)
    except Exception as error:
        raise InputError(f"{place}: not a readable COLMAP model ({excerpt(error)}); export it again") from error
    try:
        views, points, soundness = take_out(model, given_focal=True, given_poses=True)
    except (
        KeyError,
        IndexError,
        ValueError,
        OverflowError,
    ) as error:  # points that it lacks, names and sizes that are none
        raise InputError(f"{place}: a damaged COLMAP model ({excerpt(error)}); export it again") from error
    points = points.observed(soundness.observations)
    frame_of = _frame_names(footage, views.names)
    in_footage = [name in frame_of for name in views.names]
    kept = [i for i, (named, held) in enumerate(zip(in_footage, soundness.views, strict=True)) if named and held]
    if sum(in_footage) < 3:
        raise NotPossible(
            f"{place}: only {sum(in_footage)} of its {len(views)} images are in the footage; use the image names of the footage"
        )
    if len(kept) < 3:
        raise NotPossible(
            f"{place}: only {len(kept)} of its {len(views)} images have a pose and a focal length that are numbers, "
            "and lie as far away as the others; export a model whose bundle adjustment converged"
        )
    order = sorted(kept, key=lambda i: frame_of[views.names[i]])
    names = tuple(frame_of[views.names[i]] for i in order)
    out, factor = _as_stored(views.take(np.array(order)), names, footage)
    if np.any(np.abs(factor[:, 0] / factor[:, 1] - 1) > 0.01):
        raise InputError(f"{place}: its images have another shape than the footage; import the model of these images")
    sparse = _observed_in(points, np.array(order), len(views), factor)
    return model, out, sparse, _left_out(in_footage, len(kept), len(footage.frames))


def _as_stored(chosen: Views, names: tuple[str, ...], footage: FootageRecord) -> tuple[Views, np.ndarray]:
    """The views as those of the footage's frames `names`, and by what factors (n, 2) their images grow."""
    stamps = {f.name: f.timestamp_ns for f in footage.frames}
    sizes = {f.name: footage.size(f) for f in footage.frames}
    target = np.array([sizes[n] for n in names], float)
    factor = target / chosen.size
    K = chosen.K.copy()
    K[:, 0, 0] *= factor[:, 0]
    K[:, 1, 1] *= factor[:, 1]
    # half a pixel either way: the middle of an image stays its middle when the image is reduced
    K[:, :2, 2] = (K[:, :2, 2] + 0.5) * factor - 0.5
    out = replace(
        chosen,
        names=names,
        K=K,
        size=target.astype(int),
        timestamp_ns=np.array([stamps[n] for n in names], np.int64),
    )
    return out, factor


def _observed_in(points: SparsePoints, order: np.ndarray, views: int, factor: np.ndarray) -> SparsePoints:
    """The points with their observations in the views `order` (n,), of so many, in images larger by factor (n, 2)."""
    row = np.full(views, -1)
    row[order] = np.arange(len(order))
    keep = row[points.obs_view] >= 0
    view = row[points.obs_view[keep]]
    uv = (points.obs_uv[keep] + 0.5) * factor[view] - 0.5
    sorting = np.lexsort((points.obs_point[keep], view))
    return replace(
        points,
        obs_view=view[sorting].astype(np.int32),
        obs_point=points.obs_point[keep][sorting],
        obs_uv=uv[sorting],
    )


def _left_out(in_footage: list[bool], kept: int, frames: int) -> list[str]:
    """Warnings of images that are in one only, or not sound."""
    warnings = []
    if not all(in_footage):
        warnings.append(
            counted(in_footage.count(False), "image of the imported model is", "images of the imported model are")
            + " not in the footage: left out"
        )
    if kept < sum(in_footage):
        warnings.append(
            f"{sum(in_footage) - kept} images of the imported model were left out: their pose or focal length is "
            "no number or at infinity"
        )
    missing = frames - sum(in_footage)
    if missing:
        warnings.append(f"{missing} frames of the footage are not in the imported model and were left out")
    return warnings


def _frame_names(footage: FootageRecord, names: tuple[str, ...]) -> dict[str, str]:
    """Frame name of every model image that belongs to the footage; the model may have the user's own file names."""
    keys: tuple[Any, ...] = (lambda s: s, lambda s: Path(s).name, lambda s: Path(s).stem)
    out: dict[str, str] = {}
    taken: set[str] = set()
    for key in keys:
        table: dict[str, list[str]] = {}
        for frame in footage.frames:
            for frame_key in {key(frame.name), key(frame.source_name or frame.name)}:
                table.setdefault(frame_key, []).append(frame.name)
        for name in names:
            match = table.get(key(name), [])
            if name not in out and len(match) == 1 and match[0] not in taken:
                out[name] = match[0]
                taken.add(match[0])
    return out
