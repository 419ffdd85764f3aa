"""What the capture stage left: frames, clocks, cameras and silhouettes, as structure from motion reads them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from massprops.errors import InputError

DRAWN_BY = ("silhouettes", "join", "surface")
"""Stages that write silhouettes, each better than the one before: from each placement's first shape, from those of all, and from
the closed surface."""


@dataclass(frozen=True)
class FrameRecord:
    """One image.

    Attributes:
        name: relative to `frames/`, `cam0/000012.png`; the folder is the stream, 0, or 1 for the second half of a rig.
        camera: number of its camera.
        timestamp_ns: its clock [ns], or -1.
        index: place in the source.
        source_name: of the user's file.
        turn: quarter turns clockwise that bring the stored image to the way in which its camera's images are held.
        place: number of the place at which a still camera stood.
    """

    name: str
    camera: int
    timestamp_ns: int
    index: int
    source_name: str = ""
    turn: int = 0
    place: int = 0

    @property
    def moment(self) -> str:
        """What the images that a rig's cameras take together have in common: the name within the stream."""
        return self.name.split("/", 1)[1]


@dataclass(frozen=True)
class CameraRecord:
    """What is known of one camera, at one zoom and image size, before the reconstruction.

    Attributes:
        id: number of the camera.
        size: width, height of its images once all are turned the same way [px].
        focal_px: focal length [px], or None.
        principal_point: (2,) [px], centres of pixels at whole numbers (OpenCV), or None for the image's middle.
        distortion: (4,) OpenCV k1, k2, p1, p2, or None when unknown.
        T_BS: (4, 4) sensor to chaser body [m], or None.
        focal_source: `given`, `exif`, `alike`, `start` or `none` (`massprops.capture.cameras.CameraPrior`); a given
            focal length is never changed.
        device: maker, model and zoom as EXIF has them, or empty.
    """

    id: int
    size: tuple[int, int]
    focal_px: float | None = None
    principal_point: tuple[float, float] | None = None
    distortion: tuple[float, ...] | None = None
    T_BS: np.ndarray | None = None
    focal_source: str = "none"
    device: str = ""


@dataclass(frozen=True)
class FootageRecord:
    """`work/capture` as read back.

    Attributes:
        folder: the capture folder (holds `frames/` and perhaps `masks/`).
        source: the user's input.
        kind: `video`, `images`, `sequence` or `stereo`.
        motion: `tumbling` or `static`.
        background: `black`, `still` or `moving`.
        mask_features: whether features outside the silhouettes are left out.
    """

    folder: Path
    source: str
    kind: str
    motion: str
    background: str
    mask_features: bool
    cameras: tuple[CameraRecord, ...]
    frames: tuple[FrameRecord, ...]

    def image(self, name: str) -> Path:
        """File of a frame."""
        return self.folder / "frames" / name

    def mask(self, name: str) -> Path:
        """File of a frame's silhouette in COLMAP's naming; it need not exist."""
        return self.folder / "masks" / f"{name}.png"

    @property
    def has_masks(self) -> bool:
        return any(self.mask(f.name).is_file() for f in self.frames)

    @property
    def room_stood(self) -> bool:
        """Whether a camera may have gone round in a room: what is about the object then tells where it was. The rim of images
        that shows no texture may be that of a plain table in a room."""
        return self.motion == "static"

    @property
    def times(self) -> dict[str, float]:
        """When each image was taken by name [ns], or its number where it has no clock."""
        return {f.name: float(f.timestamp_ns if f.timestamp_ns >= 0 else f.index) for f in self.frames}

    @property
    def ordered(self) -> bool:
        """Whether neighbours in the list are neighbours in time."""
        return self.moving_pictures or all(f.timestamp_ns >= 0 for f in self.frames)

    @property
    def moving_pictures(self) -> bool:
        """Whether the images follow each other so closely that their motion is smooth."""
        return self.kind in ("video", "sequence", "stereo")

    @property
    def rig(self) -> bool:
        """Whether the cameras are mounted together and two images of equal name were taken at one instant."""
        return self.kind == "stereo"

    def size(self, frame: FrameRecord) -> tuple[int, int]:
        """Width, height of a frame as stored [px]."""
        width, height = next(c.size for c in self.cameras if c.id == frame.camera)
        return (height, width) if frame.turn % 2 else (width, height)


def frames_folder(work: Path) -> Path:
    """Folder of the placed frames in a run's folder of stages: as a global shutter would have taken them, where that was
    needed."""
    corrected = work / "sfm" / "frames"
    return corrected if corrected.is_dir() else work / "capture" / "frames"


def frame_file(work: Path, name: str) -> Path:
    """File of a frame, placed or not; otherwise as `frames_folder`."""
    corrected = frames_folder(work) / name
    return corrected if corrected.is_file() else work / "capture" / "frames" / name


def mask_file(work: Path, name: str) -> Path:
    """Likewise of a frame's first silhouette, which need not exist."""
    corrected = work / "sfm" / "masks" / f"{name}.png"
    return corrected if corrected.is_file() else work / "capture" / "masks" / f"{name}.png"


def silhouette_file(work: Path, name: str, last: str = DRAWN_BY[-1]) -> Path:
    """The silhouette of a stored frame in the folder of all stages, as the last stage knows it that has drawn it.

    Args:
        last: no stage of `DRAWN_BY` after this one counts.
    """
    files = [work / stage / "masks" / f"{name}.png" for stage in DRAWN_BY[: DRAWN_BY.index(last) + 1]]
    return next((file for file in reversed(files) if file.is_file()), files[0])


def read_footage(folder: Path) -> FootageRecord:
    """Reads `footage.json` of a capture folder.

    Raises:
        InputError: the file is absent or lacks what structure from motion needs.
    """
    path = Path(folder) / "footage.json"
    if not path.is_file():
        raise InputError(f"{path}: missing; run the capture stage first")
    try:
        d = json.loads(path.read_text())
        cameras = tuple(_camera(c) for c in d["cameras"])
        frames = tuple(
            FrameRecord(
                f["name"],
                int(f["camera"]),
                int(f.get("timestamp_ns", -1)),
                int(f.get("index", i)),
                str(f.get("source_name", "")),
                int(f.get("turn", 0)) % 4,
                int(f.get("camera_place", 0)),
            )
            for i, f in enumerate(d["frames"])
        )
        motion = d["motion"]
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: not a footage description ({error!r}); run the capture stage again") from error
    masked = d.get("mask_features")
    return FootageRecord(
        folder=Path(folder),
        source=str(d.get("source", "")),
        kind=str(d.get("kind", "images")),
        motion=motion,
        background=str(d.get("background", "still")),
        mask_features=(motion == "tumbling") if masked is None else bool(masked),
        cameras=cameras,
        frames=frames,
    )


def _camera(c: dict[str, Any]) -> CameraRecord:
    T = c.get("T_BS")
    return CameraRecord(
        id=int(c["id"]),
        size=(int(c["width"]), int(c["height"])),
        focal_px=float(c["focal_px"]) if c.get("focal_px") else None,
        principal_point=tuple(c["principal_point"]) if c.get("principal_point") else None,
        distortion=tuple(float(v) for v in c["distortion"]) if c.get("distortion") else None,
        T_BS=np.asarray(T, float).reshape(4, 4) if T is not None else None,
        focal_source=str(c.get("focal_source", "none")),
        device=str(c.get("device", "")),
    )
