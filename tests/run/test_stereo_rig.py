"""Two cameras with a known baseline: images in, camera places in metres out."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from massprops.core.outputs import locked
from massprops.dynamics.quaternion import rotation_matrix
from massprops.run.reconstruct import checked_options
from massprops.run.runner import run_stages
from massprops.sequence.truth import read_truth
from massprops.sfm.points import SparsePoints
from massprops.simulation import simulate
from massprops.views import Views


def test_a_rig_gives_metres(tmp_path: Path) -> None:
    sequence = simulate("asteroid", tmp_path / "seq", frames=6, size=(320, 240), rate_deg=5.0, stereo_m=0.4, seed=111)
    run = tmp_path / "run"
    with locked(run):
        options = checked_options(sequence, {"threads": 1})
        outcome = run_stages(run, options, {"seq": "one"}, order=("capture", "sfm"))
    assert outcome.exit_code == 0, outcome.reason
    footage = json.loads((run / "work/capture/footage.json").read_text())
    sfm = json.loads((run / "work/sfm/sfm.json").read_text())
    views = Views.load(run / "work/sfm/views.npz")
    assert footage["kind"] == "stereo" and sfm["scale_metres_per_unit"] == 1.0 and sfm["registered"] == 12
    index = {f["name"]: f["index"] for f in footage["frames"]}
    at = [np.flatnonzero([n.startswith(f"cam{k}/") for n in views.names]) for k in (0, 1)]
    apart = np.linalg.norm(views.centres[at[1]] - views.centres[at[0]], axis=1)
    assert apart == pytest.approx(np.full(6, 0.4), rel=1e-6)
    ratio = depth_over_true_depth(sequence, views, SparsePoints.load(run / "work/sfm/points.npz"), at[0], index)
    assert len(ratio) > 500 and np.median(ratio) == pytest.approx(1.0, abs=1e-3)


def depth_over_true_depth(
    sequence: Path, views: Views, points: SparsePoints, own: np.ndarray, index: dict[str, int]
) -> np.ndarray:
    """Depth of every point that cam0 saw over that of the true surface along the same ray."""
    from massprops.native import ray_scene

    truth, mesh = read_truth(sequence), trimesh.load(sequence / "truth" / "mesh.ply")
    assert truth is not None
    scene = ray_scene((mesh.vertices, mesh.faces))
    out = []
    for k in own:
        seen = np.flatnonzero(points.obs_view == k)
        depth = points.xyz[points.obs_point[seen]] @ views.R[k][2] + views.t[k][2]
        ray = np.column_stack([(points.obs_uv[seen] - views.K[k][:2, 2]) / views.K[k][0, 0], np.ones(len(seen))])
        i = index[views.names[k]]
        R = rotation_matrix(truth.q[i])
        origin = np.broadcast_to(-R.T @ truth.position[i], ray.shape)
        hit = scene.cast_rays(np.concatenate([origin, ray @ R], 1).astype(np.float32))["t_hit"].numpy()
        out.append((depth / hit)[np.isfinite(hit)])
    return np.concatenate(out)
