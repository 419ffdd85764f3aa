"""From a video to mass properties

From frames in memory and one known length to a closed mesh and its mass properties with 90 % intervals. The truth is known
here, so the errors are printed. This takes some minutes.

The numbers below are from the short form: 40 frames of 320x240 that show two thirds of a turn. Such footage is not enough, and
the result says so: its confidence is low. One moment is half as large again as the truth.
"""

import numpy as np
from picture import SHORT, plt, save

import massprops

size, frames = ((320, 240), 40) if SHORT else ((480, 360), 70)
seen = massprops.simulate("asteroid", frames=frames, size=size, rate=6.0, seed=5)
truth = seen.truth.facts
run = massprops.reconstruct(
    seen.frames, scale=truth["greatest_length_m"], density=2000, motion="tumbling", rate_hz=10.0
)
print(run.confidence, "confidence")
low, high = run.interval["volume"]
print(f"volume {run.volume:.3f} m^3, 90 % interval {low:.3f} to {high:.3f}, truth {truth['volume']:.3f}")
ratio = run.principal_moments / run.density / (np.array(truth["principal_moments"]) / truth["density"])
print("moments over the truth:", ratio.round(3))
print("shape against motion:", run.verdict)

figure = plt.figure(figsize=(8, 3.6), constrained_layout=True)
left = figure.add_subplot(1, 2, 1)
left.imshow(seen.frames[0], cmap="gray")
left.axis("off")
right = figure.add_subplot(1, 2, 2, projection="3d")
right.plot_trisurf(*run.mesh.vertices.T, triangles=run.mesh.faces, color="#b9b2a6", lw=0)
right.set_aspect("equal")
right.axis("off")
save(figure)
