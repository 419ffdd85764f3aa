"""From a path to the frames that will be used, with what is known of the cameras."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from massprops.capture.cameras import CameraPrior, group, unusable, with_focal
from massprops.capture.images import inspect, list_images, load, plain_png, printable, reduce
from massprops.capture.keyframes import choose, edge_width, sharpness, view_motion
from massprops.capture.video import read_video
from massprops.core.text import counted
from massprops.errors import InputError, NotPossible

LOOK = 320
"""Longer side of the small frames on which frames are judged [px]."""

MOST_LOOKED_AT = 1500
"""Frames of a video that are judged; of longer ones every n-th."""

FEWEST = 3
"""Images without which no shape is tried."""

NAMED = 8
"""Images that a warning names; `footage.json` names all."""


@dataclass(frozen=True)
class Still:
    """One image of a folder: timestamp_ns or -1; file; number of its camera in `Source.cameras`; quarter turns clockwise
    from the image upright to the way that camera's images are held."""

    timestamp_ns: int
    path: Path
    camera: int = 0
    turn: int = 0


@dataclass(frozen=True)
class Source:
    """One stream of images, not yet chosen: a video, a folder of photographs, or one half of a stereo rig.

    Attributes:
        stream: 0, or 1 for the second half of a rig.
        kind: `video`, `images` or `sequence`.
        video: the file, or None.
        images: of a folder.
        cameras: that took them: one, but for photographs by several devices or at several zooms or sizes.
        T_BS: (4, 4) sensor to chaser body [m], where the sensor file gives it.
        left_out: (file name, why) of images that cannot be used.
    """

    stream: int
    kind: str
    video: Path | None
    images: tuple[Still, ...]
    cameras: tuple[CameraPrior, ...]
    T_BS: np.ndarray | None = None
    left_out: tuple[tuple[str, str], ...] = ()

    def camera(self, index: int) -> CameraPrior:
        """The camera of an image."""
        return self.cameras[self.images[index].camera if self.images else 0]

    def turn(self, index: int) -> int:
        """The turn of an image."""
        return self.images[index].turn if self.images else 0


@dataclass(frozen=True)
class Judged:
    """Small frames of a source: index, timestamp_ns (n,), grey (n, h, w) uint8, sharp (n,), motion (n,).

    Images of several shapes are stretched to the commonest, which is good enough to look at.
    left_out: as of the source, with the images that could not be decoded.
    """

    index: np.ndarray
    timestamp_ns: np.ndarray
    grey: np.ndarray
    sharp: np.ndarray
    motion: np.ndarray
    left_out: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Chosen:
    """Frames to use of one source: positions in the source, their clocks and sharpness."""

    index: np.ndarray
    timestamp_ns: np.ndarray
    sharp: np.ndarray
    warnings: tuple[str, ...] = field(default=())


def open_sources(path: Path, focal: float | None = None) -> list[Source]:
    """What the input holds: one source per stream.

    Args:
        path: video, folder of images or with one such folder in it, or sequence folder.
        focal: focal length given by the user [px of the source images]; of several cameras, the one with most images.

    Raises:
        InputError: nothing there that can be used; a damaged video.
    """
    if path.is_dir() and any((path / f"cam{i}").is_dir() for i in (0, 1)):
        sources = _sequence_sources(path)
    elif path.is_dir():
        sources = [_folder_source(*_images_of(path))]
    else:
        sources = [_video_source(path, 0, "video")]
    if focal is not None:
        sources = [replace(s, cameras=tuple(with_focal(list(s.cameras), focal))) for s in sources]
    return sources


def _video_source(path: Path, stream: int, kind: str) -> Source:
    first = next(iter(read_video(path)))
    return Source(stream, kind, path, (), (CameraPrior((first.image.shape[1], first.image.shape[0])),))


def _folder_source(folder: Path, files: list[Path], stream: int = 0) -> Source:
    if not files:
        raise InputError(
            f"{folder}: no images here (JPEG, PNG, TIFF, WebP, HEIC); give {_folders_of_images(folder)}a video, a folder of "
            "images or a sequence folder"
        )
    if len(files) < FEWEST:
        raise InputError(
            f"{folder}: {counted(len(files), 'image is', 'images are')} too few for a shape; take at least 20 from all sides"
        )
    photographs, left_out = [], []
    for file in files:
        try:
            photographs.append(inspect(file))
        except InputError as error:
            left_out.append((file.name, _why(error, file)))
    common = float(np.median([max(p.size) for p in photographs])) if photographs else 0.0
    refused = {p.path.name: why for p in photographs if (why := unusable(p, common))}
    photographs = [p for p in photographs if p.path.name not in refused]
    left_out += refused.items()
    refuse_few(folder.name, len(photographs), left_out)
    cameras, camera, turn = group(photographs)
    images = tuple(Still(p.timestamp_ns, p.path, c, t) for p, c, t in zip(photographs, camera, turn, strict=True))
    return Source(stream, "images", None, images, tuple(cameras), left_out=tuple(left_out))


def _images_of(folder: Path) -> tuple[Path, list[Path]]:
    """The folder with its images; where it has none, those of the one folder within that has, or of its `images`."""
    files = list_images(folder)
    inner = [] if files else _inner_folders(folder)
    if len(inner) > 1:
        inner = [p for p in inner if p.name == "images"]
    return (inner[0], list_images(inner[0])) if inner else (folder, files)


def _inner_folders(folder: Path) -> list[Path]:
    """The folders within that hold images."""
    return sorted(p for p in folder.iterdir() if p.is_dir() and p.name[0] != "." and list_images(p))


def _folders_of_images(folder: Path) -> str:
    """Names the folders within that hold images, as the beginning of a list of what to give; empty where none does."""
    return "".join(f"its folder {printable(p.name)}, " for p in _inner_folders(folder)[:NAMED])


def refuse_few(name: str, count: int, left_out: Sequence[tuple[str, str]]) -> None:
    """Raises InputError when fewer than three images are left."""
    if count < FEWEST:
        raise InputError(
            f"{name}: {count} of {count + len(left_out)} images can be used, too few for a shape: {said(left_out, 3)}; "
            "copy the images again, or take at least 20 from all sides"
        )


def said(left_out: Sequence[tuple[str, str]], most: int = NAMED) -> str:
    """The images that were left out, and why, as part of a sentence that names at most so many."""
    some = ", ".join(f"{printable(name)} ({why})" for name, why in left_out[:most])
    return some + (f" and {len(left_out) - most} more" if len(left_out) > most else "")


def _why(error: InputError, file: Path) -> str:
    return str(error).removeprefix(f"{file}: ").rsplit(";", 1)[0]


def _one_camera(source: Source, images: tuple[tuple[int, Path], ...] | None = None) -> Source:
    """A stream of a sequence: one camera that nobody turns; images of another size are left out.

    Args:
        images: its clocks and files where the sequence lists them.
    """
    clock = {file: t for t, file in images} if images else None
    camera_images = [
        s for s in source.images if source.cameras[s.camera].size == source.cameras[0].size and s.turn % 2 == 0
    ]
    camera_images = [replace(s, camera=0, turn=0) for s in camera_images if clock is None or s.path in clock]
    if clock is not None:
        camera_images = sorted(
            (replace(s, timestamp_ns=clock[s.path]) for s in camera_images), key=lambda s: s.timestamp_ns
        )
    kept = {s.path for s in camera_images}
    odd = [(s.path.name, "another size than the rest of its camera") for s in source.images if s.path not in kept]
    left_out = (*source.left_out, *odd)
    refuse_few(source.images[0].path.parent.name, len(camera_images), left_out)
    camera = replace(source.cameras[0], images=len(camera_images))
    return replace(source, kind="sequence", images=tuple(camera_images), cameras=(camera,), left_out=left_out)


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
            source = _one_camera(_folder_source(folder, files, number), camera.images)
        elif (folder / "video.mp4").is_file():
            source = _video_source(folder / "video.mp4", number, "sequence")
        else:
            data = folder / "data" if (folder / "data").is_dir() else folder
            source = _one_camera(_folder_source(data, list_images(data), number))
        if camera is not None:
            if camera.stated and camera.resolution != source.cameras[0].size:
                raise InputError(
                    f"{folder / 'sensor.yaml'}: says {_by(camera.resolution)} pixels, and its images have "
                    f"{_by(source.cameras[0].size)}: give resolution and intrinsics of these images"
                )
            fu, fv, cu, cv = (float(v) for v in camera.intrinsics)
            known = replace(
                source.cameras[0],
                focal_px=0.5 * (fu + fv),
                focal_source="given",
                principal_point=(cu, cv),
                distortion=tuple(float(v) for v in camera.distortion),
            )
            source = replace(source, cameras=(known,), T_BS=camera.T_BS)
        sources.append(source)
    if not sources:
        raise InputError(f"{path}: a sequence without images; reconstruct needs cam0/data or cam0/video.mp4")
    return sources


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"


def judge_frames(source: Source, progress: Callable[[int, int, str], None]) -> Judged:
    """Small grey frames with their sharpness and motion, from one pass over the source.

    Raises:
        InputError: fewer than three frames can be decoded.
    """
    import cv2

    left_out = list(source.left_out)
    if source.video is not None:
        index, stamp, grey = _look_through(source.video, progress)
    else:
        index, stamp, grey = [], [], []
        for i, still in enumerate(source.images):
            try:
                grey.append(cv2.cvtColor(load(still.path, LOOK), cv2.COLOR_BGR2GRAY))
                index.append(i)
                stamp.append(still.timestamp_ns)
            except InputError as error:
                left_out.append((still.path.name, _why(error, still.path)))
            progress(i + 1, len(source.images), "reading")
        if left_out:
            refuse_few("images", len(index), left_out)
    if len(index) < FEWEST:
        raise InputError(
            f"{source.video or 'images'}: {len(index)} frames are too few for a shape; film at least a full turn"
        )
    sharp = np.array([sharpness(g) for g in grey])
    shape = Counter(g.shape for g in grey).most_common(1)[0][0]
    frames = np.stack(
        [g if g.shape == shape else cv2.resize(g, shape[::-1], interpolation=cv2.INTER_AREA) for g in grey]
    )
    motion = np.zeros(len(frames))
    for i in range(1, len(frames)):
        motion[i] = view_motion(frames[i - 1], frames[i])
    return Judged(np.array(index), np.array(stamp, np.int64), frames, sharp, motion, tuple(left_out))


def _look_through(
    video: Path, progress: Callable[[int, int, str], None]
) -> tuple[list[int], list[int], list[np.ndarray]]:
    import cv2

    index: list[int] = []
    stamp: list[int] = []
    grey: list[np.ndarray] = []
    stride = 1
    for frame in read_video(video, LOOK):
        if frame.index % stride:
            continue
        index.append(frame.index)
        stamp.append(frame.timestamp_ns)
        grey.append(cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY))
        if len(index) >= 2 * MOST_LOOKED_AT:
            index, stamp, grey, stride = index[::2], stamp[::2], grey[::2], 2 * stride
        progress(frame.index, 0, "reading")
    return index, stamp, grey


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
        # a plain surface has nothing fine in it either, but its outline is sharp
        width = float(np.median([edge_width(g) for g in grey[:: max(1, len(grey) // 20)]]))
        if width > SOFT:
            raise InputError(f"{name}: every frame is blurred (edges {width:.1f} pixels wide); focus, or film slower")


BLURRED = 1.12
"""Gradient over the gradient of the image blurred by six pixels: 1 when nothing finer than that is in it."""

SOFT = 3.0
"""Blur of the strongest edges above which a frame is blurred [px of the small frame]."""


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
            f"only {len(mine)} frames of cam0 and cam1 have the same time; give both cameras' timestamps by one clock"
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
        file = source.images[i].path
        yield i, file.name, load(file, longest)


def stored_frames(source: Source, chosen: Chosen, longest: int) -> Iterator[tuple[int, str, np.ndarray | bytes]]:
    """As `full_frames`, but of a PNG that holds just what it shows its content (`massprops.capture.images.plain_png`)."""
    if source.video is not None:
        yield from full_frames(source, chosen, longest)
        return
    for i in chosen.index.tolist():
        file = source.images[i].path
        content = plain_png(file, longest)
        yield i, file.name, load(file, longest) if content is None else content
