"""Stage `shape`: a still object found in space, before there is any silhouette.

First it is told which images show which placement of the object. For each placement dense stereo measures all that lies about what
the cameras look at. In that the plane that carries it is found, and the piece that stands on the plane. The lines of sight of
everything else carve a first closed shape of that piece.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.capture.choice import Located, locate, parse
from massprops.core.files import hash_of, write_image
from massprops.core.text import counted
from massprops.dense.region import pixel_size
from massprops.errors import InputError, NotPossible
from massprops.run.job import Job
from massprops.run.stage_images import still_backgrounds, turns, undistorted_frame
from massprops.sfm.points import SparsePoints
from massprops.views import Views

if TYPE_CHECKING:
    from massprops.capture.occlusion import HiddenShape, Occlusion
    from massprops.capture.placements import Placements
    from massprops.capture.readings import Reading
    from massprops.capture.scene import Scene
    from massprops.capture.support import OnSupport
    from massprops.dense.region import Region
    from massprops.surface.cloud import Cloud

READS = ("capture", "sfm")
OPTIONS = ("object", "box", "keep_support")

REFERENCES = 30
"""Depth maps of the first, rough stereo."""
PIXELS = 40_000
"""Pixels of the region in each of them."""
POINTS = 20_000
"""Points that carry the first shape."""
LEAST_POINTS = 500
"""Dense points of the object without which there is no shape."""
WHOLE, WHOLLY = 0.6, 0.15
"""Agreement of a measured shape with what hides its support from which it is the whole thing, and by how much better what
hides the support must agree to take its place. Measured and hidden, shared scenes: a plain jug 0.36 and 0.85, a printed box
0.66 and 0.61, a banana 0.77 and 0.83, a plate with a handle 0.81 and 0.70; on a plain desk 0.26, 0.37, 0.38 and none."""
HELD = 0.8
"""Share of the measured points, in the median view, that the shape which hides the support must hold to be the whole: the
hull of a grey padlock's dark parts on a grey cloth held 0.63 of them."""
LEAST_VIEWS = 6
"""Images without which a placement is not tried."""


def run(job: Job) -> dict[str, Any]:
    """Writes shape.json and, for each placement, a folder with shape.npz (vertices, faces), object.npz, other.npz and
    their colours.

    Footage whose silhouettes the capture stage knows needs none of it: then only shape.json is written. A body that turns
    before a still background may stand on a turntable, whose plate the capture stage cannot tell from it.
    """
    from massprops.capture.placements import fill_undecided, find_placements, given_placements
    from massprops.dense.region import region_of
    from massprops.run.completion import completed

    views = Views.load(job.work("sfm") / "views.npz")
    pointed = _pointed(job, views)
    footage = json.loads((job.work("capture") / "footage.json").read_text())
    known = all((job.work("capture") / "masks" / f"{name}.png").is_file() for name in views.names)
    perhaps_carried = turns(footage)
    if not pointed and known and not perhaps_carried and not _by_room(job, footage):
        return _said(job, {"placements": [], "lost": []})
    sparse = SparsePoints.load(job.work("sfm") / "points.npz")
    if known and perhaps_carried and not pointed and not _carried(job, views, sparse):
        return _said(job, {"placements": [], "lost": []})
    region = region_of(views)
    given = given_placements(footage, views.names)
    taken = {f["name"]: f["timestamp_ns"] for f in footage["frames"]}
    times = np.array([taken[name] for name in views.names], np.int64)
    divided = given or find_placements(
        sparse.xyz, sparse.obs_view, sparse.obs_point, views.centres, region, job.seed, times
    )
    label = fill_undecided(divided.label, times)
    if not given and not divided.known and not label.any():
        label = _divided_by_occlusion(job, views, sparse, region, times)
    if given:
        placements, lost = _solved(job, views, sparse, label, pointed)
    else:
        sure = np.where(divided.known, divided.label, -1)
        label, placements, lost = _settled(job, views, sparse, (label, sure), divided, times, pointed)
    if not placements:
        raise NotPossible(lost[0]["reason"])
    for k, placement in enumerate(placements):
        placement["completed"] = completed(job, views, placement_folder(job.out, k), placement)
    odd = [views.names[i] for i in np.flatnonzero(label < 0)]
    if odd:
        lost.append({"images": odd, "reason": "they share no features with any placement"})
    for gone in lost:
        job.warn(
            counted(len(gone["images"]), "image shows", "images show")
            + f" the object in a placement that could not be solved: {gone['reason']}"
        )
    return _said(job, {"placements": placements, "lost": lost})


Solved = tuple[list[dict[str, Any]], list[dict[str, Any]]]
"""Each placement's shape, and those that could not be had, for `shape.json`."""


def _settled(
    job: Job,
    views: Views,
    sparse: SparsePoints,
    labels: tuple[np.ndarray, np.ndarray],
    divided: Placements,
    times: np.ndarray,
    pointed: list[Located],
) -> tuple[np.ndarray, *Solved]:
    """Labels (n,) on which features and shapes agree, and the placements under them.

    Args:
        labels: (n,) as they are at first, and (n,) those that the object's own features make sure, -1 elsewhere.
        divided: what these features say.
        times: (n,) when each image was taken.
    """
    from massprops.capture.placements import agreed_between_pauses, small_ones_filled, without_return
    from massprops.dense.region import region_of

    label, sure = labels
    region = region_of(views)

    def by_features(label: np.ndarray, placements: list[dict[str, Any]]) -> np.ndarray:
        # the object's own features know better than what is hidden of a plain table
        hidden = _relabelled(job, views, region, label, placements)
        return agreed_between_pauses(label, np.where(sure >= 0, sure, hidden), times)

    def by_place(label: np.ndarray, placements: list[dict[str, Any]]) -> np.ndarray:
        return without_return(_where_it_stood(job, views, region, label, placements, divided), times)

    def by_neighbours(label: np.ndarray, placements: list[dict[str, Any]]) -> np.ndarray:
        return small_ones_filled(label, times, LEAST_VIEWS)

    placements, lost = _solved(job, views, sparse, label, pointed)
    for better, least in ((by_features, 2), (by_place, 2), (by_neighbours, 0)):
        relabelled = better(label, placements) if len(placements) >= least else label
        if not np.array_equal(relabelled, label):
            label = relabelled
            placements, lost = _solved(job, views, sparse, label, pointed)
    return label, placements, lost


def _by_room(job: Job, footage: dict[str, Any]) -> bool:
    """Whether the room, too, placed images of a still object: then it is no plain backdrop, and silhouettes say nothing of
    placements, which it has put into one model."""
    if not footage["masks_given"] and footage["motion"] != "static":
        return False
    return not json.loads((job.work("sfm") / "sfm.json").read_text()).get("masked", True)


def _carried(job: Job, views: Views, sparse: SparsePoints) -> bool:
    """Whether a body that turns before a still background stands on what turns with it: a turntable's plate.

    The room takes no part: it does not hang together with what turns, and stereo finds nothing there.
    """
    from massprops.dense.region import region_of

    return _rough_support(job, views, region_of(views), sparse, turning=True) is not None


def _rough_support(
    job: Job, views: Views, region: Region, sparse: SparsePoints, turning: bool = False
) -> tuple[Cloud, np.ndarray] | None:
    """Dense points of all views and the plane (4,) that carries what they look at, or None; turning: of `find_object`."""
    from massprops.capture.scene import Scene
    from massprops.capture.stand import turning_plate
    from massprops.capture.support import find_support

    try:
        cloud, colour = _dense(job, views, region, sparse)
    except NotPossible:
        return None
    plane = find_support(cloud.xyz, cloud.normal, views.centres, region, job.seed)
    if plane is None and turning:
        scene = Scene(cloud.xyz, cloud.normal, colour, views, region, pixel_size(views, region))
        plate = turning_plate(scene, job.seed)
        plane = None if plate is None or plate.alike else plate.plane
    return None if plane is None else (cloud, plane)


def _divided_by_occlusion(
    job: Job, views: Views, sparse: SparsePoints, region: Region, times: np.ndarray
) -> np.ndarray:
    """Labels (n,) of an object that has no features to tell its placements by: by what it hides of its support."""
    from massprops.capture.occlusion import COARSE, voxels
    from massprops.capture.placements import without_return
    from massprops.capture.placements_by_occlusion import LEAST_IMAGES, divide_by_occlusion

    none = np.zeros(len(views), int)
    rough_support = _rough_support(job, views, region, sparse) if len(views) >= 2 * LEAST_IMAGES else None
    if rough_support is None:
        return none
    cloud, plane = rough_support
    maps = _occlusion(job, views, cloud, plane, region)
    return without_return(divide_by_occlusion(voxels(views, maps, plane, region, COARSE), maps, times), times)


def _solved(job: Job, views: Views, sparse: SparsePoints, label: np.ndarray, pointed: list[Located]) -> Solved:
    """Each placement's shape, and those that could not be had, for `shape.json`."""
    placements: list[dict[str, Any]] = []
    lost: list[dict[str, Any]] = []
    count = int(label.max(initial=0)) + 1
    for k in range(count):
        member = np.flatnonzero(label == k)
        names = [views.names[i] for i in member]
        try:
            if len(member) < LEAST_VIEWS:
                raise NotPossible(f"{len(member)} images are too few for a placement of its own")
            here = [replace(p, view=int(np.flatnonzero(member == p.view)[0])) for p in pointed if p.view in member]
            # the room stayed: what carried the object in most images carries it in the others
            known = placements[0]["support_plane"] if placements else None
            facts = _placement(job, views.take(member), sparse.of_views(member), len(placements), here, known)
            placements.append({"label": k, "images": names, **facts})
        except NotPossible as error:
            if count == 1 or any(p.view in member for p in pointed):
                raise
            lost.append({"images": names, "reason": str(error)})
    if not pointed:
        _of_one_size(job, views, sparse, label, placements)
    return placements, lost


def _of_one_size(
    job: Job, views: Views, sparse: SparsePoints, label: np.ndarray, placements: list[dict[str, Any]]
) -> None:
    """Solves a placement anew with what it seems to stand on, where others that stand on nothing else show a body as large as that.

    The upper part of a cup that lay on its side was taken for a thing on a stand; turned over, it was one cup.
    """
    from massprops.capture.readings import KEEP_SUPPORT

    raised = [any(r["option"] == KEEP_SUPPORT for r in p["readings"]) for p in placements]
    if all(raised) or not any(raised):
        return
    sizes = [_size(job, k) for k in range(len(placements))]
    usual = np.median(np.log([size for size, is_raised in zip(sizes, raised, strict=True) if not is_raised]))
    for k in np.flatnonzero(raised).tolist():
        placement = placements[k]
        member = np.flatnonzero(label == placement["label"])
        here = views.take(member), sparse.of_views(member), k, []
        try:
            placements[k] = placement | _placement(job, *here, whole=True)
        except NotPossible:
            continue
        if abs(np.log(_size(job, k)) - usual) > abs(np.log(sizes[k]) - usual):
            placements[k] = placement | _placement(job, *here, known=placements[0]["support_plane"] if k else None)


def _size(job: Job, number: int) -> float:
    """Volume of the convex hull of what was measured of a placement's object."""
    from scipy.spatial import ConvexHull

    from massprops.surface.cloud import Cloud

    return float(
        ConvexHull(Cloud.load(placement_folder(job.out, number) / "object.npz").xyz, qhull_options="QJ").volume
    )


def _relabelled(
    job: Job, views: Views, region: Region, label: np.ndarray, placements: list[dict[str, Any]]
) -> np.ndarray:
    """Labels (n,) once more, by which placement's first shape hides what each image hides of the support."""
    from massprops.capture.occlusion import drawn_agreement, settled
    from massprops.surface.cloud import Cloud

    plane = placements[0]["support_plane"]
    if plane is None:
        return label
    beside, shapes = [], []
    for k in range(len(placements)):
        folder = placement_folder(job.out, k)
        beside.append(Cloud.load(folder / "other.npz"))
        with np.load(folder / "shape.npz", allow_pickle=False) as z:
            shapes.append((z["vertices"], z["faces"]))
    maps = _occlusion(job, views, Cloud.joined(beside), np.array(plane), region)
    number = np.array([p["label"] for p in placements])
    placement_index = settled(
        np.where(np.isin(label, number), np.searchsorted(number, label), -1), drawn_agreement(views, maps, shapes)
    )
    return np.where(placement_index < 0, -1, number[placement_index])


def _where_it_stood(
    job: Job, views: Views, region: Region, label: np.ndarray, placements: list[dict[str, Any]], divided: Placements
) -> np.ndarray:
    """Labels (n,) in which placements are one where the object did not move between them.

    Turned about its own axis, a screwdriver (Blender) lay where it had lain, the bands of its handle too, with a correlation of .56. But
    hands had turned it in a pause: images of like direction before and after that share a tenth of the features.
    """
    from massprops.surface.same_place import colour_correlation, groups_in_place

    pixel = pixel_size(views, region)
    parts = [placement_points(job.out, k) for k in range(len(placements))]
    alike = np.zeros((len(parts), len(parts)))
    for i, (first, one) in enumerate(parts):
        for k, (second, other) in enumerate(parts[:i]):
            both = [np.flatnonzero(label == placements[j]["label"]) for j in (i, k)]
            measured = placements[i]["method"] == placements[k]["method"] == "measured"
            if measured and not divided.turned_between(*both):
                alike[i, k] = colour_correlation(first, second, (one, other), pixel)
    group = groups_in_place(alike)
    number = np.array([p["label"] for p in placements])
    out = label.copy()
    for k, g in enumerate(group):
        out[label == number[k]] = number[g]
    if len(np.unique(group)) == 1:
        out[out < 0] = number[0]  # it stood all the time, in these images too
    out[out >= 0] = np.unique(out[out >= 0], return_inverse=True)[1]
    return out


def _said(job: Job, facts: dict[str, Any]) -> dict[str, Any]:
    (job.out / "shape.json").write_text(json.dumps(facts, indent=1))
    return {"placements": [len(p["images"]) for p in facts["placements"]], "lost": len(facts["lost"])}


def _pointed(job: Job, views: Views) -> list[Located]:
    """What the user points at, in the registered views.

    Raises:
        InputError: in footage of a body that moves, where it cannot be followed; or as `locate`.
    """
    options = job.options
    if not (options.object or options.box or options.keep_support):
        return []
    footage = json.loads((job.work("capture") / "footage.json").read_text())
    if footage["motion"] == "tumbling" and footage["background"] == "black":
        raise InputError(
            "--object, --box and --keep-support are for an object that stands on something: this footage was taken for a "
            "body that moves before a black sky; leave them out, or give --motion static"
        )
    wanted = [parse("object", o) for o in options.object] + [parse("box", b) for b in options.box]
    return [locate(p, footage, views) for p in wanted]


def _placement(
    job: Job,
    views: Views,
    sparse: SparsePoints,
    number: int,
    pointed: list[Located],
    known: list[float] | None = None,
    whole: bool = False,
) -> dict[str, Any]:
    """The first shape of one placement; views and sparse points are its own, known (4,) is another one's support; whole: with what
    it seems to stand on."""
    from massprops.capture.occlusion import on_mesh
    from massprops.capture.readings import find_object
    from massprops.capture.scene import Scene
    from massprops.capture.support import least_rise
    from massprops.dense.region import region_of
    from massprops.surface.colour import vertex_colours

    region = region_of(views)
    cloud, colour = _dense(job, views, region, sparse)
    pixel = pixel_size(views, region)
    scene = Scene(cloud.xyz, cloud.normal, colour, views, region, pixel)
    support = None if known is None else np.array(known)
    turning = turns(json.loads((job.work("capture") / "footage.json").read_text()))
    object_ = find_object(scene, pointed, whole or job.options.keep_support, job.seed, support, turning)
    split = object_.split
    if object_.narrow_ledge:
        job.warn(
            "a narrow flat ledge of the object's own colour runs all about it and is taken for a part of it: if it is a stand, "
            "give --object X,Y with a pixel above the ledge"
        )
    job.progress(0, 1, "first shape")
    vertices, faces, hidden = _first_shape(job, views, cloud, split, region)
    object_cloud, other = cloud.take(np.flatnonzero(split.member)), cloud.take(np.flatnonzero(split.other))
    own_colour = colour[split.member]
    folder = placement_folder(job.out, number)
    folder.mkdir(exist_ok=True)
    if hidden is not None:
        own_colour, seen = vertex_colours(vertices, faces, views, lambda i: undistorted_frame(job, views, i))
        object_cloud, own_colour = on_mesh(vertices, faces).take(np.flatnonzero(seen)), own_colour[seen]
        np.savez(folder / "support.npz", xyz=hidden.support, colour=hidden.colour)
    np.savez(folder / "shape.npz", vertices=vertices, faces=faces)
    object_cloud.save(folder / "object.npz")
    np.save(folder / "colour.npy", own_colour)
    np.save(folder / "other_colour.npy", colour[split.other])
    other.save(folder / "other.npz")
    return {
        "method": "measured" if hidden is None else "hides its support",
        "readings": _readings(job, scene, object_.readings, number),
        "support_plane": None if split.plane is None else split.plane.tolist(),
        "support_rise": None
        if split.plane is None
        else least_rise(cloud.xyz, cloud.normal, split.plane, region, pixel),
        "object_points": len(object_cloud),
        "other_points": int(split.other.sum()),
        "region_radius": region.radius,
    }


def _first_shape(
    job: Job, views: Views, cloud: Cloud, split: OnSupport, region: Region
) -> tuple[np.ndarray, np.ndarray, Occlusion | None]:
    """Vertices and faces of the shape that stereo has measured, or of what hides its support, and then where that is.

    Of a plain thing stereo measures a part. Where the support shows round all of it, what is hidden of the support shows
    the whole.
    """
    from massprops.capture.occlusion import hidden_shape, support_agreement

    try:
        vertices, faces = _measured_shape(job, views, cloud, split)
    except NotPossible as error:
        if split.plane is None:
            raise
        maps = _occlusion(job, views, cloud, split.plane, region)
        hidden = hidden_shape(views, maps, split.plane, region)
        if hidden is None:
            raise error
        return hidden.vertices, hidden.faces, maps
    if split.plane is not None:
        maps = _occlusion(job, views, cloud, split.plane, region)
        agrees = support_agreement(views, maps, vertices, faces)
        if agrees < WHOLE:
            hidden = _hidden_whole(views, maps, split.plane, region, (vertices, faces), cloud.xyz[split.member])
            if hidden is not None and support_agreement(views, maps, hidden.vertices, hidden.faces) > agrees + WHOLLY:
                return hidden.vertices, hidden.faces, maps
    return vertices, faces, None


def _hidden_whole(
    views: Views,
    maps: Occlusion,
    plane: np.ndarray,
    region: Region,
    measured: tuple[np.ndarray, np.ndarray],
    xyz: np.ndarray,
) -> HiddenShape | None:
    """What hides the support, with what was `measured` (vertices, faces) where the one alone leaves out the other."""
    from massprops.capture.occlusion import held_share, hidden_by, hidden_shape

    hidden = hidden_shape(views, maps, plane, region)
    if hidden is not None and held_share(views, hidden.vertices, hidden.faces, xyz) > HELD:
        return hidden
    return hidden_shape(views, hidden_by(views, maps, *measured), plane, region)


def _measured_shape(job: Job, views: Views, cloud: Cloud, split: OnSupport) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of the shape that stereo has measured."""
    from massprops.surface.reconstruct import Fill, reconstruct_surface

    if split.member.sum() < LEAST_POINTS:
        what = "nothing stands out" if split.plane is None else "nothing rises from the plane"
        raise NotPossible(
            f"{what} where the cameras look: keep the object in the middle of the images, give it texture or side light, "
            "or give its silhouettes with --masks"
        )
    object_cloud, other = cloud.take(np.flatnonzero(split.member)), cloud.take(np.flatnonzero(split.other))
    surface = reconstruct_surface(
        views,
        [],
        object_cloud,
        POINTS,
        job.seed,
        job.progress,
        split.plane,
        moving=False,
        surroundings=other,
        fill=Fill(pull=0.0),
    )
    return surface.vertices, surface.faces


def _occlusion(job: Job, views: Views, cloud: Cloud, plane: np.ndarray, region: Region) -> Occlusion:
    """Where each view shows the support, and where something hides it."""
    from massprops.capture.occlusion import occlusion_maps, support_points, with_still
    from massprops.capture.support import TOLERANCE, on_plane

    held = cloud.xyz[on_plane(cloud.xyz, cloud.normal, plane, TOLERANCE * region.radius)]
    pixel = pixel_size(views, region)
    maps = occlusion_maps(
        views, lambda i: undistorted_frame(job, views, i), *support_points(plane, region, held, pixel)
    )
    still = still_backgrounds(job, views)
    return maps if still is None else with_still(maps, still)


def _readings(job: Job, scene: Scene, readings: list[Reading], number: int) -> list[dict[str, Any]]:
    """The readings between which nothing decides, each with its picture, for `shape.json`."""
    from massprops.capture.readings import best_view, described, picture

    out = []
    for k, reading in enumerate(readings):
        i = best_view(readings[-1], scene)
        views = scene.views
        drawn = picture(reading, scene, i, undistorted_frame(job, views, i))
        file = f"placement{number}/reading{k}.png"
        write_image(job.out / file, drawn)
        out.append({**described(reading, scene, used=k == 0), "picture": file, "image": views.names[i]})
    return out


def placement_folder(work: Path, number: int) -> Path:
    """Where the files of a placement are."""
    return work / f"placement{number}"


def measured_folders(work: Path, placements: list[dict[str, Any]]) -> list[Path]:
    """Folders of the placements of `shape.json` that stereo has measured."""
    return [placement_folder(work, k) for k, p in enumerate(placements) if p["method"] == "measured"]


def placement_points(work: Path, number: int) -> tuple[Cloud, np.ndarray]:
    """The points of a placement's object that agree with their neighbours, and their colours (n, 3) uint8."""
    from massprops.surface.cloud import Cloud, agreeing

    folder = placement_folder(work, number)
    cloud, colour = Cloud.load(folder / "object.npz"), np.load(folder / "colour.npy", allow_pickle=False)
    kept = agreeing(cloud)
    return cloud.take(kept), colour[kept]


def _dense(job: Job, views: Views, region: Region, sparse: SparsePoints) -> tuple[Cloud, np.ndarray]:
    """Dense points of the region, whatever they belong to, and their colours (n, 3) uint8."""
    from massprops.dense.reconstruct import DenseOptions, dense_points
    from massprops.surface.cloud import Cloud

    # the depth range of a view comes from its sparse points
    near = sparse.near(region.centre, 1.3 * region.radius)

    def image(i: int) -> tuple[np.ndarray, np.ndarray]:
        return undistorted_frame(job, views, i), region.mask(views, i)

    options = DenseOptions(REFERENCES, job.seed, job.threads, PIXELS, tentative=True)
    parts = job.parts.within(hash_of([views.names, region.centre, region.radius]))
    points, _ = dense_points(views, image, near, options, job.progress, parts)
    cloud = Cloud(*(np.asarray(getattr(points, k)) for k in Cloud.__dataclass_fields__))
    good = cloud.is_finite
    return cloud.take(np.flatnonzero(good)).finite(), points.rgb[good]
