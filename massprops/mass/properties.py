"""Mass properties of a closed mesh at constant density, and the principal frame with its sign rule."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.dynamics.inertia import is_physical, ratios_of_moments
from massprops.errors import InputError
from massprops.mass.integrals import central_inertia, mesh_integrals

if TYPE_CHECKING:
    import trimesh

DEGENERATE = 1e-7
"""Relative difference of two moments below which their axes are not defined by the body."""


ASSUMED_DENSITY = 1000.0
"""That of water [kg/m^3], where nobody gives one."""


@dataclass(frozen=True)
class MassProperties:
    """Inertia about the centre of mass in the mesh's axes, tensor signs (`I_xy = -int x y dm`).

    Attributes:
        density: [mass / length^3].
        volume: [length^3].
        mass: density times volume.
        center_of_mass: (3,) in the mesh's axes [length].
        inertia: (3, 3) [mass length^2].
        principal_moments: (3,) ascending.
        principal_axes: (3, 3), columns, right-handed; signs by `principal_frame`.
        k1: ln(I1 / I2).
        k2: ln(I2 / I3).
    """

    density: float
    volume: float
    mass: float
    center_of_mass: np.ndarray
    inertia: np.ndarray
    principal_moments: np.ndarray
    principal_axes: np.ndarray
    k1: float
    k2: float

    @classmethod
    def of(cls, density: float, volume: float, centre: np.ndarray, inertia: np.ndarray) -> MassProperties:
        """Those of a volume, a centre of mass (3,) and an inertia about it (3, 3)."""
        moments, axes = principal_frame(inertia)
        return cls(
            density, volume, density * volume, centre, inertia, moments, axes, *ratios_of_moments(moments).tolist()
        )

    def values(self) -> dict[str, Any]:
        """All but the density, by the keys and in the plain numbers of `massprops.json`."""
        return {
            "volume": self.volume,
            "mass": self.mass,
            "center_of_mass": self.center_of_mass.tolist(),
            "inertia": self.inertia.tolist(),
            "principal_moments": self.principal_moments.tolist(),
            "principal_axes": self.principal_axes.tolist(),
            "inertia_ratios": {"k1": self.k1, "k2": self.k2},
        }


def principal_frame(inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Principal moments and axes, unique for every tensor.

    Moments ascend. Of columns 1 and 3 the component of largest magnitude is positive (the first of equals), and
    column 2 = column 3 x column 1, so the frame is right-handed. Where two or three moments are equal to
    `DEGENERATE`, any axes in their plane are principal: the mesh axis that lies nearest to the plane (the first of
    equals) is projected into it and taken, so that a cube gets the mesh's own axes.

    Args:
        inertia: (3, 3) symmetric.

    Returns:
        moments (3,), axes (3, 3) as columns.
    """
    moments, axes = np.linalg.eigh(0.5 * (inertia + inertia.T))
    near = DEGENERATE * abs(moments[2])
    low, high = moments[1] - moments[0] <= near, moments[2] - moments[1] <= near
    if low and high:
        return moments, np.eye(3)
    if low:
        axes[:, 0] = _nearest_in_plane(axes[:, 2])
    if high:
        axes[:, 2] = _nearest_in_plane(axes[:, 0])
    first, third = _positive(axes[:, 0]), _positive(axes[:, 2])
    return moments, np.column_stack([first, np.cross(third, first), third])


def _nearest_in_plane(normal: np.ndarray) -> np.ndarray:
    """The mesh axis nearest to the plane, projected into it; unit length."""
    axis = int(np.argmin(np.round(np.abs(normal), 9)))
    inside = np.eye(3)[axis] - normal[axis] * normal
    return inside / np.linalg.norm(inside)


def _positive(axis: np.ndarray) -> np.ndarray:
    """The same line with its largest component positive; rounding makes near ties go to the first."""
    return axis * np.sign(axis[int(np.argmax(np.round(np.abs(axis), 9)))])


def properties_of_integrals(row: np.ndarray, density: float) -> MassProperties:
    """Mass properties of the integrals (10,) of `massprops.mass.integrals` and a density [kg/m^3].

    Raises:
        InputError: the density is not positive, or the integrals are those of no body.
    """
    if not (np.isfinite(density) and density > 0):
        raise InputError(f"density {density} kg/m^3 is not a positive number: give --density above 0")
    if not row[0] > 0:
        raise InputError(
            f"mesh encloses a volume of {row[0]:.3g}, not above 0: turn its faces outward, or close its holes"
        )
    _, centre, inertia = central_inertia(row, density)
    body = MassProperties.of(float(density), float(row[0]), centre, inertia)
    if not is_physical(body.principal_moments):
        moments = ", ".join(f"{m:.4g}" for m in body.principal_moments)
        raise InputError(
            f"mesh has moments {moments}, which no body has: it intersects itself or is inside out; export it as a solid"
        )
    return body


def mass_properties(mesh: trimesh.Trimesh, density: float = 1000.0) -> MassProperties:
    """Mass properties of a closed mesh filled with one density.

    Args:
        mesh: watertight, consistently and outwardly wound; lengths in metres for a density in kg/m^3.
        density: [mass / length^3].

    Raises:
        InputError: the mesh has holes or is wound inconsistently. Its "volume" would change with the origin, so no
            number is given; `massprops.mass.repair.repair` may close it.
    """
    if not mesh.is_volume:
        raise InputError(
            f"mesh of {len(mesh.faces)} faces has holes, or faces that point inward: repair it, or export it as a solid"
        )
    return properties_of_integrals(mesh_integrals(mesh.vertices, mesh.faces), density)
