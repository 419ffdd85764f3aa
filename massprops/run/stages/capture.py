"""Stage `capture`: the frames to use, the kind of footage, and silhouettes where a background gives them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from massprops.errors import InputError
from massprops.run.files import read_image
from massprops.run.job import Job

READS = ()
OPTIONS = ("source", "frames", "max_size", "motion", "masks", "focal")


def run(job: Job) -> dict:
    """Writes frames/, footage.json and, for a body before a background that stays, masks/."""
    from massprops.capture.footage import choose_all, judge_frames, open_sources, refuse_useless
    from massprops.capture.motion import Scene, judge

    options, source = job.options, Path(job.options.source)
    sources = open_sources(source, options.focal)
    judged = [judge_frames(s, job.progress) for s in sources]
    for s, j in zip(sources, judged, strict=True):
        refuse_useless(j, source.name if len(sources) == 1 else f"{source.name}/cam{s.camera}")
    ordered = sources[0].video is not None or sources[0].kind == "sequence"
    scene = judge(judged[0].grey[:: max(1, len(judged[0].grey) // 60)], ordered)
    if options.motion not in ("auto", scene.motion):
        scene = Scene(options.motion, scene.background, "as given by --motion", scene.plain)
    chosen = choose_all(sources, judged, options.frames)
    cameras, frames = [], []
    for s, c in zip(sources, chosen, strict=True):
        # COLMAP knows the two halves of a stereo pair by their equal names
        names = [Path(f["name"]).name for f in frames] if len(frames) == len(c.index) else None
        camera, written = _write_frames(job, s, c, names)
        cameras.append(camera)
        frames += written
        for line in c.warnings:
            job.warn(line)
    given = options.masks is not None
    if given:
        _given_masks(job, sources, cameras, frames)
    elif scene.motion == "tumbling" or scene.plain:
        _silhouettes(job, scene, frames, source.name)
    footage = {
        "source": str(source),
        "kind": "stereo" if len(sources) > 1 else sources[0].kind,
        "motion": scene.motion,
        "motion_reason": scene.reason,
        "background": scene.background,
        "mask_features": bool(given or scene.motion == "tumbling" or scene.plain),
        "masks_given": given,
        "cameras": cameras,
        "frames": frames,
        "given": int(sum(len(s.images) or int(j.index[-1]) + 1 for s, j in zip(sources, judged, strict=True))),
        "used": len(frames),
        "warnings": [],
    }
    (job.out / "footage.json").write_text(json.dumps(footage, indent=1))
    return {k: footage[k] for k in ("kind", "motion", "motion_reason", "background", "given", "used")}


def _write_frames(  # type: ignore[no-untyped-def]
    job: Job, source, chosen, names: list[str] | None = None
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    import cv2

    from massprops.capture.footage import full_frames

    folder = job.out / "frames" / f"cam{source.camera}"
    folder.mkdir(parents=True)
    place = {int(i): k for k, i in enumerate(chosen.index)}
    frames: list[dict[str, Any]] = []
    size = None
    for done, (index, name, image) in enumerate(full_frames(source, chosen, job.options.max_size)):
        job.progress(done + 1, len(chosen.index), f"camera {source.camera}")
        size = (image.shape[1], image.shape[0])
        original = name
        if names is not None:
            name = names[place[index]]
        lossless = [cv2.IMWRITE_PNG_COMPRESSION, 1] if name.lower().endswith(".png") else [cv2.IMWRITE_JPEG_QUALITY, 97]
        ending = Path(name).suffix.lower()
        if ending not in (".png", ".jpg", ".jpeg"):
            name, lossless = f"{name}.png", [cv2.IMWRITE_PNG_COMPRESSION, 1]
        if not cv2.imwrite(str(folder / name), image, lossless):
            raise OSError(28, "the frames cannot be written", str(folder / name))
        frames.append(
            {
                "name": f"cam{source.camera}/{name}",
                "camera": source.camera,
                "timestamp_ns": int(chosen.timestamp_ns[place[index]]),
                "index": int(index),
                "source_name": original,
                "sharpness": round(float(chosen.sharp[place[index]]), 4),
            }
        )
    if size is None:
        raise InputError(f"{source.video}: none of the chosen frames could be decoded; the file is damaged")
    factor = size[0] / source.size[0]
    point = source.principal_point
    camera = {
        "id": source.camera,
        "width": size[0],
        "height": size[1],
        "source_size": list(source.size),
        "focal_px": None if source.focal_px is None else source.focal_px * factor,
        # centres of pixels at whole numbers: a reduction moves the origin by half a pixel
        "principal_point": None if point is None else [(p + 0.5) * factor - 0.5 for p in point],
        "distortion": None if source.distortion is None else list(source.distortion),
        "T_BS": None if source.T_BS is None else np.asarray(source.T_BS).tolist(),
        "focal_source": source.focal_source,
    }
    return camera, frames


def _given_masks(job: Job, sources: list, cameras: list[dict], frames: list[dict]) -> None:
    import cv2

    from massprops.capture.given import check_masks, find_mask, load_mask

    folder = Path(job.options.masks or "")
    for source, camera in zip(sources, cameras, strict=True):
        mine = [f for f in frames if f["camera"] == source.camera]
        check_masks(folder, source.camera, [f["source_name"] for f in mine])
        for frame in mine:
            path = find_mask(folder, source.camera, frame["source_name"])
            assert path is not None
            mask = load_mask(path, source.size, (camera["width"], camera["height"]))
            _save(cv2, job.out / "masks" / f"{frame['name']}.png", mask)


def _silhouettes(job: Job, scene, frames: list[dict], name: str) -> None:  # type: ignore[no-untyped-def]
    import cv2

    from massprops.capture import silhouette as s

    images = job.out / "frames"
    spread = frames[:: max(1, len(frames) // 24)]
    sample = [read_image(images / f["name"]) for f in spread]
    if scene.background == "black":
        level, sigma = s.sky_level(np.stack([cv2.cvtColor(i, cv2.COLOR_BGR2GRAY) for i in sample]))
    elif not scene.plain:
        stack = np.stack(sample)
        middle = np.median(stack, axis=0).astype(np.uint8)
        deviation = np.median(np.abs(stack.astype(np.int16) - middle), axis=0).astype(np.uint8)
    masks, empty = [], 0
    for done, frame in enumerate(frames):
        image = read_image(images / frame["name"])
        if scene.background == "black":
            mask = s.against_sky(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), level, sigma)
        elif scene.plain and scene.motion == "static":
            mask = s.against_plain(image)
        else:
            mask = s.against_background(image, middle, deviation)
        empty += not mask.any()
        if frame in spread:
            masks.append(mask)
        _save(cv2, job.out / "masks" / f"{frame['name']}.png", mask)
        job.progress(done + 1, len(frames), "silhouettes")
    if empty > 0.5 * len(frames):
        raise InputError(
            f"{name}: no object stands out from the background in {empty} of {len(frames)} frames; give --masks"
        )
    if scene.plain and scene.motion == "static":
        _by_colour(job, frames)
    if empty:
        job.warn(f"no object stands out from the background in {empty} of {len(frames)} frames")
    if scene.motion == "tumbling" and (line := s.main_object(masks, name)) is not None:
        job.warn(line)


def _by_colour(job: Job, frames: list[dict]) -> None:
    """Silhouettes before a plain backdrop once more, with the colours that all frames agree on."""
    import cv2

    from massprops.capture.colours import LEARN_AT, agrees, learn
    from massprops.capture.images import reduce

    def both(frame: dict) -> tuple[np.ndarray, np.ndarray]:
        mask = read_image(job.out / "masks" / f"{frame['name']}.png", 0)
        return read_image(job.out / "frames" / frame["name"]), mask

    taught = [both(f) for f in frames[:: max(1, len(frames) // 120)]]
    taught = [(reduce(image, LEARN_AT), reduce(mask, LEARN_AT)) for image, mask in taught if mask.any()]
    if len(taught) < 3:
        return
    colours = learn([image for image, _ in taught], [mask for _, mask in taught])
    for done, frame in enumerate(frames):
        image, mask = both(frame)
        found = colours.separate(image)
        if not mask.any() or agrees(found, mask > 127):
            _save(cv2, job.out / "masks" / f"{frame['name']}.png", np.where(found, 255, 0).astype(np.uint8))
        job.progress(done + 1, len(frames), "colours")


def _save(cv2, path: Path, mask: np.ndarray) -> None:  # type: ignore[no-untyped-def]
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), mask)
