"""From a path to the frames that will be used, with what is known of the cameras."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from massprops.capture.images import Photograph, inspect, list_images, load, reduce
from massprops.capture.keyframes import choose, sharpness, view_motion
from massprops.capture.video import read_video
from massprops.errors import InputError, NotPossible

LOOK = 320
"""Longer side of the small frames on which frames are judged [px]."""

MOST_LOOKED_AT = 1500
"""Frames of a video that are judged; of longer ones every n-th."""


@dataclass(frozen=True)
class Source:
    """One camera's images, not yet chosen.

    Attributes:
        camera: 0 or 1.
        kind: `video`, `images` or `sequence`.
        video: the file, or None.
        images: (timestamp_ns or -1, file) of single images.
        size: width, height upright [px].
        focal_px: at that size, or None.
        focal_source: given, exif or none.
        principal_point, distortion, T_BS: where the sensor file gives them.
    """

    camera: int
    kind: str
    video: Path | None
    images: tuple[tuple[int, Path], ...]
    size: tuple[int, int]
    focal_px: float | None = None
    focal_source: str = "none"
    principal_point: tuple[float, float] | None = None
    distortion: tuple[float, ...] | None = None
    T_BS: np.ndarray | None = None


@dataclass(frozen=True)
class Judged:
    """Small frames of a source: index, timestamp_ns (n,), grey (n, h, w) uint8, sharp (n,), motion (n,)."""

    index: np.ndarray
    timestamp_ns: np.ndarray
    grey: np.ndarray
    sharp: np.ndarray
    motion: np.ndarray


@dataclass(frozen=True)
class Chosen:
    """Frames to use of one source: positions in the source, their clocks and sharpness."""

    index: np.ndarray
    timestamp_ns: np.ndarray
    sharp: np.ndarray
    warnings: tuple[str, ...] = field(default=())


def open_sources(path: Path, focal: float | None = None) -> list[Source]:
    """What the input holds: one source per camera.

    Args:
        path: video, folder of images, or sequence folder.
        focal: focal length given by the user [px of the source images].

    Raises:
        InputError: nothing there that can be used; images of different sizes; a damaged file.
    """
    if path.is_dir() and any((path / f"cam{i}").is_dir() for i in (0, 1)):
        sources = _sequence_sources(path)
    elif path.is_dir():
        sources = [_folder_source(path, list_images(path), 0)]
    else:
        first = next(iter(read_video(path)))
        sources = [Source(0, "video", path, (), (first.image.shape[1], first.image.shape[0]))]
    if focal is not None:
        sources = [replace(s, focal_px=focal, focal_source="given") for s in sources]
    return sources


def _folder_source(folder: Path, files: list[Path], camera: int) -> Source:
    if not files:
        raise InputError(
            f"{folder}: no images here (JPEG, PNG, TIFF); give a video, a folder of images or a sequence folder"
        )
    if len(files) < 3:
        raise InputError(f"{folder}: {len(files)} images are too few for a shape; take at least 20 from all sides")
    photographs = [inspect(file) for file in files]
    _same_size(folder, photographs)
    focals = [p.focal_px for p in photographs if p.focal_px]
    focal = float(np.median(focals)) if focals and np.ptp(focals) < 0.02 * np.median(focals) else None
    return Source(
        camera,
        "images",
        None,
        tuple((p.timestamp_ns, p.path) for p in photographs),
        photographs[0].size,
        focal,
        "exif" if focal else "none",
    )


def _same_size(folder: Path, photographs: list[Photograph]) -> None:
    sizes = [p.size for p in photographs]
    common = max(set(sizes), key=sizes.count)
    odd = next((p for p in photographs if p.size != common), None)
    if odd is not None:
        raise InputError(
            f"{folder}: images of different sizes ({odd.path.name} is {odd.size[0]}x{odd.size[1]}, most are "
            f"{common[0]}x{common[1]}); put one camera's images in one folder"
        )


def _sequence_sources(path: Path) -> list[Source]:
    from massprops.sequence.read import read_sequence

    sequence = read_sequence(path)
    sources = []
    for number in (0, 1):
        folder = path / f"cam{number}"
        if not folder.is_dir():
            continue
        camera = sequence.cameras.get(number)
        if camera is not None and camera.images:
            files = [file for _, file in camera.images]
            plain = _folder_source(folder, files, number)
            source = replace(plain, kind="sequence", images=camera.images)
        elif (folder / "video.mp4").is_file():
            first = next(iter(read_video(folder / "video.mp4")))
            source = Source(number, "sequence", folder / "video.mp4", (), (first.image.shape[1], first.image.shape[0]))
        else:
            data = folder / "data" if (folder / "data").is_dir() else folder
            source = replace(_folder_source(data, list_images(data), number), kind="sequence")
        if camera is not None:
            fu, fv, cu, cv = (float(v) for v in camera.intrinsics)
            source = replace(
                source,
                focal_px=0.5 * (fu + fv),
                focal_source="given",
                principal_point=(cu, cv),
                distortion=tuple(float(v) for v in camera.distortion),
                T_BS=camera.T_BS,
            )
        sources.append(source)
    if not sources:
        raise InputError(f"{path}: a sequence without images; reconstruct needs cam0/data or cam0/video.mp4")
    return sources


def judge_frames(source: Source, progress: Callable[[int, int, str], None]) -> Judged:
    """Small grey frames with their sharpness and motion, from one pass over the source."""
    import cv2

    index, stamp, grey = [], [], []
    stride = 1
    if source.video is not None:
        for frame in read_video(source.video, LOOK):
            if frame.index % stride:
                continue
            index.append(frame.index)
            stamp.append(frame.timestamp_ns)
            grey.append(cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY))
            if len(index) >= 2 * MOST_LOOKED_AT:
                index, stamp, grey, stride = index[::2], stamp[::2], grey[::2], 2 * stride
            progress(frame.index, 0, "reading")
    else:
        for i, (t, file) in enumerate(source.images):
            index.append(i)
            stamp.append(t)
            grey.append(cv2.cvtColor(load(file, LOOK), cv2.COLOR_BGR2GRAY))
            progress(i + 1, len(source.images), "reading")
    if len(index) < 3:
        raise InputError(
            f"{source.video or 'images'}: {len(index)} frames are too few for a shape; film at least a full turn"
        )
    frames = np.stack(grey)
    sharp = np.array([sharpness(g) for g in frames])
    motion = np.zeros(len(frames))
    for i in range(1, len(frames)):
        motion[i] = view_motion(frames[i - 1], frames[i])
    return Judged(np.array(index), np.array(stamp, np.int64), frames, sharp, motion)


def refuse_useless(judged: Judged, name: str) -> None:
    """Says what is wrong with footage in which nothing can be seen.

    Raises:
        InputError: all black, all white, all alike, or blurred throughout.
    """
    grey = judged.grey
    top, low = np.percentile(grey.reshape(len(grey), -1), [99.9, 0.1], axis=1)
    if top.max() < 20:
        raise InputError(f"{name}: all frames are black; light the object or expose longer")
    if low.min() > 235:
        raise InputError(f"{name}: all frames are white; expose less")
    if (top - low).max() < 8:
        raise InputError(f"{name}: nothing can be seen in any frame (contrast under 8 of 255)")
    change = [float(np.mean(np.abs(a.astype(np.int16) - b))) for a, b in zip(grey[:-1], grey[1:], strict=True)]
    far = np.mean([np.percentile(np.abs(grey[0].astype(np.int16) - g), 99) for g in grey[1 :: max(1, len(grey) // 20)]])
    if max(change) < 0.02 or far < 2.0:
        raise InputError(f"{name}: all frames are the same picture; the object or the camera must move")
    if np.median(judged.sharp) < BLURRED:
        raise InputError(
            f"{name}: every frame is blurred (sharpness {np.median(judged.sharp):.2f}, needs {BLURRED}); focus, or film slower"
        )


BLURRED = 1.12
"""Gradient over the gradient of the image blurred by six pixels: 1 when nothing finer than that is in it."""


def choose_frames(source: Source, judged: Judged, most: int) -> Chosen:
    """The frames to use of one source.

    Photographs are all used up to `most`; of video, sharp frames evenly along the way the view has moved.

    Raises:
        NotPossible: fewer than three frames differ.
    """
    if source.video is None and len(judged.index) <= most:
        return Chosen(judged.index, judged.timestamp_ns, judged.sharp)
    picked = choose(judged.motion, judged.sharp, most)
    if len(picked) < 3:
        raise NotPossible("fewer than three frames differ: the body or the camera must turn for a shape to be seen")
    path = np.cumsum(judged.motion)
    step = np.diff(path[picked])
    warnings = ()
    if np.median(step) > 0.12:
        warnings = (
            f"the view moves {100 * np.median(step):.0f} % of the image between frames: use more --frames or film slower",
        )
    return Chosen(judged.index[picked], judged.timestamp_ns[picked], judged.sharp[picked], warnings)


def choose_all(sources: list[Source], judged: list[Judged], most: int) -> list[Chosen]:
    """The frames to use of every source; of a stereo pair the first camera's choice, at instants that both saw.

    Raises:
        NotPossible: fewer than three frames of a camera differ.
        InputError: fewer than three instants were seen by both.
    """
    if len(sources) == 1:
        return [choose_frames(sources[0], judged[0], most)]
    first, other = choose_frames(sources[0], judged[0], most), judged[1]
    mine, theirs = same_instant(first.index, first.timestamp_ns, other.index, other.timestamp_ns)
    if len(mine) < 3:
        raise InputError(
            f"{len(mine)} frames of cam0 and cam1 were taken together; a stereo pair needs equal timestamps"
        )
    return [
        Chosen(first.index[mine], first.timestamp_ns[mine], first.sharp[mine], first.warnings),
        Chosen(other.index[theirs], other.timestamp_ns[theirs], other.sharp[theirs]),
    ]


def same_instant(
    index: np.ndarray, timestamp_ns: np.ndarray, other_index: np.ndarray, other_timestamp_ns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Frames of two cameras that were taken together.

    By clock to a quarter of the second camera's frame interval; by index where either camera has no clock.

    Args:
        index, timestamp_ns: (n,) of the first camera, increasing.
        other_index, other_timestamp_ns: (m,) of the second.

    Returns:
        positions in the first and in the second list, (k,) each.
    """
    clocks = min(timestamp_ns.min(initial=0), other_timestamp_ns.min(initial=0)) >= 0
    if not clocks or len(other_index) < 2 or np.any(np.diff(other_timestamp_ns) <= 0):
        _, mine, theirs = np.intersect1d(index, other_index, return_indices=True)
        return mine, theirs
    after = np.clip(np.searchsorted(other_timestamp_ns, timestamp_ns), 1, len(other_index) - 1)
    late = timestamp_ns - other_timestamp_ns[after - 1] > other_timestamp_ns[after] - timestamp_ns
    nearest = after - 1 + late
    apart = np.abs(other_timestamp_ns[nearest] - timestamp_ns)
    mine = np.flatnonzero(apart <= 0.25 * np.median(np.diff(other_timestamp_ns)))
    theirs, first = np.unique(nearest[mine], return_index=True)
    return mine[first], theirs


def full_frames(source: Source, chosen: Chosen, longest: int) -> Iterator[tuple[int, str, np.ndarray]]:
    """The chosen frames at working size: index, file name, (h, w, 3) BGR."""
    if source.video is not None:
        wanted = set(chosen.index.tolist())
        for frame in read_video(source.video, None, wanted):
            yield frame.index, f"{frame.index:06d}.png", reduce(frame.image, longest)
        return
    for i in chosen.index.tolist():
        file = source.images[i][1]
        yield i, file.name, load(file, longest)
