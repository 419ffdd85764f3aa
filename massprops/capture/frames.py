"""Footage from Python: the frames that a reconstruction would use, one after the other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from massprops.capture.footage import choose_all, full_frames, judge_frames, open_sources
from massprops.core.progress import Progress, silent


@dataclass(frozen=True)
class Frame:
    """One image of the footage.

    Attributes:
        camera: 0, or 1 for the second of a stereo pair.
        index: place in the source.
        timestamp_ns: the source's clock, or -1 where it has none.
        name: the file's, or one made of the index for video.
        sharpness: 1 when nothing finer than six pixels is in it.
        image: (h, w, 3) uint8 BGR, upright.
        focal_px: at this size, where EXIF or the sensor file give it.
    """

    camera: int
    index: int
    timestamp_ns: int
    name: str
    sharpness: float
    image: np.ndarray
    focal_px: float | None


def read_frames(
    source: str | Path, most: int = 120, longest: int = 1280, progress: Progress = silent
) -> Iterator[Frame]:
    """The sharp, distinct frames of a video, a folder of images or a sequence folder, one camera after the other.

    Images of a folder that cannot be used are passed over.

    Args:
        source: the footage.
        most: frames per camera.
        longest: longer side to which images are reduced [px].
        progress: told while the footage is looked through.

    Raises:
        InputError: nothing there that can be used.
        NotPossible: fewer than three frames differ.

    Example:
        >>> for frame in read_frames("video.mp4", most=40):  # doctest: +SKIP
        ...     print(frame.timestamp_ns * 1e-9, frame.image.shape)
    """
    sources = open_sources(Path(source))
    judged = [judge_frames(s, progress) for s in sources]
    for s, chosen in zip(sources, choose_all(sources, judged, most), strict=True):
        place = {int(i): k for k, i in enumerate(chosen.index)}
        for index, name, image in full_frames(s, chosen, longest):
            k = place[index]
            prior = s.camera(index)
            focal = None if prior.focal_px is None else prior.focal_px * max(image.shape[:2]) / max(prior.size)
            yield Frame(s.stream, index, int(chosen.timestamp_ns[k]), name, float(chosen.sharp[k]), image, focal)
