"""An ArUco marker or a ChArUco board of known size in view: its corners are found in the frames and triangulated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.core.robust import mad_sigma
from massprops.documents.limits import excerpt
from massprops.errors import InputError
from massprops.geometry.vectors import unit
from massprops.sfm.marker_corners import refine
from massprops.sfm.scale._base import ScaleEstimate, ScaleInputs
from massprops.views import Views

PRINT = 2e-3
"""Relative 1-sigma of a printed marker's stated side."""


@dataclass(frozen=True)
class MarkerSpec:
    """`DICTIONARY:SIDE_METRES` or `DICTIONARY:COLSxROWS:SQUARE_METRES`; board is (columns, rows) or None."""

    dictionary: str
    side_m: float
    board: tuple[int, int] | None = None


def parse(text: str) -> MarkerSpec:
    """Reads the option.

    Raises:
        InputError: another form, an unknown dictionary, or a side that is not positive.
    """
    import cv2

    parts, shown = text.split(":"), excerpt(text)
    form = "use DICTIONARY:SIDE_METRES or DICTIONARY:COLSxROWS:SQUARE_METRES, for example 4X4_50:0.05"
    if len(parts) not in (2, 3):
        raise InputError(f"--marker {shown}: not understood; {form}")
    name = parts[0].upper()
    name = name if name.startswith("DICT_") else f"DICT_{name}"
    if not hasattr(cv2.aruco, name):
        raise InputError(f"--marker {shown}: unknown dictionary {excerpt(parts[0])}; {form}")
    try:
        side = float(parts[-1])
        board = None
        if len(parts) == 3:
            columns, rows = parts[1].lower().split("x")
            board = (int(columns), int(rows))
    except ValueError as error:
        raise InputError(f"--marker {shown}: not understood; {form}") from error
    if not 0 < side < np.inf or (board and min(board) < 2):
        raise InputError(f"--marker {shown}: sizes must be above 0 and a board at least 2x2; {form}")
    return MarkerSpec(name, side, board)


def detect(image: np.ndarray, spec: MarkerSpec) -> dict[tuple[int, int], np.ndarray]:
    """Corners in one image (h, w) uint8: (marker or 0, corner) -> (2,) pixel."""
    import cv2

    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, spec.dictionary))
    if spec.board:
        board = cv2.aruco.CharucoBoard(spec.board, spec.side_m, 0.75 * spec.side_m, dictionary)
        corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(image)
        if ids is None:
            return {}
        return {(0, int(i)): c for i, c in zip(ids.ravel(), corners.reshape(-1, 2), strict=True)}
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(image)
    if ids is None:
        return {}
    fine = [refine(image, c[0], dictionary.markerSize) for c in corners]
    return {(int(i), k): c[k] for i, c in zip(ids.ravel(), fine, strict=True) for k in range(4)}


def triangulate(views: Views, index: list[int], uv: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Point (3,) from pixels (m, 2) of the original images, mean reprojection error [px] and widest angle [degrees].

    Linear on normalised rays, one Huber-like pass that drops views off by more than three median errors.
    """
    import cv2

    rays = np.stack(
        [
            cv2.undistortPoints(
                np.asarray(q, float).reshape(1, 1, 2), views.K[i], views.distortion[i].reshape(-1, 1)
            ).ravel()
            for i, q in zip(index, uv, strict=True)
        ]
    )
    keep = np.ones(len(index), bool)
    for _ in range(2):
        A = []
        for j in np.flatnonzero(keep):
            P = np.column_stack([views.R[index[j]], views.t[index[j]]])
            A += [rays[j, 0] * P[2] - P[0], rays[j, 1] * P[2] - P[1]]
        h = np.linalg.svd(np.array(A))[2][-1]
        X = h[:3] / h[3]
        c = views.R[index] @ X + views.t[index]
        error = np.linalg.norm(c[:, :2] / c[:, 2:] - rays, axis=1) * views.K[index, 0, 0]
        bound = max(1.0, 3 * float(np.median(error)))
        if np.sum(error <= bound) < 2:
            break
        keep = error <= bound
    d = unit(views.centres[index][keep] - X)
    angle = float(np.rad2deg(np.arccos(np.clip((d @ d.T).min(), -1, 1))))
    return X, float(error[keep].mean()), angle


def estimate(inputs: ScaleInputs) -> ScaleEstimate | None:
    """Median over sides of stated over triangulated length; its spread gives the sigma."""
    if inputs.marker is None:
        return None
    spec = parse(inputs.marker)
    if inputs.views is None or inputs.frames is None:
        return None
    import cv2

    seen: dict[tuple[int, int], list[tuple[int, np.ndarray]]] = {}
    for i, name in enumerate(inputs.views.names):
        image = cv2.imread(str(inputs.frames / name), cv2.IMREAD_GRAYSCALE)
        if image is not None:
            for key, uv in detect(image, spec).items():
                seen.setdefault(key, []).append((i, uv))
    points: dict[tuple[int, int], np.ndarray] = {}
    for key, where in seen.items():
        if len(where) >= 2:
            X, error, angle = triangulate(inputs.views, [i for i, _ in where], np.array([q for _, q in where]))
            if error < 2.0 and angle > 2.0:
                points[key] = X
    ratios = np.array(_ratios(points, spec))
    if len(ratios) == 0:
        raise InputError(
            f"--marker {inputs.marker}: not seen well in two frames from different sides; use a sharper or larger "
            "marker, its right dictionary, or another source of scale"
        )
    scale = float(np.median(ratios))
    spread = mad_sigma(ratios / scale - 1)
    warnings = () if spread < 0.02 else (f"marker: its sides disagree by {100 * spread:.1f} %; is it flat and sharp?",)
    sigma = float(np.hypot(1.253 * spread / np.sqrt(len(ratios)), max(PRINT, inputs.given_sigma)))
    return ScaleEstimate("marker", scale, sigma, warnings)


def _ratios(points: dict[tuple[int, int], np.ndarray], spec: MarkerSpec) -> list[float]:
    """Stated over triangulated length of every side whose ends are known."""
    out = []
    keys = sorted(points)
    for n, a in enumerate(keys):
        for b in keys[n + 1 :]:
            if a[0] != b[0]:
                continue
            if spec.board:
                wide = spec.board[0] - 1
                steps = np.hypot(a[1] % wide - b[1] % wide, a[1] // wide - b[1] // wide)
            else:
                steps = np.sqrt(2.0) if (b[1] - a[1]) == 2 else 1.0
            length = float(np.linalg.norm(points[a] - points[b]))
            if length > 0:
                out.append(steps * spec.side_m / length)
    return out
