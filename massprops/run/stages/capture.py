"""Stage `capture`: the frames to use, the kind of footage, and silhouettes where a background gives them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from massprops.capture.footage import FEWEST, Chosen, Judged, Source
from massprops.capture.images import printable
from massprops.capture.inputs import Input, open_inputs, same_cameras
from massprops.capture.motion import Scene, camera_places, judge
from massprops.core.files import write_image
from massprops.core.inputs import read_image
from massprops.core.text import counted
from massprops.errors import InputError
from massprops.memory import refuse_beyond
from massprops.run.job import Job

READS = ()
OPTIONS = ("source", "more", "frames", "max_size", "motion", "masks", "focal")

ENOUGH_LIT = 12
"""Frames before black sky that must show something lit, for the others, as in the Earth's shadow, to be left out: of fewer
images no body is seen from all sides."""

BYTES_PER_PIXEL = 4
"""Colours and silhouette of every image, which the dense stage holds at once; nothing holds more."""


def run(job: Job) -> dict[str, Any]:
    """Writes frames/, footage.json and, for a body before a background that stays, masks/."""
    from massprops.capture.footage import choose_all, choose_frames, judge_frames, open_sources, refuse_useless, said

    options, source = job.options, Path(job.options.source)
    placed = open_inputs([source, *map(Path, options.more)], options.focal) if options.more else []
    sources = [p.source for p in placed] or open_sources(source, options.focal)
    judged = [judge_frames(s, job.progress) for s in sources]
    called = [p.label for p in placed] or [f"{source.name}/cam{s.stream}" for s in sources]
    for j, name in zip(judged, called, strict=True):
        refuse_useless(j, source.name if len(sources) == 1 else name)
    left_out = [
        (f"{name}/{e[0]}" if placed else e[0], e[1]) for j, name in zip(judged, called, strict=True) for e in j.left_out
    ]
    if left_out:
        job.warn(f"{counted(len(left_out), 'image was', 'images were')} left out: {said(left_out)}")
    ordered = sources[0].video is not None or sources[0].kind == "sequence"
    places = [camera_places(j.grey) if ordered else np.zeros(len(j.grey), int) for j in judged]
    step = max(1, len(judged[0].grey) // 60)
    scene = judge(judged[0].grey[::step], ordered, places[0][::step])
    if options.motion not in ("auto", scene.motion):
        scene = Scene(options.motion, scene.background, "as given by --motion", scene.plain)
    elif placed and scene.motion != "static":
        scene = Scene("static", scene.background, "several placements were given", scene.plain)
    chosen = (
        [choose_frames(s, j, options.frames) for s, j in zip(sources, judged, strict=True)]
        if placed
        else choose_all(sources, judged, options.frames)
    )
    _refuse_too_many(sources, chosen, options.max_size)
    cameras, frames = _write_placements(job, placed, chosen) if placed else _write_streams(job, sources, chosen)
    for line in dict.fromkeys(line for c in chosen for line in c.warnings):
        job.warn(line)
    if scene.motion == "tumbling" and not placed:
        _enter_places(job, sources, judged, places, frames)
    given = options.masks is not None
    if given:
        _given_masks(job, placed or sources, frames)
    elif scene.motion == "tumbling" or scene.plain:
        _silhouettes(job, scene, frames, source.name)
    footage = {
        "source": str(source),
        "sources": [str(source), *options.more],
        "kind": "images" if placed else "stereo" if len(sources) > 1 else sources[0].kind,
        "motion": scene.motion,
        "motion_reason": scene.reason,
        "background": scene.background,
        "mask_features": bool(given or scene.motion == "tumbling" or scene.plain),
        "masks_given": given,
        "cameras": cameras,
        "frames": frames,
        "given": _given_count(sources, judged),
        "used": len(frames),
        "left_out": [{"source_name": name, "reason": why} for name, why in left_out],
        "warnings": [],
    }
    (job.out / "footage.json").write_text(json.dumps(footage, indent=1))
    facts = {k: footage[k] for k in ("kind", "motion", "motion_reason", "background", "given", "used")}
    return {**facts, "cameras": len(cameras)} if len(cameras) > len(sources) else facts


def _refuse_too_many(sources: list[Source], chosen: list[Chosen], max_size: int) -> None:
    """Stops before stereo, hours later, would find that the images do not fit into the memory beside each other.

    Raises:
        InputError: says how much they would take.
    """
    pixels = 0.0
    for source, c in zip(sources, chosen, strict=True):
        for index in c.index.tolist():
            w, h = source.camera(index).size
            pixels += w * h * min(1.0, max_size / max(w, h)) ** 2
    count = sum(len(c.index) for c in chosen)
    refuse_beyond(
        BYTES_PER_PIXEL * pixels,
        f"{count} images of up to {max_size} pixels",
        "ask for fewer --frames or a smaller --max-size",
    )


def _enter_places(
    job: Job, sources: list[Source], judged: list[Judged], places: list[np.ndarray], frames: list[dict[str, Any]]
) -> None:
    """`camera_place` of every frame, where a still camera was moved in between."""
    for source, j, place in zip(sources, judged, places, strict=True):
        if place.max(initial=0) == 0:
            continue
        job.warn(f"the camera was moved {place.max()} times: a separate background is used for each position")
        at = dict(zip(j.index.tolist(), place.tolist(), strict=True))
        for frame in frames:
            if Path(frame["name"]).parent.name == f"cam{source.stream}":
                frame["camera_place"] = at[frame["index"]]


def _write_streams(
    job: Job, sources: list[Source], chosen: list[Chosen]
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Cameras and frames of one input."""
    cameras: list[dict[str, Any]] = []
    frames: list[dict[str, Any]] = []
    for s, c in zip(sources, chosen, strict=True):
        # COLMAP knows the two halves of a stereo pair by their equal names
        names = [Path(f["name"]).name for f in frames] if len(frames) == len(c.index) else None
        written = _write_frames(job, s, c, names)
        cameras += _cameras(s, written)
        frames += written
    return cameras, frames


def _write_placements(
    job: Job, placed: list[Input], chosen: list[Chosen]
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Cameras and frames of several inputs; a frame's own clock says nothing beside another input's."""
    from massprops.capture.names import stored_names

    wanted = [
        f"{p.label}/{_file_of(p.source, i)}" for p, c in zip(placed, chosen, strict=True) for i in c.index.tolist()
    ]
    names, cameras, frames = stored_names(wanted), [], []
    for p, c in zip(placed, chosen, strict=True):
        before = len(frames)
        written = _write_frames(job, p.source, c, names[before : before + len(c.index)])
        first = len(cameras)
        for number, frame in enumerate(written, start=before):
            frame |= {"timestamp_ns": -1, "own_index": frame["index"], "index": number, "placement": p.placement}
            frame |= {"source_name": f"{p.label}/{frame['source_name']}"}
        cameras += [{**camera, "id": camera["id"] + first} for camera in _cameras(p.source, written)]
        for frame in written:
            frame["camera"] += first
        frames += written
    return same_cameras(cameras, frames), frames


def _file_of(source: Source, index: int) -> str:
    return source.images[index].path.name if source.images else f"{index:06d}.png"


def _given_count(sources: list[Source], judged: list[Judged]) -> int:
    return sum(
        len(s.images) + len(s.left_out) if s.video is None else int(j.index[-1]) + 1
        for s, j in zip(sources, judged, strict=True)
    )


def _write_frames(job: Job, source: Source, chosen: Chosen, names: list[str] | None = None) -> list[dict[str, Any]]:
    """The chosen frames, upright, under names that every tool can read.

    Args:
        names: to be used instead: those of the other half of a stereo pair.
    """
    from massprops.capture.footage import stored_frames
    from massprops.capture.names import stored_names

    folder = job.out / "frames" / f"cam{source.stream}"
    folder.mkdir(parents=True, exist_ok=True)
    place = {int(i): k for k, i in enumerate(chosen.index)}
    if names is None and source.video is None:
        names = stored_names([source.images[i].path.name for i in chosen.index.tolist()])
    frames: list[dict[str, Any]] = []
    for done, (index, original, image) in enumerate(stored_frames(source, chosen, job.options.max_size)):
        job.progress(done + 1, len(chosen.index), f"camera {source.stream}")
        name = original if names is None else names[place[index]]
        width, height = _write_frame(folder / name, image)
        frames.append(
            {
                "name": f"cam{source.stream}/{name}",
                "camera": source.stream + (source.images[index].camera if source.images else 0),
                "turn": source.turn(index),
                "width": width,
                "height": height,
                "timestamp_ns": int(chosen.timestamp_ns[place[index]]),
                "index": int(index),
                "source_name": original,
                "sharpness": round(float(chosen.sharp[place[index]]), 4),
            }
        )
    if not frames:
        raise InputError(f"{source.video}: none of the chosen frames could be decoded; the file is damaged")
    return frames


def _write_frame(path: Path, frame: np.ndarray | bytes) -> tuple[int, int]:
    """A frame (h, w, 3), or the content of a PNG: its width and height."""
    import cv2

    from massprops.capture.images import png_size

    if isinstance(frame, bytes):
        path.write_bytes(frame)
        return png_size(frame)
    png = path.suffix.lower() == ".png"
    write_image(path, frame, (cv2.IMWRITE_PNG_COMPRESSION, 1) if png else (cv2.IMWRITE_JPEG_QUALITY, 97))
    return frame.shape[1], frame.shape[0]


def _cameras(source: Source, frames: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What is known of the cameras of a stream, at the size of the stored frames."""
    out = []
    for number, prior in enumerate(source.cameras, start=source.stream):
        used = [f for f in frames if f["camera"] == number]
        if not used:
            continue
        size = (used[0]["width"], used[0]["height"])
        width, height = size[::-1] if used[0]["turn"] % 2 else size
        factor = max(size) / max(prior.size)
        point = prior.principal_point
        out.append(
            {
                "id": number,
                "width": width,
                "height": height,
                "source_size": list(prior.size),
                "focal_px": None if prior.focal_px is None else prior.focal_px * factor,
                # centres of pixels at whole numbers: a reduction moves the origin by half a pixel
                "principal_point": None if point is None else [(p + 0.5) * factor - 0.5 for p in point],
                "distortion": None if prior.distortion is None else list(prior.distortion),
                "T_BS": None if source.T_BS is None else np.asarray(source.T_BS).tolist(),
                "focal_source": prior.focal_source,
                "device": prior.device,
                "images": len(used),
            }
        )
    return out


def _given_masks(job: Job, sources: list[Source] | list[Input], frames: list[dict[str, Any]]) -> None:
    from massprops.capture.given import GivenMasks, load_mask

    masks = GivenMasks(Path(job.options.masks or ""))
    empty: list[str] = []
    for one in sources:
        source = one.source if isinstance(one, Input) else one
        if isinstance(one, Input):
            frames_of_source = [f for f in frames if f["placement"] == one.placement]
        else:
            frames_of_source = [f for f in frames if f["name"].startswith(f"cam{source.stream}/")]
        mask_files = masks.check([(f["name"], f["source_name"]) for f in frames_of_source])
        for frame, path in zip(frames_of_source, mask_files, strict=True):
            index = frame.get("own_index", frame["index"])
            prior = source.camera(index)
            shown = prior.size[::-1] if frame["turn"] % 2 else prior.size
            file = source.images[index].path if source.images else None
            mask = load_mask(path, shown, (frame["width"], frame["height"]), file)
            if not (mask == 255).any():
                empty.append(frame["source_name"])
            write_image(job.out / "masks" / f"{frame['name']}.png", mask)
    some = ", ".join(printable(n) for n in empty[:3]) + (", ..." if len(empty) > 3 else "")
    if len(frames) - len(empty) < FEWEST:
        raise InputError(
            f"{masks.folder}: {len(empty)} of {len(frames)} masks hold none of the object (all black: {some}); white is "
            "the object"
        )
    if empty:
        job.warn(f"{len(empty)} masks are all black ({some}): the object is taken not to be seen in those images")


def _silhouettes(job: Job, scene: Scene, frames: list[dict[str, Any]], name: str) -> None:
    from massprops.capture import silhouette as s

    images = job.out / "frames"
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for frame in frames:
        groups.setdefault(_same_picture(frame), []).append(frame)
    cut = {key: _cut(scene, [read_image(images / f["name"]) for f in _spread(group)]) for key, group in groups.items()}
    _enter_beside(job, groups, cut)
    looked_at = {f["name"] for group in groups.values() for f in _spread(group)}
    masks, empty = [], []
    for done, frame in enumerate(frames):
        separate = cut[_same_picture(frame)]
        if separate is None:
            continue
        mask = separate.mask(read_image(images / frame["name"]))
        if not mask.any():
            empty.append(frame)
        if frame["name"] in looked_at:
            masks.append(mask)
        write_image(job.out / "masks" / f"{frame['name']}.png", mask)
        job.progress(done + 1, len(frames), "silhouettes")
    if empty and scene.background == "black" and len(frames) - len(empty) >= ENOUGH_LIT:
        job.warn(f"nothing is lit in {len(empty)} of {len(frames)} frames: they are left out")
        _drop(job, frames, empty)
        empty = []
    if len(empty) > 0.5 * len(frames):
        raise InputError(
            f"{name}: no object stands out from the background in {len(empty)} of {len(frames)} frames; give --masks"
        )
    if scene.plain and scene.motion == "static":
        _by_colour(job, frames)
    if empty:
        job.warn(f"no object stands out from the background in {len(empty)} of {len(frames)} frames")
    if scene.motion == "tumbling" and (line := s.main_object(masks, name)) is not None:
        job.warn(line)


def _drop(job: Job, frames: list[dict[str, Any]], gone: list[dict[str, Any]]) -> None:
    """Takes frames out, and the files that were written for them."""
    for frame in gone:
        (job.out / "frames" / frame["name"]).unlink()
        (job.out / "masks" / f"{frame['name']}.png").unlink()
    frames[:] = [f for f in frames if f not in gone]


def _enter_beside(job: Job, groups: dict[tuple[Any, ...], list[dict[str, Any]]], cut: dict[Any, Any]) -> None:
    """`beside` of frames in which something bright stays at the edge: an image, white where no silhouette is known."""
    for number, (key, group) in enumerate(groups.items()):
        if cut[key] is None or cut[key].beside is None:
            continue
        name = f"beside/{number}.png"
        write_image(job.out / name, np.where(cut[key].beside, 255, 0).astype(np.uint8))
        for frame in group:
            frame["beside"] = name
        share = 100 * float(cut[key].beside.mean())
        job.warn(
            f"something bright stays at the image's edge, such as a planet's limb: {share:.0f} % of the image is not used "
            "for silhouettes"
        )


def _same_picture(frame: dict[str, Any]) -> tuple[Any, ...]:
    """Frames with equal keys show one background at the same pixels, if it stays at all."""
    return (
        Path(frame["name"]).parent.name,
        frame["camera"],
        frame["width"],
        frame["height"],
        frame.get("camera_place", 0),
    )


def _spread(frames: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return frames[:: max(1, len(frames) // 24)]


@dataclass(frozen=True)
class _Separate:
    """What parts object and background: `mask` of an image, and where it can say nothing, (h, w) bool or None."""

    mask: Callable[[np.ndarray], np.ndarray]
    beside: np.ndarray | None = None


def _cut(scene: Scene, sample: list[np.ndarray]) -> _Separate | None:
    """What parts object and background, learnt from frames of one camera (n of (h, w, 3)); None from too few."""
    import cv2

    from massprops.capture import silhouette as s
    from massprops.capture.limb import always_bright

    if scene.background == "black":
        grey = np.stack([cv2.cvtColor(i, cv2.COLOR_BGR2GRAY) for i in sample])
        level, sigma = s.sky_level(grey)
        beside = always_bright(grey)

        def sky(image: np.ndarray) -> np.ndarray:
            seen = np.where(beside, np.uint8(level), cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
            return s.against_sky(seen, level, sigma)

        return _Separate(sky, beside if beside.any() else None)
    if scene.plain and scene.motion == "static":
        return _Separate(s.against_plain)
    if len(sample) < FEWEST:
        return None
    stack = np.stack(sample)
    middle = np.median(stack, axis=0).astype(np.uint8)
    deviation = np.median(np.abs(stack.astype(np.int16) - middle), axis=0).astype(np.uint8)
    return _Separate(lambda image: s.against_background(image, middle, deviation))


def _by_colour(job: Job, frames: list[dict[str, Any]]) -> None:
    """Silhouettes before a plain backdrop once more, with the colours that all frames agree on."""

    from massprops.capture.colours import LEARN_AT, agrees, learn
    from massprops.capture.images import reduce

    def both(frame: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
        mask = read_image(job.out / "masks" / f"{frame['name']}.png", 0)
        return read_image(job.out / "frames" / frame["name"]), mask

    taught = [both(f) for f in frames[:: max(1, len(frames) // 120)]]
    taught = [(reduce(image, LEARN_AT), reduce(mask, LEARN_AT)) for image, mask in taught if mask.any()]
    if len(taught) < 3:
        return
    colours = learn([image for image, _ in taught], [mask for _, mask in taught])
    for done, frame in enumerate(frames):
        image, mask = both(frame)
        silhouette = colours.segment(image)
        if not mask.any() or agrees(silhouette, mask > 127):
            write_image(job.out / "masks" / f"{frame['name']}.png", np.where(silhouette, 255, 0).astype(np.uint8))
        job.progress(done + 1, len(frames), "colours")
