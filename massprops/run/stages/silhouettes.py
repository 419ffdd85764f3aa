"""Stage `silhouettes`: 255 object, 0 background, 128 cannot tell, for every registered view."""

from __future__ import annotations

import json

import numpy as np

from massprops.errors import NotPossible
from massprops.run.job import Job

READS = ("capture", "sfm")
OPTIONS = ()


def run(job: Job) -> dict:
    """Writes masks/ (in the geometry of the stored frames) and silhouettes.json."""
    import cv2

    from massprops.views import Views

    capture, sfm = job.work("capture"), job.work("sfm")
    footage = json.loads((capture / "footage.json").read_text())
    views = Views.load(sfm / "views.npz")
    with np.load(sfm / "points.npz", allow_pickle=False) as z:
        points, seen = z["xyz"], np.bincount(z["obs_point"], minlength=len(z["xyz"]))
    have = [(capture / "masks" / f"{name}.png").is_file() for name in views.names]
    if all(have):
        share = _refine(job, cv2, views, points[seen >= 3], footage)
        method = "given" if footage.get("masks_given") else f"before a {footage['background']} background"
    else:
        share = _cut(job, cv2, views, points, footage)
        method = "grabcut seeded by the reconstruction"
    facts = {"method": method, "views": len(views), "median_object_share": float(np.median(share))}
    if np.median(share) < 5e-4:
        raise NotPossible("the object fills less than 0.05 % of the image: film it closer")
    (job.out / "silhouettes.json").write_text(json.dumps(facts, indent=1))
    return facts


def _pixels(views, i: int, points: np.ndarray) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Projections into the stored (distorted) frame, of points before the camera."""
    import cv2

    from massprops.capture.doubt import project

    uv, depth = project(points, views.K[i], views.R[i], views.t[i])
    uv = uv[depth > 0]
    if np.any(views.distortion[i]) and len(uv):
        camera = np.column_stack([(uv - views.K[i][:2, 2]) / np.diag(views.K[i])[:2], np.ones(len(uv))])
        uv = cv2.projectPoints(camera[:, None], np.zeros(3), np.zeros(3), views.K[i], views.distortion[i])[0][:, 0]
    return uv


def _refine(job: Job, cv2, views, points: np.ndarray, footage: dict) -> list[float]:  # type: ignore[no-untyped-def]
    """The capture stage's masks; before a sky or background, doubt where the reconstruction knows of body."""
    from massprops.capture.doubt import predicted_silhouette, with_doubt

    share = []
    for i, name in enumerate(views.names):
        mask = cv2.imread(str(job.work("capture") / "masks" / f"{name}.png"), cv2.IMREAD_GRAYSCALE)
        if not footage.get("masks_given"):
            mask = with_doubt(mask, predicted_silhouette(_pixels(views, i, points), mask.shape))
        share.append(_save(job, cv2, name, mask))
        job.progress(i + 1, len(views), "doubt")
    return share


def _cut(job: Job, cv2, views, points: np.ndarray, footage: dict) -> list[float]:  # type: ignore[no-untyped-def]
    """GrabCut for a still object, seeded by its own points and those of what it stands on."""
    from massprops.capture.doubt import predicted_silhouette
    from massprops.capture.grabcut import cut_out
    from massprops.capture.still_object import split_scene

    scene = split_scene(points, views.centres, views.R[:, 2], job.seed)
    own, other = points[scene.object], points[~scene.object]
    share = []
    for i, name in enumerate(views.names):
        image = cv2.imread(str(job.work("capture") / "frames" / name))
        shape = image.shape[:2]
        uv = _pixels(views, i, own)
        body = predicted_silhouette(uv, shape)
        away = np.zeros(shape, np.uint8)
        reach = round(0.10 * max(np.ptp(uv[:, 0]), np.ptp(uv[:, 1]))) if len(uv) else 20
        wide = cv2.dilate(body.astype(np.uint8), np.ones((2 * reach + 1,) * 2, np.uint8)) > 0
        away[~wide] = 1
        for u, v in np.round(_pixels(views, i, other)).astype(int):
            if 0 <= u < shape[1] and 0 <= v < shape[0] and not body[v, u]:
                cv2.circle(away, (int(u), int(v)), 2, 1, -1)
        surely = np.zeros(shape, np.uint8)
        for u, v in np.round(uv).astype(int):
            if 0 <= u < shape[1] and 0 <= v < shape[0]:
                cv2.circle(surely, (int(u), int(v)), 2, 1, -1)
        core = cv2.erode(body.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
        share.append(_save(job, cv2, name, cut_out(image, body, (surely > 0) & core, away > 0)))
        job.progress(i + 1, len(views), "grabcut")
    if len(own) < 100:
        job.warn(f"only {len(own)} points lie on the object: its silhouettes are rough; give --masks for better ones")
    return share


def _save(job: Job, cv2, name: str, mask: np.ndarray) -> float:  # type: ignore[no-untyped-def]
    path = job.out / "masks" / f"{name}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), mask)
    return float(np.mean(mask == 255))
