"""Mass properties of a mesh

The volume, centre of mass and inertia of a mesh in memory. The lines are the principal axes.
"""

import numpy as np
import trimesh
from picture import BLUE, GREEN, RED, plt, save

import massprops

bar = trimesh.creation.box((0.30, 0.06, 0.04))
ball = trimesh.creation.icosphere(subdivisions=3, radius=0.06)
ball.apply_translation((0.15, 0, 0.02))
club = trimesh.boolean.union([bar, ball])

body = massprops.mass_properties(club, density=2700)
print(body)
print("centre of mass [m]:", body.center_of_mass.round(4))

figure = plt.figure(figsize=(6, 4))
axes = figure.add_subplot(projection="3d")
axes.plot_trisurf(*club.vertices.T, triangles=club.faces, color="#c8ccd0", edgecolor="#9aa0a6", lw=0.1, alpha=0.5)
for axis, colour in zip(body.principal_axes.T, (RED, GREEN, BLUE), strict=True):
    line = body.center_of_mass + 0.14 * np.outer([-1, 1], axis)
    axes.plot(*line.T, color=colour, lw=2)
axes.set_aspect("equal")
save(figure)
