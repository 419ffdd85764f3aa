"""Compare a mesh with its CAD mesh

Two meshes are aligned. Then every mass property is compared, and the distance between the surfaces is measured. Red is
outside the CAD mesh, blue is inside.
"""

import numpy as np
import trimesh
from picture import plt, save

import massprops

cad = trimesh.creation.capsule(height=0.2, radius=0.06, count=[48, 48])
scan = cad.copy()
scan.vertices += 0.0015 * np.sin(40 * scan.vertices[:, 2:3]) * scan.vertex_normals
scan.apply_transform(trimesh.transformations.rotation_matrix(0.7, (1, 2, 3)))

found = massprops.compare(scan, cad)
for row in found.rows:
    print(f"{row['quantity']:<16} CAD {row['cad']:.5g}  scan {row['ours']:.5g}  {row['error_text']}")

figure = plt.figure(figsize=(6, 4.5))
axes = figure.add_subplot(projection="3d")
faces, points = found.mesh.faces, found.mesh.vertices
shown = axes.plot_trisurf(*points.T, triangles=faces, cmap="coolwarm", lw=0)
shown.set_array(1000 * found.vertex_distance[faces].mean(axis=1))
figure.colorbar(shown, label="distance [mm]", shrink=0.7)
axes.set_aspect("equal")
save(figure)
