"""The polhode

The angular velocity of a free body, seen in the axes of the body, moves along a closed curve: the intersection of the
ellipsoids of its energy and of its momentum. The inertia ratios determine the shape of this curve. That is why the motion
shows them.
"""

import numpy as np
from picture import BLUE, GREY, RED, plt, save

from massprops.dynamics.rigid_body import propagate

moments = np.array([1.0, 1.6, 2.2])
figure = plt.figure(figsize=(6, 5))
axes = figure.add_subplot(projection="3d")
for angle, colour in ((0.15, BLUE), (0.7, BLUE), (1.2, RED), (1.45, RED)):
    start = np.array([np.cos(angle), 0.02, np.sin(angle)])
    start *= np.sqrt(1.0 / (moments @ start**2))  # one energy for all
    times = np.linspace(0, 60, 1500)
    _, w = propagate(np.array([1.0, 0, 0, 0]), start, np.diag(moments), times)
    energy = w**2 @ moments
    print(f"start {start.round(3)}: energy kept to {np.ptp(energy):.1e}")
    axes.plot(*w.T, color=colour)
u, v = np.mgrid[0 : 2 * np.pi : 40j, 0 : np.pi : 20j]
radius = 1 / np.sqrt(moments)
axes.plot_surface(
    radius[0] * np.cos(u) * np.sin(v), radius[1] * np.sin(u) * np.sin(v), radius[2] * np.cos(v), color=GREY, alpha=0.15
)
axes.set_xlabel("w1")
axes.set_ylabel("w2")
axes.set_zlabel("w3")
axes.set_aspect("equal")
save(figure)
