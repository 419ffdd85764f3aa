"""Stage `silhouettes`: 255 object, 0 background, 128 cannot tell, for every registered view."""

from __future__ import annotations

import json
from functools import partial
from typing import Any

import numpy as np

from massprops.capture.before import something_before
from massprops.capture.frame_edge import cut_off
from massprops.capture.from_shape import Paint, agreement, moved, shows_support
from massprops.core.files import write_image
from massprops.core.inputs import read_image
from massprops.core.parts import Arrays
from massprops.core.text import counted
from massprops.errors import NotPossible
from massprops.run.drawn_silhouettes import DRAWN, drawn_silhouette, learned_paint, scene_in, stored
from massprops.run.job import Job
from massprops.run.stage_images import undistorted_frame
from massprops.sfm.footage import mask_file
from massprops.views import AMBIGUOUS, Views

READS = ("capture", "sfm", "shape")
OPTIONS = ()


def run(job: Job) -> dict[str, Any]:
    """Writes masks/ (in the geometry of the stored frames) and silhouettes.json."""
    capture, sfm = job.work("capture"), job.work("sfm")
    footage = json.loads((capture / "footage.json").read_text())
    views = Views.load(sfm / "views.npz")
    with np.load(sfm / "points.npz", allow_pickle=False) as z:
        points, seen = z["xyz"], np.bincount(z["obs_point"], minlength=len(z["xyz"]))
    left_out: list[str] = []
    have = [(capture / "masks" / f"{name}.png").is_file() for name in views.names]
    shape = json.loads((job.work("shape") / "shape.json").read_text())
    given = bool(footage.get("masks_given"))
    if all(have) and (given or not shape["placements"]):
        share = _refine(job, views, points[seen >= 3], footage)
        left_out = [name for gone in shape["lost"] for name in gone["images"]]
        method = "given" if given else f"before a {footage['background']} background"
    else:
        share, left_out = _from_shapes(job, views, shape["placements"])
        method = DRAWN
        if left_out:
            job.warn(
                counted(len(left_out), "image shows", "images show")
                + " the object in another place than the others, left out: "
                + ", ".join(left_out[:5])
                + (" ..." if len(left_out) > 5 else "")
            )
        left_out += [name for gone in shape["lost"] for name in gone["images"]]
    cut = _cut_off(job, views.names, set(left_out))
    facts = {
        "method": method,
        "left_out": left_out,
        "cut_off": cut,
        "views": len(views),
        "median_object_share": float(np.median(share)),
    }
    if np.median(share) < 5e-4:
        raise NotPossible("the object fills less than 0.05 % of the image: film it closer")
    (job.out / "silhouettes.json").write_text(json.dumps(facts, indent=1))
    return facts


def _cut_off(job: Job, names: tuple[str, ...], left_out: set[str]) -> list[str]:
    """Images in which the object goes on beyond the frame."""
    used = [name for name in names if name not in left_out]
    cut = [name for name in used if cut_off(read_image(job.out / "masks" / f"{name}.png", 0))]
    if len(cut) > 0.1 * len(used):
        job.warn(
            f"the object, or what is taken for it, reaches the edge of the frame in {len(cut)} of {len(used)} images: step "
            "back so that all of it is seen, and keep hands and arms out"
        )
    return cut


def _pixels(views: Views, i: int, points: np.ndarray) -> np.ndarray:
    """Projections into the stored (distorted) frame, of points before the camera."""
    import cv2

    from massprops.geometry.projection import project

    uv, depth = project(points, views.K[i], views.R[i], views.t[i])
    uv = uv[depth > 0]
    if np.any(views.distortion[i]) and len(uv):
        camera = np.column_stack([(uv - views.K[i][:2, 2]) / np.diag(views.K[i])[:2], np.ones(len(uv))])
        uv = cv2.projectPoints(camera[:, None], np.zeros(3), np.zeros(3), views.K[i], views.distortion[i])[0][:, 0]
    return uv


def _refine(job: Job, views: Views, points: np.ndarray, footage: dict[str, Any]) -> list[float]:
    """The capture stage's masks; before a sky or background, doubt where the reconstruction knows of body."""
    from massprops.capture.limb import without
    from massprops.capture.unknown_pixels import predicted_silhouette, with_unknown

    beside = {f["name"]: f["beside"] for f in footage["frames"] if f.get("beside")}
    share = []
    for i, name in enumerate(views.names):
        mask = read_image(mask_file(job.run / "work", name), 0)
        if not footage.get("masks_given"):
            mask = with_unknown(mask, predicted_silhouette(_pixels(views, i, points), mask.shape))
        if name in beside:
            mask = without(mask, read_image(job.work("capture") / beside[name], 0) > 0)
        share.append(_save(job, name, mask))
        job.progress(i + 1, len(views), "doubt")
    return share


def _from_shapes(job: Job, views: Views, placements: list[dict[str, Any]]) -> tuple[list[float], list[str]]:
    """Silhouettes of every placement; images of none of them, and such as show it elsewhere, say nothing.

    Returns:
        share of the object in each image that is used, and the names of those left out.
    """
    from massprops.run.stages.shape import measured_folders

    number = {name: i for i, name in enumerate(views.names)}
    mask_by_view: dict[int, np.ndarray] = {}
    painted = learned_paint(measured_folders(job.work("shape"), placements))
    for k, placement in enumerate(placements):
        index = np.array([number[name] for name in placement["images"]])
        masks, out = _placement(job, views, index, k, len(mask_by_view), painted)
        mask_by_view.update({int(i): mask for i, mask, o in zip(index, masks, out, strict=True) if not o})
    share = []
    for i, name in enumerate(views.names):
        if i in mask_by_view:
            share.append(_save(job, name, stored(mask_by_view[i], views, i)))
        else:
            _save(job, name, np.full((views.size[i, 1], views.size[i, 0]), AMBIGUOUS, np.uint8))
    known = {name for p in placements for name in p["images"]}
    return share, [n for i, n in enumerate(views.names) if i not in mask_by_view and n in known]


def _placement(
    job: Job, views: Views, index: np.ndarray, number: int, before: int, painted: Paint | None
) -> tuple[list[np.ndarray], np.ndarray]:
    """Silhouettes (h, w) uint8 of n views, drawn from a placement's shape and refined, and which of these show it elsewhere, (n,) bool.

    Args:
        index: rows of its views; number: its own; before: views done before it.
        painted: colours of the object, which tell what a silhouette may lack: 128.
    """
    from massprops.run.stages.shape import placement_folder

    folder = placement_folder(job.work("shape"), number)
    shown = scene_in(folder, painted)

    def silhouette(i: int) -> Arrays:
        mask, known, hidden = drawn_silhouette(undistorted_frame(job, views, i), views, i, shown)
        facts = {"overlap": agreement(mask == 255, known), "hidden": hidden, "bare": shows_support(known)}
        return {"mask": mask, **{name: np.array(fact) for name, fact in facts.items()}}

    drawn = []
    for done, i in enumerate(index):
        drawn.append(job.parts.made(f"silhouette {number} {views.names[i]}", partial(silhouette, i)))
        job.progress(before + done + 1, len(views), "silhouettes")
    agrees, hidden, bare = (np.array([one[name] for one in drawn]) for name in ("overlap", "hidden", "bare"))
    covered = [views.names[i] for i in index[something_before(hidden)]]
    if covered:
        job.warn(
            f"something that is not the object, such as a hand, is in front of it in {counted(len(covered), 'image', 'images')} "
            f"({', '.join(covered[:3])}{', ...' if len(covered) > 3 else ''}): leave them out, or correct their masks "
            "('massprops masks')"
        )
    return [one["mask"] for one in drawn], moved(agrees, bare)


def _save(job: Job, name: str, mask: np.ndarray) -> float:
    """Writes a silhouette; gives the share of the image that is object."""
    write_image(job.out / "masks" / f"{name}.png", mask)
    return float(np.mean(mask == 255))
