"""Video through PyAV: true timestamps, rotation as shown, one pass without keeping frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from massprops.errors import InputError

if TYPE_CHECKING:
    import av

FORMATS = (
    "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpegtsraw,mpeg,mpegvideo,m4v,h264,hevc,flv,asf,ogg,gif,ivf,mxf,"
    "dv,rm,wtv,yuv4mpegpipe,mjpeg,vc1,obu,av1"
)
"""Containers that hold their pictures themselves. Playlists and lists (HLS, DASH, SDP, concat, image sequences) name
other files and addresses, and are not opened, whatever the file is called."""


@dataclass(frozen=True)
class VideoFrame:
    """index in decoding order; timestamp_ns from the stream's clock; image (h, w, 3) uint8 BGR, upright as shown."""

    index: int
    timestamp_ns: int
    image: np.ndarray


def read_video(path: Path, longest: int | None = None, wanted: set[int] | None = None) -> Iterator[VideoFrame]:
    """Decodes a video front to back.

    A frame that cannot be decoded is passed over; the clock is the file's, so variable rates stay true.

    Args:
        path: video file.
        longest: longer side to which frames are reduced [px], before they are converted: quick.
        wanted: indices to convert; others are decoded only.

    Raises:
        InputError: not a video, or nothing in it can be decoded.
    """
    import av

    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the file is empty; record or copy it again")
    try:
        container = av.open(str(path), container_options={"format_whitelist": FORMATS, "protocol_whitelist": "file"})
    except (av.error.FFmpegError, OSError, ValueError) as error:
        raise InputError(
            f"{path}: not a video that can be read ({_reason(error)}); give MP4, MOV, MKV or AVI"
        ) from None
    with container:
        if not container.streams.video:
            raise InputError(f"{path}: holds no video stream; give a video or a folder of images")
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        index = 0
        try:
            for frame in container.decode(stream):
                if wanted is None or index in wanted:
                    yield VideoFrame(index, _clock(frame, stream, index), _upright(frame, longest))
                index += 1
        except av.error.FFmpegError as error:
            if index == 0:
                raise InputError(
                    f"{path}: no frame can be decoded ({_reason(error)}); the file is damaged or cut short"
                ) from None
        if index == 0:
            raise InputError(f"{path}: no frame can be decoded; the file is damaged or cut short")


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error).splitlines()[0]


def _clock(frame: av.VideoFrame, stream: av.VideoStream, index: int) -> int:
    """Presentation time [ns]; the index over the mean rate where the file gives none."""
    if frame.pts is not None and frame.time_base:
        return int(Fraction(frame.pts) * Fraction(frame.time_base) * 10**9)
    rate = stream.average_rate or stream.guessed_rate or 25
    return int(Fraction(index) / Fraction(rate) * 10**9)


def _upright(frame: av.VideoFrame, longest: int | None) -> np.ndarray:
    width, height = frame.width, frame.height
    if longest is not None and max(width, height) > longest:
        factor = longest / max(width, height)
        width, height = max(2, round(width * factor)), max(2, round(height * factor))
    image = frame.to_ndarray(format="bgr24", width=width, height=height, interpolation="AREA")
    turns = round(getattr(frame, "rotation", 0) / 90) % 4
    return np.ascontiguousarray(np.rot90(image, turns))
