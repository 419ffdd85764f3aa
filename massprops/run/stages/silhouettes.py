"""Stage `silhouettes`: 255 object, 0 background, 128 cannot tell, for every registered view."""

from __future__ import annotations

import json

import numpy as np

from massprops.errors import NotPossible
from massprops.run.files import read_image
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
    support = None
    have = [(capture / "masks" / f"{name}.png").is_file() for name in views.names]
    if all(have):
        share = _refine(job, cv2, views, points[seen >= 3], footage)
        method = "given" if footage.get("masks_given") else f"before a {footage['background']} background"
    else:
        share, method, support = _cut(job, views, points)
    facts = {
        "method": method,
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


def _cut(job: Job, views, points: np.ndarray) -> tuple[list[float], str, np.ndarray | None]:  # type: ignore[no-untyped-def]
    """A still object, seeded by its own points: against the table's picture, or by GrabCut where there is no table."""
    from massprops.capture.still_object import split_scene

    scene = split_scene(points, views.centres, views.R[:, 2], job.seed)
    own, other = points[scene.object], points[~scene.object]
    if len(own) < 100:
        job.warn(f"only {len(own)} points lie on the object: its silhouettes are rough; give --masks for better ones")
    if scene.plane is not None and len(views) >= 8:
        return _against_table(job, views, scene, own), "against the table's own picture", scene.plane
    return _by_grabcut(job, views, own, other), "grabcut seeded by the reconstruction", scene.plane


def _against_table(job: Job, views, scene, own: np.ndarray) -> list[float]:  # type: ignore[no-untyped-def]
    import cv2

    from massprops.capture.doubt import predicted_silhouette, project
    from massprops.capture.table import cut, picture, reduced_camera, strangeness, to_stored
    from massprops.views import undistort

    images, cameras, bodies, surely, aways = [], [], [], [], []
    for i, name in enumerate(views.names):
        image = read_image(job.work("capture") / "frames" / name)
        small, K = reduced_camera(undistort(image, views.K[i], views.distortion[i]), views.K[i])
        uv, depth = project(own, K, views.R[i], views.t[i])
        uv = uv[depth > 0]
        body = predicted_silhouette(uv, small.shape[:2])
        dots = _dots(uv, body.shape, 0)
        reach = round(0.25 * max(np.ptp(uv, axis=0))) if len(uv) else 20
        images.append(small)
        cameras.append((K, views.R[i], views.t[i]))
        bodies.append(body)
        surely.append(dots & (cv2.erode(body.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0))
        aways.append(cv2.dilate(body.astype(np.uint8), np.ones((2 * reach + 1,) * 2, np.uint8)) == 0)
        job.progress(i + 1, 2 * len(views), "table")
    distance = float(np.median(np.linalg.norm(views.centres - scene.centre, axis=1)))
    step = distance / float(np.median([K[0, 0] for K, _, _ in cameras]))
    table = picture(images, bodies, cameras, scene.plane, scene.centre, 4.0 * scene.radius, step)
    share = []
    for i, name in enumerate(views.names):
        strange, state = strangeness(images[i], table, *cameras[i], aways[i])
        found = cut(images[i], strange, state, surely[i], aways[i])
        mask = to_stored(found, tuple(views.size[i]), views.K[i], views.distortion[i])
        share.append(_save(job, cv2, name, mask))
        job.progress(len(views) + i + 1, 2 * len(views), "table")
    return share


def _by_grabcut(job: Job, views, own: np.ndarray, other: np.ndarray) -> list[float]:  # type: ignore[no-untyped-def]
    import cv2

    from massprops.capture.doubt import predicted_silhouette
    from massprops.capture.grabcut import cut_out

    share = []
    for i, name in enumerate(views.names):
        image = read_image(job.work("capture") / "frames" / name)
        shape = image.shape[:2]
        uv = _pixels(views, i, own)
        body = predicted_silhouette(uv, shape)
        reach = round(0.10 * max(np.ptp(uv[:, 0]), np.ptp(uv[:, 1]))) if len(uv) else 20
        away = cv2.dilate(body.astype(np.uint8), np.ones((2 * reach + 1,) * 2, np.uint8)) == 0
        away |= _dots(_pixels(views, i, other), shape, 2) & ~body
        core = cv2.erode(body.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
        share.append(_save(job, cv2, name, cut_out(image, body, _dots(uv, shape, 2) & core, away)))
        job.progress(i + 1, len(views), "grabcut")
    return share


def _dots(uv: np.ndarray, shape: tuple[int, int], radius: int) -> np.ndarray:
    """(h, w) bool: discs about projected points."""
    import cv2

    dots = np.zeros(shape, np.uint8)
    for u, v in np.round(uv).astype(int):
        if 0 <= u < shape[1] and 0 <= v < shape[0]:
            cv2.circle(dots, (int(u), int(v)), radius, 1, -1)
    return dots > 0


def _save(job: Job, cv2, name: str, mask: np.ndarray) -> float:  # type: ignore[no-untyped-def]
    path = job.out / "masks" / f"{name}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), mask)
    return float(np.mean(mask == 255))
