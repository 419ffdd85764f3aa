"""A spin that shows nothing

A body that spins about a principal axis does not wobble. Its motion does not depend on the inertia ratios, so no estimator can
determine them. The same body with a different spin shows both ratios.
"""

from pathlib import Path

from picture import BLUE, RED, SHORT, plt, save

import massprops

figure, panels = plt.subplots(2, 1, figsize=(7, 4.5), sharex=True, constrained_layout=True)
frames = 100 if SHORT else 240
for panel, spin, colour in zip(panels, ((0, 0, 1), (0.3, 1, 0.4)), (RED, BLUE), strict=True):
    Path("scene.yaml").write_text(f"kind: tracks\nspin: {list(spin)}\nmoments: [1.0, 1.4, 1.9]\nassumed: false\n")
    seen = massprops.simulate("scene.yaml", frames=frames, seed=6)
    found = massprops.estimate(seen, method="smoother")
    print(f"spin {spin}: {found.verdict}. {found.reason or found[0]}")
    w, stamps = seen.truth.w, seen.truth.timestamp_ns
    panel.plot((stamps - stamps[0]) * 1e-9, w, color=colour)
    panel.set_title(f"{found.verdict}: spin {spin}", fontsize=10)
    panel.set_ylabel("rate [rad/s]")
panels[1].set_xlabel("time [s]")
save(figure)
