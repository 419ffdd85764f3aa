"""Stage `publish`: the run's public files in final units, from what the stages left; all of them or none."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np

from massprops.consistency.trust import judged
from massprops.core.files import write_json, write_whole
from massprops.core.outputs import Outputs
from massprops.documents.body import LARGEST_SIGMA
from massprops.run.job import Job, ReconstructOptions
from massprops.sfm.footage import DRAWN_BY
from massprops.sfm.model_bytes import write_model

READS = ("capture", "sfm", "silhouettes", "join", "dense", "surface", "scale", "mass", "colour", "sequence")
OPTIONS = ()
PUBLISHES = "reconstruct"

FACE_COLOURS = ((214, 48, 49, 255), (178, 186, 194, 255), (9, 132, 227, 255))
"""Of faces filled in, measured, and closed at the plane of support: by `origin`."""


def run(job: Job) -> dict[str, Any]:
    """Writes what there is; a stopped run gets the files of the stages that were done."""
    scale = _read(job.work("scale") / "scale.json") or {}
    factor = float(scale.get("metres_per_unit") or 1.0) * float(scale.get("unit_per_sfm") or 1.0)
    outputs = Outputs(job.run)
    new = outputs.staging()
    done = []
    for name, publish in (
        ("mass", _document),
        ("surface", _mesh),
        ("dense", _cloud),
        ("sfm", _sparse),
        ("silhouettes", _masks),
        ("sequence", _sequence),
    ):
        job.progress(len(done), 6, name)
        if job.work(name).is_dir() and publish(job, new, factor):
            done.append(name)
    outputs.publish(PUBLISHES, job.key, sources(job.options), job.force)
    return {"published": done, "metres_per_sfm_unit": factor}


def sources(options: ReconstructOptions) -> list[Path]:
    """What a run reads, and so never writes over."""
    return [Path(p) for p in (options.source, *options.more, options.masks, options.sparse) if p]


def _read(path: Path) -> dict[str, Any] | None:
    return json.loads(path.read_text()) if path.is_file() else None


def _document(job: Job, new: Path, factor: float) -> bool:
    document = _read(job.work("mass") / "massprops.json")
    if document is None:
        return False
    footage, sfm = _read(job.work("capture") / "footage.json") or {}, _read(job.work("sfm") / "sfm.json") or {}
    known = Outputs(job.run).files.get("crosscheck.json")
    if known is not None and known.get("of") == job.key:  # published anew, as it was
        document = judged(document, document, _read(job.run / "crosscheck.json") or {})
    document["images"] = {
        "given": footage.get("given", len(footage.get("frames", []))),
        "used": footage.get("used", len(footage.get("frames", []))),
        "registered": sfm.get("registered"),
    }
    warnings = [*footage.get("warnings", []), *sfm.get("warnings", []), *document.get("warnings", [])]
    document["warnings"] = list(dict.fromkeys(warnings))
    write_json(new / "massprops.json", document)
    return True


def _mesh(job: Job, new: Path, factor: float) -> bool:
    import trimesh

    path = job.work("surface") / "surface.npz"
    if not path.is_file():
        return False
    with np.load(path, allow_pickle=False) as z:
        vertices, faces, observed = z["vertices"] * factor, z["faces"], z["observed"].astype(bool)
        inferred = z["inferred"].astype(bool)
    origin = np.where(observed, 1, np.where(inferred, 2, 0)).astype(np.uint8)
    painted = job.work("colour") / "colour.npz"
    rgb = None
    if painted.is_file():
        with np.load(painted, allow_pickle=False) as z:
            rgb = z["rgb"]
    write_whole(new / "mesh.ply", mesh_ply(vertices, faces, origin, rgb))
    colours = {"face_colors": np.array(FACE_COLOURS, np.uint8)[origin]} if rgb is None else {"vertex_colors": rgb}
    mesh = trimesh.Trimesh(vertices, faces, process=False, **colours)
    write_whole(new / "mesh.glb", mesh.export(file_type="glb"))
    return True


def mesh_ply(vertices: np.ndarray, faces: np.ndarray, origin: np.ndarray, rgb: np.ndarray | None) -> bytes:
    """A binary PLY with double coordinates, the photographs' colours on vertices, and on faces where they come from.

    Args:
        vertices: (v, 3).
        faces: (f, 3).
        origin: (f,) uint8, 0 filled in, 1 measured, 2 closed at the plane of support.
        rgb: (v, 3) uint8, or None where no photograph coloured it.
    """
    paint = "" if rgb is None else "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        "comment observed: 1 measured, 0 not\n"
        "comment origin: 0 filled in, 1 measured, 2 closed at the plane of support\n"
        f"element vertex {len(vertices)}\nproperty double x\nproperty double y\nproperty double z\n{paint}"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n"
        "property uchar observed\nproperty uchar origin\nend_header\n"
    )
    point = np.zeros(len(vertices), dtype=[("xyz", "<f8", 3), *([] if rgb is None else [("rgb", "u1", 3)])])
    point["xyz"] = vertices
    if rgb is not None:
        point["rgb"] = rgb
    kinds = [("n", "u1"), ("v", "<i4", 3), ("rgba", "u1", 4), ("observed", "u1"), ("origin", "u1")]
    row = np.zeros(len(faces), dtype=kinds)
    row["n"], row["v"], row["origin"], row["observed"] = 3, faces, origin, origin == 1
    row["rgba"] = np.array(FACE_COLOURS, np.uint8)[origin]
    return header.encode() + point.tobytes() + row.tobytes()


def _cloud(job: Job, new: Path, factor: float) -> bool:
    path = job.work("dense") / "points.npz"
    if not path.is_file():
        return False
    with np.load(path, allow_pickle=False) as z:
        xyz, normal, rgb = z["xyz"] * factor, z["normal"], z["rgb"]
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(xyz)}\n"
        + "".join(f"property float {p}\n" for p in ("x", "y", "z", "nx", "ny", "nz"))
        + "".join(f"property uchar {p}\n" for p in ("red", "green", "blue"))
        + "end_header\n"
    )
    row = np.zeros(len(xyz), dtype=[("p", "<f4", 3), ("n", "<f4", 3), ("c", "u1", 3)])
    row["p"], row["n"], row["c"] = xyz, normal, rgb
    write_whole(new / "cloud.ply", header.encode() + row.tobytes())
    return True


def _sparse(job: Job, new: Path, factor: float) -> bool:
    import zlib  # noqa: F401  (before pycolmap: see the package's __init__)

    import pycolmap

    from massprops.sfm.object_axes import in_object_axes
    from massprops.views import Views

    source = job.work("sfm") / "sparse"
    if not source.is_dir():
        return False
    model = pycolmap.Reconstruction(source)
    place = _read(job.work("join") / "join.json")
    # of one placement the room's axes are the object's
    if place is not None and len(place["joined"]) + len(place["unjoined"]) > 1:
        model = in_object_axes(model, Views.load(job.work("join") / "views.npz"))
    model.transform(pycolmap.Sim3d(factor, pycolmap.Rotation3d(), np.zeros(3)))
    write_model(model, new / "sparse")
    return True


def _masks(job: Job, new: Path, factor: float) -> bool:
    sources = [job.work(stage) / "masks" for stage in DRAWN_BY]
    if not sources[0].is_dir():
        return False
    for source in sources:
        if source.is_dir():
            shutil.copytree(source, new / "masks", dirs_exist_ok=True)
    return True


def _sequence(job: Job, new: Path, factor: float) -> bool:
    source = job.work("sequence") / "sequence"
    if not source.is_dir():
        return False
    from massprops.sequence.data import Body
    from massprops.sequence.write import body_yaml

    shutil.copytree(source, new / "sequence")
    document = _read(new / "massprops.json")
    if document is not None and not (new / "sequence" / "body.yaml").is_file():
        import yaml

        metric = document["units"]["length"] == "m"
        body = Body(
            inertia=np.array(document["inertia"]),
            inertia_units="kg m^2" if metric else "ratio",
            mass_kg=document["mass"] if metric else None,
            centre_of_mass_m=np.array(document["center_of_mass"]) if metric else None,
            source=f"mesh, constant density {document['density']:g} kg m^-3",
            inertia_sigma=_relative_sigma(document),
        )
        (new / "sequence" / "body.yaml").write_text(yaml.safe_dump(body_yaml(body), sort_keys=False))
    return True


def _relative_sigma(document: dict[str, Any]) -> float | None:
    """One sigma of the moments, relative, from their 90 % intervals, at most the largest that a sequence states; None when there
    are none."""
    bounds = document.get("interval_90", {}).get("principal_moments")
    if not bounds:
        return None
    halves = [
        (high - low) / (2 * 1.645 * value)
        for (low, high), value in zip(bounds, document["principal_moments"], strict=True)
    ]
    return min(float(np.mean(halves)), LARGEST_SIGMA)
