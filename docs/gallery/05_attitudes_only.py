"""Inertia ratios from attitudes

A star tracker, a motion capture system or structure from motion gives attitudes but no points. Attitudes are enough.
"""

import numpy as np
from picture import BLUE, RED, SHORT, plt, save

import massprops

seen = massprops.simulate("tracks", frames=100 if SHORT else 300, attitude=0.005, seed=12)
history = seen.sequence.attitude
times = (history.timestamp_ns - history.timestamp_ns[0]) * 1e-9

record = massprops.sequence_from_arrays(times, attitude=history.q, attitude_sigma=0.005)
found = massprops.estimate(record, method=["smoother", "momentum-ls"])
for one in found:
    print(one)
print(f"truth: k1 {seen.truth.facts['k1']:.4f}, k2 {seen.truth.facts['k2']:.4f}")

figure, axes = plt.subplots(figsize=(5.5, 4.5), constrained_layout=True)
for one, colour in zip(found, (RED, BLUE), strict=False):
    if one.k_covariance is None:
        continue
    values, vectors = np.linalg.eigh(one.k_covariance)
    turn = np.linspace(0, 2 * np.pi, 100)
    for reach in (1.52, 2.15):  # 68 and 90 % in two dimensions
        ring = vectors @ (reach * np.sqrt(values)[:, None] * np.stack([np.cos(turn), np.sin(turn)]))
        axes.plot(one.k1 + ring[0], one.k2 + ring[1], color=colour, lw=1)
    axes.plot(one.k1, one.k2, "o", color=colour, label=one.name)
axes.plot(seen.truth.facts["k1"], seen.truth.facts["k2"], "k+", ms=12, label="truth")
axes.set_xlabel("k1 = ln(I1/I2)")
axes.set_ylabel("k2 = ln(I2/I3)")
axes.legend()
save(figure)
