"""Filter: the YAML that `massprops estimate --prior` reads.

Ratios and axes in the run's body frame, that of its `sequence/attitude0`, with their covariances from the 90 %
intervals; feature points from the centre of mass, under the numbers that they have in the run's `tracks0`; and how much
process noise a filter of this motion deserves.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from massprops.documents.arrays import open_arrays
from massprops.documents.fields import as_written
from massprops.documents.filter import FORMAT, FilterFile
from massprops.documents.scale_json import read_scale
from massprops.dynamics.inertia import ratios_of_moments
from massprops.errors import InputError
from massprops.exchange.body import CONVENTION, Body
from massprops.mass.ratio_space import covariance_of_intervals

NAME = "filter"
SUFFIX = ".filter.yaml"
NEEDS_METRES = False
MESHES = False

MOST_FEATURES = 300
MARKS = 3
"""Rows of attitude0 that tell the footage, and with it the body frame."""
ASSUMED_SIGMA = 0.05
"""1-sigma of k1, k2 and of the axes [rad] of a mesh that states no intervals."""
DRIFT = 1e-3
"""Share of the body's rate that the recommended process noise may add over the footage."""


def render(body: Body, meshes: Mapping[str, str]) -> str:
    """The file as text."""
    import yaml

    content = filter_content(body)
    head = (
        "# A prior for massprops estimate --prior: inertia ratio of trace 1 in the body frame, "
        f"{CONVENTION.split(', ', 1)[1]};\n"
        "# k1 = ln(I1/I2), k2 = ln(I2/I3), I1 <= I2 <= I3; columns of principal_axes; axes_covariance_rad2 of small "
        "turns about them;\n# features from the centre of mass in body axes; process_noise: 1-sigma of angular "
        "acceleration [rad/s^2 per sqrt(s)]\n"
    )
    return head + yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120)


def filter_content(body: Body) -> dict[str, Any]:
    """What the file says."""
    document = body.document
    known_by = "mesh and motion together" if (document.get("recommended") or {}).get("source") == "fused" else "mesh"
    inertia = body.inertia / np.trace(body.inertia)
    axes = np.array(document["principal_axes"], float)
    moments = np.diag(axes.T @ inertia @ axes)
    k1, k2 = ratios_of_moments(moments).tolist()
    spread = covariance_of_intervals(document, axes)
    if spread is None:
        k_cov, axes_cov = np.eye(2) * ASSUMED_SIGMA**2, np.eye(3) * ASSUMED_SIGMA**2
    else:
        k_cov, axes_cov = spread[:2, :2], turn_covariance(spread[2:, 2:], k1, k2)
    content: dict[str, Any] = {
        "format": FORMAT,
        "source": f"{body.name}: {known_by}, constant density"
        + ("" if spread is not None else "; no intervals stated, 5 % assumed"),
        "units": {"length": "m" if body.metric else "model"},
        "inertia": inertia.tolist(),
        "inertia_ratios": {"k1": k1, "k2": k2},
        "principal_axes": axes.tolist(),
        "k_covariance": k_cov.tolist(),
        "axes_covariance_rad2": axes_cov.tolist(),
        "frame": {"kind": "the mesh's"},
        "features": None,
        "process_noise": None,
    }
    if body.run is not None:
        content.update(_of_footage(body, body.run))
    return as_written(FilterFile, content, "filter")


def turn_covariance(products: np.ndarray, k1: float, k2: float) -> np.ndarray:
    """(3, 3) of small turns about the principal axes [rad^2] from that of the log products (L23, L13, L12).

    A turn that the body hardly shows, between two like moments, is known no better than half a turn.
    """
    gaps = np.abs([k2, k1 + k2, k1])
    gaps = np.maximum(gaps, 1e-9)
    cov = products / np.outer(gaps, gaps)
    most = (np.pi / 2) ** 2
    shrink = np.sqrt(np.minimum(1.0, most / np.maximum(np.diag(cov), 1e-300)))
    return cov * np.outer(shrink, shrink) + 1e-12 * np.eye(3)


def _of_footage(body: Body, run: Path) -> dict[str, Any]:
    """Frame, features and process noise, of what the run's sequence holds."""
    from massprops.sequence.read import read_sequence

    try:
        sequence = read_sequence(run)
    except InputError:
        return {}
    entries: dict[str, Any] = {}
    if (attitude := sequence.attitude) is not None and len(attitude.q) > 2:
        rows = np.unique(np.linspace(0, len(attitude.q) - 1, MARKS).astype(int))
        mark = [[int(attitude.timestamp_ns[i]), *attitude.q[i].tolist()] for i in rows]
        entries["frame"] = {"kind": "attitude0 of the run's sequence", "mark": mark}
        times = (attitude.timestamp_ns - attitude.timestamp_ns[0]) * 1e-9
        entries["process_noise"] = float(DRIFT * typical_rate(times, attitude.q) / np.sqrt(times[-1]))
    if sequence.tracks is not None and 0 in sequence.cameras:
        points = sparse_points(run)
        if points is not None:
            ids, xyz = points
            seen, count = np.unique(sequence.tracks.feature, return_counts=True)
            tracked = np.isin(ids, seen[count >= 3])
            ids, xyz = ids[tracked], xyz[tracked]
            length = count[np.searchsorted(seen, ids)]
            best = np.sort(np.lexsort((ids, -length))[:MOST_FEATURES])
            if len(best):
                camera = sequence.cameras[0]
                reach = float(np.median(np.linalg.norm(xyz - body.center_of_mass, axis=1)))
                far = _distance(run, body)
                sigma = (camera.sigma_px or 0.5) / float(camera.intrinsics[0]) * far
                entries["features"] = {
                    "units": "m" if body.metric else "model",
                    "sigma": float(max(sigma, 1e-4 * reach)),
                    "ids": ids[best].tolist(),
                    "xyz": np.round(xyz[best] - body.center_of_mass, 9).tolist(),
                }
    return entries


def typical_rate(times: np.ndarray, q: np.ndarray) -> float:
    """Root mean square rate of turn [rad/s] of an attitude history: times (n,) [s], q (n, 4)."""
    from massprops.dynamics.quaternion import angle_between

    return float(np.sqrt(np.mean((angle_between(q[1:], q[:-1]) / np.diff(times)) ** 2)))


def sparse_points(run: Path) -> tuple[np.ndarray, np.ndarray] | None:
    """Numbers (m,) and places (m, 3) of the run's sparse points, in the mesh's axes and units; None without any."""
    try:
        with open_arrays(run / "work" / "sfm" / "points.npz") as z:
            return z["id"], z["xyz"] * read_scale(run).factor
    except (OSError, ValueError, KeyError, InputError):
        return _colmap_points(run / "sparse")


def _colmap_points(folder: Path) -> tuple[np.ndarray, np.ndarray] | None:
    """Of the published model, which is in the mesh's axes and units."""
    import struct

    path = folder / "points3D.bin"
    if not path.is_file():
        return None
    data, ids, xyz, at = path.read_bytes(), [], [], 8
    try:
        for _ in range(struct.unpack_from("<Q", data)[0]):
            number, x, y, z = struct.unpack_from("<Qddd", data, at)
            track = struct.unpack_from("<Q", data, at + 43)[0]
            ids.append(number)
            xyz.append((x, y, z))
            at += 51 + 8 * track
    except struct.error:
        return None
    return np.array(ids, np.int64), np.array(xyz, float).reshape(-1, 3)


def _distance(run: Path, body: Body) -> float:
    """Typical distance of the camera from the centre of mass, in the body's units."""
    from massprops.views import Views

    try:
        centres = read_scale(run).factor * Views.load(run / "work" / "sfm" / "views.npz").centres
    except (OSError, ValueError, KeyError, InputError):
        return 3.0 * float(np.linalg.norm(np.ptp(np.asarray(body.mesh.vertices), axis=0)))
    return float(np.median(np.linalg.norm(centres - body.center_of_mass, axis=1)))
