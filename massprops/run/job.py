"""What a stage is given, and how it says how far it is."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from massprops.core.parts import Parts
from massprops.core.progress import Progress, silent


@dataclass(frozen=True)
class ReconstructOptions:
    """Everything a user can ask of `massprops reconstruct`; printed whole into `run.yaml`.

    Attributes:
        source: video, folder of images or sequence folder, as an absolute path.
        more: further inputs, each another placement of the same object.
        motion: `auto`, `tumbling` (body moves before a still camera) or `static` (camera moves round a still object).
        masks: folder of silhouettes in COLMAP's naming (`NAME.png` appended to the image name, black excluded).
        object: pixels that show the object, each "X,Y" of the first image used or "FILE:X,Y".
        box: rectangles in which it lies, each "X0,Y0,X1,Y1" or "FILE:X0,Y0,X1,Y1".
        keep_support: a stand, foam or mat below the object belongs to it.
        frames: most frames used per camera.
        max_size: longer side to which images are reduced [px].
        focal: focal length [px of the source image], when known.
        mapper: `incremental` or `global`.
        sparse: folder of an existing COLMAP model used in place of our own structure from motion.
        dense_views: most reference views of the dense stereo; 0 lets the stage choose.
        density: [kg/m^3]; None takes that of water, and says so.
        scale: metres per model unit; the model unit is the greatest length of the object.
        scale_sigma: relative 1-sigma of any given length.
        distance: two points (each "x,y,z" in model units, or a name) and the metres between them.
        marker: ArUco or ChArUco marker in view, as `DICTIONARY:SIDE_METRES` or `DICTIONARY:COLSxROWS:SQUARE_METRES`.
        seed: of every random draw.
        threads: processor threads; 0 takes what the machine has.
    """

    source: str = ""
    more: tuple[str, ...] = ()
    motion: str = "auto"
    masks: str | None = None
    object: tuple[str, ...] = ()
    box: tuple[str, ...] = ()
    keep_support: bool = False
    frames: int = 120
    max_size: int = 1280
    focal: float | None = None
    mapper: str = "incremental"
    sparse: str | None = None
    dense_views: int = 0
    density: float | None = None
    scale: float | None = None
    scale_sigma: float = 0.0
    distance: tuple[str, str, float] | None = None
    marker: str | None = None
    seed: int = 0
    threads: int = 0


@dataclass(frozen=True)
class Job:
    """One stage of one run.

    Attributes:
        run: the run folder.
        options: what the user asked.
        out: an empty folder for everything this stage writes; it becomes `run/work/<stage>` when the stage is done.
        progress: see `Progress`.
        seed: seed of this stage's draws.
        threads: processor threads it may use.
        key: of everything that this stage's result depends on.
        force: files of the run folder that are not massprops' may be replaced.
        parts: keeps what the stage has finished, if it is killed before it is done.
    """

    run: Path
    options: ReconstructOptions
    out: Path
    progress: Progress = silent
    seed: int = 0
    threads: int = 2
    key: str = ""
    force: bool = False
    parts: Parts = field(default_factory=Parts)
    notes: list[str] = field(default_factory=list)

    def work(self, stage: str) -> Path:
        """Folder of a finished stage's files."""
        return self.run / "work" / stage

    def warn(self, text: str) -> None:
        """Adds a warning that ends in `massprops.json`, the report and the terminal."""
        self.notes.append(text)
