"""The truth of a rendered scene: `truth.npz` and `cad.ply` beside its images. For the judge only, never for a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from massprops.mass.properties import mass_properties


@dataclass(frozen=True, kw_only=True)
class SceneTruth:
    """What a scene shows. Object axes: those of the CAD, with the origin at the centre of mass.

    Attributes:
        names: (n,) image file names; empty strings for the frames of a video, which are numbered in their order.
        poses: (n, 3, 4) object axes -> camera axes (x right, y down, z forward) [m]. They follow the object when it
            is turned over.
        K: (3, 3) pinhole matrix; the centre of the first pixel is at (0.5, 0.5) [px].
        size: (n, 2) width and height [px].
        distortion: (2,) radial k1, k2 of OpenCV's model; zeros in scenes without it.
        placement: (n,) int, which way up the object lies.
        mesh: the CAD about its centre of mass [m].
        volume: [m^3].
        moments: (3,) principal moments at unit density, ascending [m^5].
    """

    names: tuple[str, ...]
    poses: np.ndarray
    K: np.ndarray
    size: np.ndarray
    distortion: np.ndarray
    placement: np.ndarray
    mesh: trimesh.Trimesh
    volume: float
    moments: np.ndarray

    @property
    def centres(self) -> np.ndarray:
        """(n, 3) camera centres in object axes [m]."""
        return -np.einsum("nij,ni->nj", self.poses[:, :, :3], self.poses[:, :, 3])

    def row(self, image: str) -> int | None:
        """The row of an image by the name a run gives it, or None.

        A run names the frames of a video by their index (`000012.png`) and keeps the names of photographs, to which
        it adds an ending where it had to convert them. Truth is of the first camera: images of a second one have no row.
        """
        if Path(image).parent.name == "cam1":
            return None
        name = Path(image).name
        if any(self.names):
            for candidate in (name, Path(name).stem):
                if candidate in self.names:
                    return self.names.index(candidate)
            return None
        digits = Path(name).stem
        return int(digits) if digits.isdigit() and int(digits) < len(self.poses) else None


def read_scene_truth(folder: Path) -> SceneTruth:
    """Reads `truth.npz` and `cad.ply` of a scene folder.

    Raises:
        ValueError: the CAD is not closed, or its volume is not the one stated.
    """
    with np.load(folder / "truth.npz", allow_pickle=False) as z:
        # as it stands: merging close vertices would open thin parts
        mesh = trimesh.load(folder / "cad.ply", force="mesh", process=False)
        if not mesh.is_volume or abs(mesh.volume / float(z["volume"]) - 1) > 1e-3:
            raise ValueError(f"{folder}: cad.ply does not have the volume that truth.npz states")
        mesh.apply_translation(-z["com_cad"])
        return SceneTruth(
            names=tuple(str(n) for n in z["names"]),
            poses=z["poses"],
            K=z["K"],
            size=z["size"],
            distortion=z["distortion"] if "distortion" in z.files else np.zeros(2),
            placement=z["placement"],
            mesh=mesh,
            volume=float(z["volume"]),
            moments=np.sort(z["principal"]),
        )


def truth_arrays(
    mesh: trimesh.Trimesh,
    body: np.ndarray,
    camera: np.ndarray,
    K: np.ndarray,
    size: tuple[int, int],
    clock: np.ndarray,
    **more: Any,
) -> dict[str, Any]:
    """The arrays of `truth.npz`, in the format of the shared scenes, before the images have names.

    Args:
        mesh: the CAD in its own axes [m].
        body: (n, 4, 4) CAD axes -> world.
        camera: (n, 4, 4) camera -> world.
        K: (3, 3) [px].
        size: width and height [px].
        clock: (n,) [s].
        more: arrays that take the place of the defaults, or beside them.
    """
    mass = mass_properties(mesh, 1.0)
    centred = np.array(body)
    centred[:, :3, 3] += centred[:, :3, :3] @ mass.center_of_mass
    to_camera = np.linalg.inv(camera)
    return {
        "t": clock,
        "poses": (to_camera @ centred)[:, :3],
        "object_world": centred[:, :3],
        "camera_world": to_camera[:, :3],
        "K": K,
        "distortion": np.zeros(2),
        "size": np.tile(size, (len(body), 1)),
        "placement": np.zeros(len(body), int),
        "volume": mass.volume,
        "I": mass.inertia,
        "principal": mass.principal_moments,
        "axes": mass.principal_axes,
        "extents": mesh.extents,
        "com_cad": mass.center_of_mass,
        "names": np.array([""] * len(body)),
        **more,
    }


def scene_input(folder: Path) -> Path:
    """What a user would give to the tool: the video, the folder of photographs, or a sequence folder."""
    return next((folder / f for f in ("photos", "sequence") if (folder / f).is_dir()), folder / "cam0.mp4")


def scene_folders(root: Path) -> list[Path]:
    """The finished scenes under a folder, by name: those that have a truth and images."""
    return sorted(p.parent for p in root.glob("*/truth.npz") if scene_input(p.parent).exists())
