"""A log of a gyroscope

Body rates alone, from an object that was thrown by hand and flew for a second and a half, are enough for the inertia ratios.
The diagnosis uses the balance of angular momentum and finds nothing except free rotation.
"""

from pathlib import Path

import numpy as np
from picture import plt, save

import massprops

Path("throw.yaml").write_text("kind: tracks\nrate_hz: 100\nrate_deg: 4\norbit: false\nassumed: false\n")
seen = massprops.simulate("throw.yaml", frames=160, rates=0.01, seed=7)
gyroscope = seen.sequence.rates
times = (gyroscope.timestamp_ns - gyroscope.timestamp_ns[0]) * 1e-9

record = massprops.sequence_from_arrays(times, rates=gyroscope.w, rate_sigma=0.01)
found = massprops.estimate(record, method="smoother")
print(found)
print(f"truth: k1 {seen.truth.facts['k1']:.4f}, k2 {seen.truth.facts['k2']:.4f}")
print(massprops.diagnose(record))

figure, axes = plt.subplots(figsize=(7, 3), constrained_layout=True)
axes.plot(times, np.degrees(gyroscope.w), ".", ms=3)
if found.best is not None:
    best = found.best
    axes.plot(best.times - best.times[0], np.degrees(best.w), color="k", lw=0.8)
axes.set_xlabel("time [s]")
axes.set_ylabel("body rates [deg/s]")
save(figure)
