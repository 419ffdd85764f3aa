"""Stage: tracks and attitude of the footage as a sequence folder."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.run.job import Job

if TYPE_CHECKING:
    from massprops.sequence.data import Environment, RangeSeries

READS = ("capture", "sfm", "join")
OPTIONS = ("motion",)


def run(job: Job) -> dict[str, Any]:
    """Writes sequence/ and sequence.json."""
    from massprops.sequence.write import write_sequence
    from massprops.sfm.attitude import to_sequence
    from massprops.sfm.footage import frame_file, read_footage
    from massprops.sfm.points import SparsePoints
    from massprops.views import Views

    job.progress(0, 1, "sequence")
    footage = read_footage(job.work("capture"))
    views = Views.load(job.work("sfm") / "views.npz")
    points = SparsePoints.load(job.work("sfm") / "points.npz")
    place = {f.name: f.index for f in footage.frames}
    mounting = {c.id: c.T_BS for c in footage.cameras if c.T_BS is not None}
    ranges = environment = None
    if footage.kind in ("sequence", "stereo") and Path(footage.source).is_dir():
        ranges, environment = _passed_on(Path(footage.source))
    stands = json.loads((job.work("join") / "join.json").read_text())["support_plane"] is not None
    still = "the object stands on what turns it" if footage.motion == "tumbling" else "the object is still"
    sequence = to_sequence(
        views,
        points,
        np.array([place.get(n, i) for i, n in enumerate(views.names)]),
        None if footage.motion == "tumbling" and not stands else still,
        _attitude_sigma(job.work("sfm") / "precision.npz"),
        mounting,
        ranges,
        environment,
        {n: frame_file(job.run / "work", n) for n in views.names},
    )
    write_sequence(job.out / "sequence", sequence)
    for line in told(sequence.warnings, footage.motion):
        job.warn(line)
    facts = {
        "tracks": len(np.unique(sequence.tracks.feature)) if sequence.tracks else 0,
        "observations": len(sequence.tracks.feature) if sequence.tracks else 0,
        "attitudes": len(sequence.attitude.q) if sequence.attitude else 0,
        "sigma_px": {str(c): camera.sigma_px for c, camera in sequence.cameras.items()},
        "warnings": list(sequence.warnings),
    }
    (job.out / "sequence.json").write_text(json.dumps(facts, indent=1))
    job.progress(1, 1, "sequence")
    return {k: facts[k] for k in ("tracks", "observations", "attitudes")}


def told(warnings: Sequence[str], motion: str) -> tuple[str, ...]:
    """What the user is told of the sequence: nothing of a still object, of which the sequence shows no motion anyway."""
    return tuple(warnings) if motion == "tumbling" else ()


def _attitude_sigma(path: Path) -> np.ndarray | None:
    if not path.is_file():
        return None
    with np.load(path, allow_pickle=False) as z:
        return np.asarray(z["attitude"])


def _passed_on(source: Path) -> tuple[RangeSeries | None, Environment | None]:
    """Range and surroundings of the input, which images say nothing about."""
    from massprops.sequence.read import read_sequence

    given = read_sequence(source)
    return given.range, given.environment
