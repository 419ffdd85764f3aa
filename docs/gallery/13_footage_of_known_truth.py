"""Footage with known truth

An asteroid in sunlight, rendered together with the truth. Use it to try massprops before you film.
"""

import numpy as np
from picture import SHORT, plt, save

import massprops

seen = massprops.simulate("asteroid", frames=6, size=(120, 90) if SHORT else (320, 240), rate=12.0, seed=1)
print(seen)
truth = seen.truth.facts
print(f"volume {truth['volume']:.4f} m^3, greatest length {truth['greatest_length_m']:.3f} m, k1 {truth['k1']:.3f}")

figure, panels = plt.subplots(2, 3, figsize=(7.5, 4), constrained_layout=True)
for panel, frame in zip(panels.ravel(), seen.frames, strict=True):
    panel.imshow(frame, cmap="gray", vmin=0, vmax=255)
    panel.axis("off")
figure.suptitle(f"{np.degrees(np.linalg.norm(seen.truth.w[0])):.0f} deg/s")
save(figure)
