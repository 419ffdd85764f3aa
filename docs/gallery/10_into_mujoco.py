"""Into a simulator

The mass properties of a mesh are written to a MuJoCo model, which then tumbles as the body would. Its rotation about the
middle axis is unstable, so it flips (the Dzhanibekov effect).
"""

from pathlib import Path

import mujoco
import numpy as np
import trimesh
from picture import SHORT, plt, save

import massprops

wing = trimesh.boolean.union(
    [trimesh.creation.box((0.20, 0.02, 0.02)), trimesh.creation.cylinder(0.02, 0.1).apply_translation((0, 0, 0.05))]
)
body = massprops.mass_properties(wing, density=2700)
file = massprops.export(wing, "mjcf", Path("wing.xml").resolve(), density=2700)
model = mujoco.MjModel.from_xml_path(str(file))
model.opt.gravity[:] = 0
model.opt.timestep = 0.001
data = mujoco.MjData(model)
print(f"mass {model.body_mass.sum():.6f} kg in MuJoCo, {body.mass:.6f} kg here")
print("moments there", np.sort(model.body_inertia[-1]), "and here", body.principal_moments)

data.qvel[3:6] = 6.0 * body.principal_axes[:, 1] + 0.02 * body.principal_axes[:, 0]
rates = []
for _ in range(2000 if SHORT else 12000):
    mujoco.mj_step(model, data)
    rates.append(data.qvel[3:6].copy())
times = model.opt.timestep * np.arange(len(rates))

figure, axes = plt.subplots(figsize=(7, 3), constrained_layout=True)
axes.plot(times, np.array(rates) @ body.principal_axes, label=["about 1", "about 2", "about 3"])
axes.set_xlabel("time [s]")
axes.set_ylabel("rate [rad/s]")
axes.legend(loc="upper right")
save(figure)
