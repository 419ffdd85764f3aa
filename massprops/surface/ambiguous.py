"""Images that could as well be placed a turn away, and what the body would be were they.

A body whose sides look alike is seen from one side as from another. An image is of this kind where the turned body covers
its silhouette as well as the body itself, and what it shows has the same paint after the turn. Images that follow each
other by less than half the angle between like sides have one placement: what any of them shows beside the like sides
tells it for all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massprops.core.robust import MAD_TO_SIGMA
from massprops.geometry import vectors
from massprops.mass.bodies import solid
from massprops.mass.integrals import mesh_integrals
from massprops.surface.cloud import Cloud
from massprops.surface.silhouette import agreement
from massprops.surface.symmetry import Symmetry
from massprops.views import Views, entries

TOLD = 0.2
"""Share of the points that an image shows, above which what does not look the same after the turn tells where it belongs."""
FEWEST = 40
"""Points shown by an image below which it says nothing."""
LEAST_SCATTER = 0.01
"""Smallest scatter of the overlap of a body's silhouettes with the images' own: no silhouette is known better."""


@dataclass(frozen=True)
class Ambiguity:
    """What a turn under which the body looks the same leaves open.

    Attributes:
        symmetry: the turn.
        alike: names of images that fit as well a turn away.
        apart: names of those that nothing else places.
        common, together: (10,) integrals of the solid that all turns of the body share, and of all that they cover; None
            where they could not be made.
    """

    symmetry: Symmetry
    alike: tuple[str, ...]
    apart: tuple[str, ...]
    common: np.ndarray | None
    together: np.ndarray | None


def ambiguity(
    symmetry: Symmetry,
    cloud: Cloud,
    mesh: tuple[np.ndarray, np.ndarray],
    views: Views,
    masks: list[np.ndarray],
    in_time: bool,
) -> Ambiguity:
    """What a turn leaves open.

    Args:
        cloud: measured points, those of the symmetry.
        mesh: vertices (v, 3) and faces (f, 3) of the body.
        views, masks: the images' cameras, in the order of their names, and silhouettes, as for `make_hull`.
        in_time: whether the images follow each other in time.
    """
    alike = images_alike(symmetry, cloud, mesh, views, masks)
    apart = alike & ~told(views, alike, symmetry.fold) if in_time else alike
    common, together = common_and_together(symmetry, mesh)
    names = np.array(views.names)
    return Ambiguity(symmetry, tuple(names[alike].tolist()), tuple(names[apart].tolist()), common, together)


def images_alike(
    symmetry: Symmetry, cloud: Cloud, mesh: tuple[np.ndarray, np.ndarray], views: Views, masks: list[np.ndarray]
) -> np.ndarray:
    """(n,) bool: the image fits as well after one of the turns, and what it shows looks the same after one side's."""
    which, place = entries(cloud.view_start, symmetry.points)
    view = cloud.view_index[place]
    shown = np.bincount(view, minlength=len(views))
    same = np.bincount(view, symmetry.alike[which], minlength=len(views))
    by_paint = (shown >= FEWEST) & (same >= (1.0 - TOLD) * shown)
    vertices, faces = mesh
    unturned = agreement(vertices, faces, views, masks)
    scatter = max(LEAST_SCATTER, MAD_TO_SIGMA * float(np.nanmedian(np.abs(unturned - np.nanmedian(unturned)))))
    out = np.zeros(len(views), bool)
    rows = np.flatnonzero(by_paint)
    for R, t in symmetry.turns():
        there = agreement(vertices @ R.T + t, faces, views.take(rows), [masks[i] for i in rows])
        out[rows] |= there > unturned[rows] - scatter
    return out


def told(views: Views, alike: np.ndarray, fold: int) -> np.ndarray:
    """(n,) bool: the image hangs together in time with one that fits one placement only, or is of the longest run.

    Args:
        views: in the order of their names, each camera's in a folder; alike: (n,) images that fit as well a turn away.
    """
    camera = views.folders
    run = np.zeros(len(views), int)
    for i in range(1, len(views)):
        turned = vectors.turn_deg(views.R[i].T, views.R[i - 1].T)
        run[i] = run[i - 1] + (camera[i] != camera[i - 1] or turned > 180.0 / fold)
    some = {int(k) for k in np.unique(run[~alike])} | {int(np.bincount(run).argmax())}
    return np.isin(run, list(some))


def common_and_together(
    symmetry: Symmetry, mesh: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """(10,) integrals of what all turns of the body have in common, and of all that they cover."""
    vertices, faces = (np.asarray(a) for a in mesh)
    first = solid(vertices, faces)
    if first is None:
        return None, None
    common = together = first
    for R, t in symmetry.turns():
        other = solid(vertices @ R.T + t, faces)
        if other is None:
            return None, None
        common, together = common ^ other, together + other
    rows = []
    for made in (common, together):
        m = made.to_mesh64()
        rows.append(mesh_integrals(np.asarray(m.vert_properties)[:, :3], np.asarray(m.tri_verts, int)))
    return rows[0], rows[1]
