"""Turns a table of tracks into a sequence folder that massprops reads.

The table is CSV with the columns time [s], camera (0 or 1), point (a number), x and y [px]; a header is passed over.

    python samples/tracks_to_sequence.py tracks.csv seq --focal 1000 --size 1280x1024 --baseline 1.0
"""

import argparse

import numpy as np

import massprops

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("table")
parser.add_argument("sequence")
parser.add_argument("--focal", type=float, required=True, help="focal length [px]")
parser.add_argument("--size", required=True, help="WIDTHxHEIGHT [px]")
parser.add_argument("--centre", default="", help="X,Y of the optical axis [px]; default: the middle of the image")
parser.add_argument("--baseline", type=float, default=0.0, help="the second camera lies this far to the right [m]")
parser.add_argument("--sigma", type=float, default=0.5, help="1-sigma of a track [px]")
given = parser.parse_args()

rows = np.genfromtxt(given.table, delimiter=",")
rows = rows[np.isfinite(rows).all(axis=1)]
times, epoch = np.unique(rows[:, 0], return_inverse=True)
points, point = np.unique(rows[:, 2], return_inverse=True)
camera = rows[:, 1].astype(int)
pixels = np.full((camera.max() + 1, len(times), len(points), 2), np.nan)
pixels[camera, epoch, point] = rows[:, 3:5]

width, height = (int(v) for v in given.size.split("x"))
cx, cy = (float(v) for v in given.centre.split(",")) if given.centre else (width / 2, height / 2)
record = massprops.sequence_from_arrays(
    times,
    tracks=pixels,
    camera_matrix=np.array([[given.focal, 0, cx], [0, given.focal, cy], [0, 0, 1]]),
    size=(width, height),
    baseline=given.baseline,
    sigma_px=given.sigma,
    out=given.sequence,
)
print(f"{given.sequence}: {len(record.tracks.uv)} observations of {len(points)} points at {len(times)} times")
