"""A sequence from your own tracks

Arrays of pixels, with one row per time and one column per point, become a sequence that `estimate` and `diagnose` can read.
A point that is not seen is NaN. The first axis of the array distinguishes the two cameras of the stereo pair.
"""

import numpy as np
from picture import BLUE, SHORT, plt, save

import massprops

# in place of your own tracker: pixels (2 cameras, n times, m points, 2) of a simulated body
seen = massprops.simulate("tracks", frames=100 if SHORT else 300, seed=8)
tracks = seen.sequence.tracks
stamps = np.unique(tracks.timestamp_ns)
pixels = np.full((2, len(stamps), tracks.feature.max() + 1, 2), np.nan)
pixels[tracks.camera, np.searchsorted(stamps, tracks.timestamp_ns), tracks.feature] = tracks.uv
fu, fv, cu, cv = seen.sequence.cameras[0].intrinsics

record = massprops.sequence_from_arrays(
    stamps * 1e-9,
    tracks=pixels,
    camera_matrix=np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]]),
    size=(1280, 1024),
    baseline=1.0,
    sigma_px=0.3,
    environment=seen.sequence.environment,  # the orbit; leave it out where gravity does not matter
    out="my_sequence",  # for the command line: massprops estimate my_sequence
)
found = massprops.estimate(record, method="smoother")
print(found)
print(f"truth: k1 {seen.truth.facts['k1']:.4f}, k2 {seen.truth.facts['k2']:.4f}")

figure, axes = plt.subplots(figsize=(6, 4.5), constrained_layout=True)
for point in range(pixels.shape[2]):
    axes.plot(*pixels[0, :, point].T, lw=0.7, color=BLUE)
axes.set_xlim(0, 1280)
axes.set_ylim(1024, 0)
axes.set_xlabel("x [px]")
axes.set_ylabel("y [px]")
save(figure)
