"""Turns tables of tracks, attitudes or body rates into a sequence folder that massprops reads.

Tables are CSV; a header is passed over. Give one table, or several of the same body; their times need not be the same.

    tracks      time [s], camera (0 or 1), point (a number), x, y [px]
    attitudes   time [s], q_w, q_x, q_y, q_z: Hamilton's quaternion that turns body vectors into the camera's axes (any axes
                that do not turn will do where there is no camera); a further column is its 1-sigma [rad]
    rates       time [s], w_x, w_y, w_z [rad/s] in body axes

    python samples/tables_to_sequence.py seq --tracks tracks.csv --focal 1000 --size 1280x1024 --baseline 1.0
    python samples/tables_to_sequence.py seq --attitudes attitudes.csv --attitude-sigma 0.005
    python samples/tables_to_sequence.py seq --attitudes tracker.csv --scalar-last --into-body
"""

import argparse
from dataclasses import replace

import numpy as np

import massprops
from massprops.errors import InputError
from massprops.sequence import Sequence, write_sequence

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("sequence", help="folder to write")
parser.add_argument("--tracks", help="table of tracks")
parser.add_argument("--focal", type=float, help="focal length [px]; needed with --tracks")
parser.add_argument("--size", help="WIDTHxHEIGHT [px]; needed with --tracks")
parser.add_argument("--centre", help="X,Y of the optical axis [px]; default: the middle of the image")
parser.add_argument("--baseline", type=float, default=0.0, help="the second camera lies this far to the right [m]")
parser.add_argument("--sigma", type=float, default=0.5, help="1-sigma of a track [px]; default 0.5")
parser.add_argument("--attitudes", help="table of attitudes")
parser.add_argument("--scalar-last", action="store_true", help="its quaternions are q_x, q_y, q_z, q_w")
parser.add_argument("--into-body", action="store_true", help="its quaternions turn vectors into the body, as trackers'")
parser.add_argument("--attitude-sigma", type=float, default=0.01, help="1-sigma [rad] without a column; default 0.01")
parser.add_argument("--rates", help="table of body rates")
parser.add_argument("--rate-sigma", type=float, help="1-sigma of a rate [rad/s]; default: found from the rates")


def read(path: str, columns: int) -> np.ndarray:
    """Rows of a table by time, those with a number in each of its first columns."""
    rows = np.atleast_2d(np.genfromtxt(path, delimiter=","))
    if rows.shape[1] < columns:
        raise InputError(f"{path}: {rows.shape[1]} columns where {columns} are needed: see --help")
    rows = rows[np.isfinite(rows[:, :columns]).all(axis=1)]
    return rows[np.argsort(rows[:, 0], kind="stable")]


def of_tracks(given: argparse.Namespace) -> Sequence:
    if not given.focal or not given.size:
        raise InputError("--tracks needs --focal and --size")
    rows = read(given.tracks, 5)
    times, epoch = np.unique(rows[:, 0], return_inverse=True)
    points, point = np.unique(rows[:, 2], return_inverse=True)
    camera = rows[:, 1].astype(int)
    pixels = np.full((camera.max() + 1, len(times), len(points), 2), np.nan)
    pixels[camera, epoch, point] = rows[:, 3:5]
    size = tuple(int(v) for v in given.size.split("x"))
    cx, cy = (float(v) for v in given.centre.split(",")) if given.centre else (size[0] / 2, size[1] / 2)
    matrix = np.array([[given.focal, 0, cx], [0, given.focal, cy], [0, 0, 1]])
    return massprops.sequence_from_arrays(
        times, tracks=pixels, camera_matrix=matrix, size=size, baseline=given.baseline, sigma_px=given.sigma
    )


def of_attitudes(given: argparse.Namespace) -> Sequence:
    rows = read(given.attitudes, 5)
    q = rows[:, [4, 1, 2, 3]] if given.scalar_last else rows[:, 1:5]
    if given.into_body:
        q = q * [1, -1, -1, -1]
    found = massprops.sequence_from_arrays(rows[:, 0], attitude=q, attitude_sigma=given.attitude_sigma)
    if rows.shape[1] > 5 and np.isfinite(rows[:, 5]).all():
        found = replace(found, attitude=replace(found.attitude, sigma=rows[:, 5]))
    return found


def of_rates(given: argparse.Namespace) -> Sequence:
    rows = read(given.rates, 4)
    return massprops.sequence_from_arrays(rows[:, 0], rates=rows[:, 1:4], rate_sigma=given.rate_sigma)


given = parser.parse_args()
try:
    makers = {"tracks": of_tracks, "attitude": of_attitudes, "rates": of_rates}
    tables = {"tracks": given.tracks, "attitude": given.attitudes, "rates": given.rates}
    parts = {name: makers[name](given) for name, table in tables.items() if table}
    if not parts:
        raise InputError("nothing to turn: give --tracks, --attitudes or --rates")
    record = next(iter(parts.values()))  # tracks bring their cameras
    record = replace(record, **{name: getattr(part, name) for name, part in parts.items()})
    write_sequence(given.sequence, record)
except (InputError, OSError, ValueError) as stop:
    parser.exit(2, f"{stop}\n")
told = {"tracks": "observations", "attitude": "attitudes", "rates": "rates"}
counts = ", ".join(f"{len(getattr(record, name).timestamp_ns)} {told[name]}" for name in parts)
print(f"{given.sequence}: {counts}")
