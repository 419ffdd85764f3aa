"""From a video to a MuJoCo simulation of the tumbling body (pip install mujoco): python samples/mujoco_tumble.py"""

import sys

import mujoco
import numpy as np

import massprops
from massprops.dynamics.quaternion import angle_between, rotate

video = sys.argv[1] if len(sys.argv) > 1 else "samples/spacecraft.mp4"
length = float(sys.argv[2]) if len(sys.argv) > 2 else 5.21993  # greatest length of the body [m]
run = massprops.reconstruct(video, "runs/demo", scale=length)
seen = next(e for e in massprops.estimate(run.folder) if e.converged and e.body_frame == "attitude0")
model = mujoco.MjModel.from_xml_path(str(massprops.export(run.folder, "mjcf", "runs/demo/tumble.xml")))
model.opt.timestep = 0.002
data, centre = mujoco.MjData(model), model.body_ipos[1]
data.qpos[3:7], data.qvel[3:6] = seen.q[0], seen.w[0]  # attitude and body rates, as the footage shows them
data.qpos[:3] = -rotate(seen.q[0], centre)  # the centre of mass at the origin, and at rest
data.qvel[:3] = -rotate(seen.q[0], np.cross(seen.w[0], centre))
for t, q in zip(seen.times - seen.times[0], seen.q, strict=True):
    while data.time < t - 1e-9:
        mujoco.mj_step(model, data)
    print(f"{t:6.2f} s  {np.degrees(angle_between(data.qpos[3:7], q)):6.2f} deg from the attitude in the footage")
