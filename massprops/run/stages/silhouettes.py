"""Stage `silhouettes`: 255 object, 0 background, 128 cannot tell, for every registered view."""

from __future__ import annotations

import json

import numpy as np

from massprops.errors import NotPossible
from massprops.run.files import read_image
from massprops.run.job import Job

READS = ("capture", "sfm", "shape")
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
    support, left_out = None, []
    have = [(capture / "masks" / f"{name}.png").is_file() for name in views.names]
    if all(have):
        share = _refine(job, cv2, views, points[seen >= 3], footage)
        method = "given" if footage.get("masks_given") else f"before a {footage['background']} background"
    else:
        plane = json.loads((job.work("shape") / "shape.json").read_text())["support_plane"]
        support = None if plane is None else np.array(plane)
        share, left_out = _from_shape(job, views)
        method = "drawn from the shape, refined by the images"
        if left_out:
            job.warn(
                f"{len(left_out)} images show the object in another place than the others and are left out: "
                + ", ".join(left_out[:5])
                + (" ..." if len(left_out) > 5 else "")
            )
    facts = {
        "method": method,
        "left_out": left_out,
        "support_plane": None if support is None else support.tolist(),
        "views": len(views),
        "median_object_share": float(np.median(share)),
    }
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


def _from_shape(job: Job, views) -> tuple[list[float], list[str]]:  # type: ignore[no-untyped-def]
    """Silhouettes drawn from the shape stage's body and refined by each image; views that show it elsewhere left out."""
    import cv2

    from massprops.capture.from_shape import moved, overlap, refine, to_stored, trimap
    from massprops.geometry.rasterise import rasterise
    from massprops.views import undistort

    with np.load(job.work("shape") / "shape.npz", allow_pickle=False) as z:
        vertices, faces = z["vertices"], z["faces"]
    with np.load(job.work("shape") / "other.npz", allow_pickle=False) as z:
        other = z["xyz"]
    found, agreement = [], []
    for i, name in enumerate(views.names):
        K, R, t = views.K[i], views.R[i], views.t[i]
        image = undistort(read_image(job.work("capture") / "frames" / name), K, views.distortion[i])
        depth, _ = rasterise(vertices, faces, K, R, t, (image.shape[1], image.shape[0]))
        camera = other @ R.T + t
        camera = camera[camera[:, 2] > 0]
        known = trimap(depth, camera[:, :2] / camera[:, 2:] @ K[:2, :2].T + K[:2, 2], camera[:, 2])
        found.append(refine(image, known))
        agreement.append(overlap(found[-1], known.drawn))
        job.progress(i + 1, len(views), "silhouettes")
    out = moved(np.array(agreement))
    share = []
    for i, name in enumerate(views.names):
        if out[i]:
            mask = np.full((views.size[i, 1], views.size[i, 0]), 128, np.uint8)
        else:
            mask = to_stored(found[i], tuple(views.size[i]), views.K[i], views.distortion[i])
        stored = _save(job, cv2, name, mask)
        if not out[i]:
            share.append(stored)
    return share, [name for i, name in enumerate(views.names) if out[i]]


def _save(job: Job, cv2, name: str, mask: np.ndarray) -> float:  # type: ignore[no-untyped-def]
    path = job.out / "masks" / f"{name}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), mask)
    return float(np.mean(mask == 255))
