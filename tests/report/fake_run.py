"""A run folder made by hand: a spacecraft-like body, cameras on a path, frames and masks, documents of every stage."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import trimesh
import yaml

from massprops.mass.document import document
from massprops.mass.properties import mass_properties
from massprops.run.stages.publish import mesh_ply
from massprops.views import Views

HOSTILE = "<script>window.hit=1</script><img src=x onerror='window.hit=1'>\"&"


def spacecraft() -> trimesh.Trimesh:
    parts = []
    for size, at in (
        ((1.2, 1.0, 1.4), (0, 0, 0)),
        ((1.4, 0.04, 1.0), (1.35, 0, 0)),
        ((1.4, 0.04, 1.0), (-1.35, 0, 0)),
        ((0.3, 0.2, 0.15), (0.25, 0.65, 0.35)),
    ):
        part = trimesh.creation.box(extents=size)
        part.apply_translation(at)
        parts.append(part.subdivide().subdivide().subdivide())
    return trimesh.util.concatenate(parts)


def cameras(count: int, size: tuple[int, int]) -> Views:
    """A turn and a half round the body, rising, all looking at it."""
    turn = np.linspace(0, 3 * np.pi, count)
    height = np.linspace(-3, 5, count)
    centre = np.column_stack([9 * np.cos(turn), 9 * np.sin(turn), height])
    z = -centre / np.linalg.norm(centre, axis=1, keepdims=True)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    R = np.stack([x, np.cross(z, x), z], axis=1)
    K = np.array([[1.1 * size[0], 0, size[0] / 2], [0, 1.1 * size[0], size[1] / 2], [0, 0, 1.0]])
    return Views(
        names=tuple(f"cam0/{i:06d}.png" for i in range(count)),
        timestamp_ns=np.arange(count, dtype=np.int64) * 500_000_000,
        size=np.tile(np.array(size), (count, 1)),
        K=np.tile(K, (count, 1, 1)),
        distortion=np.zeros((count, 4)),
        R=R,
        t=-np.einsum("nij,nj->ni", R, centre),
    )


def make_run(
    folder: Path, metric: bool = True, count: int = 12, hostile: bool = False, size: tuple[int, int] = (480, 360)
) -> Path:
    """Everything that a finished run leaves and the report reads."""
    run = folder
    for part in ("capture/frames/cam0", "sfm", "silhouettes", "dense", "surface", "scale"):
        (run / "work" / part).mkdir(parents=True)
    masks = run / "masks", run / "work" / "silhouettes" / "masks"
    for folder in masks:
        (folder / "cam0").mkdir(parents=True)
    mesh, views = spacecraft(), cameras(count, size)
    observed = mesh.triangles_center[:, 2] > -0.6
    (run / "mesh.ply").write_bytes(
        mesh_ply(np.asarray(mesh.vertices), np.asarray(mesh.faces), observed.astype(np.uint8), None)
    )
    views.save(run / "work" / "sfm" / "views.npz")
    rng = np.random.default_rng(3)
    for i, name in enumerate(views.names):
        pixel = (views.R[i] @ mesh.vertices.T).T + views.t[i]
        pixel = (pixel @ views.K[i].T)[:, :2] / pixel[:, 2:]
        hull = cv2.convexHull(pixel.astype(np.int32))
        mask = cv2.fillConvexPoly(np.zeros(size[::-1], np.uint8), hull, 255)
        image = (mask[:, :, None] * 0.6 + rng.normal(0, 12, (*mask.shape, 3)) * (mask[:, :, None] > 0)).clip(0, 255)
        mask[:, : size[0] // 2 - 60][mask[:, : size[0] // 2 - 60] > 0] = 128
        cv2.imwrite(str(run / "work" / "capture" / "frames" / name), image.astype(np.uint8))
        for folder in masks:
            cv2.imwrite(str(folder / f"{name}.png"), mask)
    properties = mass_properties(mesh, 1000.0)
    warnings = ["12 % of the surface was not measured but filled from the silhouettes"]
    if hostile:
        warnings.append(HOSTILE)
    interval = {
        "volume": [0.97 * properties.volume, 1.02 * properties.volume],
        "principal_moments": [[0.95 * m, 1.04 * m] for m in properties.principal_moments],
        "k1": [properties.k1 - 0.01, properties.k1 + 0.01],
        "k2": [properties.k2 - 0.01, properties.k2 + 0.01],
    }
    scale = {"source": "baseline", "metres_per_unit": 4.1, "relative_sigma": 0.004} if metric else {"source": "none"}
    surface = {"watertight": True, "area": float(mesh.area), "observed_fraction": float(observed.mean())}
    content = document(properties, interval, scale, surface, warnings)
    content["images"] = {"given": 40, "used": count, "registered": count}
    _json(run / "massprops.json", content)
    _json(run / "report.json", {"format": "massprops-report/1", "exit_code": 0, "reason": "", "stage": None})
    footage = {
        "given": 40,
        "used": count,
        "motion": "tumbling",
        "motion_reason": HOSTILE if hostile else "black sky",
        "frames": [
            {"name": n, "camera": 0, "timestamp_ns": int(t), "index": i}
            for i, (n, t) in enumerate(zip(views.names, views.timestamp_ns, strict=True))
        ],
    }
    work = run / "work"
    _json(work / "capture" / "footage.json", footage)
    _json(
        work / "sfm" / "sfm.json",
        {"models": [{"images": count, "points": 900}], "registered": count, "reprojection_error_px": 0.41,
         "focal_px": 528.2, "focal_sigma_relative": 0.002},
    )  # fmt: skip
    _json(work / "dense" / "dense.json", {"references": 10, "points": 123456})
    _json(work / "surface" / "surface.json", {"observed_fraction": 0.88})
    stages = {
        name: {"status": "done", "seconds": s, "cpu_seconds": 1.7 * s, "peak_memory_mb": 300.0, "warnings": []}
        for name, s in (("capture", 2.0), ("sfm", 14.0), ("dense", 31.0), ("surface", 12.0), ("mass", 1.0))
    }
    source = f"/videos/{HOSTILE}.mp4" if hostile else "/videos/probe.mp4"
    manifest = {"inputs": {"source": source}, "stages": stages, "versions": {"numpy": "2"}, "options": {"frames": 120}}
    (run / "run.yaml").write_text(yaml.safe_dump(manifest))
    return run


def add_crosscheck(run: Path, name: str = "smoother") -> None:
    """`crosscheck.json` with a sound and a lost estimator."""
    mesh = {"k1": -0.8, "k2": -0.1, "sigma_k1": 0.01, "sigma_k2": 0.004, "principal_axes": np.eye(3).tolist()}
    good = {"name": name, "k1": -0.79, "k2": -0.102, "sigma_k1": 0.008, "sigma_k2": 0.002, "converged": True,
            "axis_misalignment_deg": 0.4, "sigma_axis_deg": 0.2, "observable": True}  # fmt: skip
    lost = {**good, "name": "momentum-ls", "k1": None, "k2": None, "sigma_k1": None, "converged": False}
    verdict = {"verdict": "consistent", "p_value": 0.4, "reason": ""}
    _json(run / "crosscheck.json", {"mesh": mesh, "estimators": [good, lost], **verdict})


def _json(path: Path, content: object) -> None:
    path.write_text(json.dumps(content))


def add_everything(run: Path) -> Path:
    """What else a run may have: colours, a dense cloud, sparse points with observations, CAD, mesh and motion together."""
    from massprops.exchange.compare import compare
    from massprops.sfm.points import SparsePoints, project

    rng, mesh = np.random.default_rng(5), spacecraft()
    v, f = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    rgb = np.column_stack([np.where(v[:, 0] > 0, 200, 30), np.full(len(v), 90), np.full(len(v), 160)]).astype(np.uint8)
    origin = (mesh.triangles_center[:, 2] > -0.6).astype(np.uint8)
    (run / "mesh.ply").write_bytes(mesh_ply(v, f, origin, rgb))
    seen = v[v[:, 2] > -0.6]
    count = rng.integers(3, 20, len(seen))
    np.savez(
        run / "work" / "dense" / "points.npz", xyz=seen.astype(np.float32), normal=seen.astype(np.float32),
        rgb=rgb[v[:, 2] > -0.6], sigma=np.full(len(seen), 1e-3, np.float32),
        view_start=np.concatenate([[0], np.cumsum(count)]).astype(np.int32), view_index=np.zeros(count.sum(), np.int32),
    )  # fmt: skip
    views = Views.load(run / "work" / "sfm" / "views.npz")
    n, points = len(views), v[rng.permutation(len(v))[:80]]
    view, point = np.repeat(np.arange(n), len(points)), np.tile(np.arange(len(points)), n)
    uv = project(views.K[view], views.distortion[view], views.R[view], views.t[view], points[point])
    SparsePoints(
        np.arange(len(points)), points, np.full((len(points), 3), 128, np.uint8), np.full(len(points), 0.3),
        view.astype(np.int32), point.astype(np.int32), uv + 0.3 * rng.standard_normal(uv.shape),
    ).save(run / "work" / "sfm" / "points.npz")  # fmt: skip
    add_crosscheck(run)
    body = json.loads((run / "massprops.json").read_text())
    keys = ("volume", "mass", "center_of_mass", "inertia", "principal_moments", "principal_axes", "inertia_ratios")
    fused = {key: body[key] for key in keys} | {"with": "smoother", "interval_90": body["interval_90"]}
    crosscheck = json.loads((run / "crosscheck.json").read_text())
    crosscheck["mesh"]["k1"] = body["inertia_ratios"]["k1"]
    _json(run / "crosscheck.json", {**crosscheck, "fused": fused, "rests_on": "smoother"})
    block = {key: body[key] for key in keys if key != "inertia_ratios"} | body["inertia_ratios"]
    block |= {"source": "fused", "interval_90": body["interval_90"], "because": "mesh and motion together"}
    body |= {"recommended": block, "density_assumed": True}
    body["confidence"] = {"level": "medium", "because": ["the volume is known to ±6 %"]}
    _json(run / "massprops.json", body)
    box = trimesh.creation.box((1.2, 1.0, 1.4))
    box.export(run.parent / "cad.stl")
    compare(run, run.parent / "cad.stl", run, free_scale=False)
    return run
