"""Stage `join`: all placements of the object in one frame, the object's own."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from massprops.core.inputs import read_image
from massprops.core.text import counted
from massprops.mass.integrals import centroid
from massprops.run.drawn_silhouettes import DRAWN, learned_paint, scene_in
from massprops.run.job import Job
from massprops.run.silhouettes_again import TESTED, redrawn
from massprops.run.stage_images import undistorted_frame, undistorted_mask
from massprops.sfm.points import SparsePoints
from massprops.views import Views, undistort

if TYPE_CHECKING:
    from massprops.sfm.across import Laid, Side
    from massprops.surface.placed import Placed
    from massprops.surface.registration import Registration

READS = ("capture", "sfm", "shape", "silhouettes")
OPTIONS = ()

AROUND = 1.5
"""Sparse points farther than this from the object's middle, in its radii, do not say how deep it lies in a view."""

TOO_COARSE = "only the outline of one of them is known, and that is too coarse to join it"
"""A padlock whose dark shackle was missing in most silhouettes fitted best, and by its paint too, the wrong way round. So of such a
placement the silhouettes must say alone how it lies."""
LOOKS_ALIKE = (
    "turned the way that fits best, both would show the same sides, and yet they have few features in common: two "
    "sides of the object look alike"
)
ALIKE = (
    "two sides of the object look alike, and it is taken to have been turned over between the photographs: if it was only moved, "
    "give one series of them alone"
)
HOLDS_MORE = 0.01
"""Share of the measured points by which a silhouette must hold more to take another's place. Of a machined part and a toy
turned over (Blender) silhouettes that were no worse missed at most .002 more."""
FEW_POINTS = 100
"""Sparse points of given poses below which stereo does not know where to look, and outlines tell where the body is."""


def run(job: Job) -> dict[str, Any]:
    """Writes views.npz and points.npz (the views and sparse points that the body is made of), other.npz where
    surroundings are known, and join.json.
    """
    views, sparse = Views.load(job.work("sfm") / "views.npz"), SparsePoints.load(job.work("sfm") / "points.npz")
    placements = json.loads((job.work("shape") / "shape.json").read_text())["placements"]
    silhouettes = json.loads((job.work("silhouettes") / "silhouettes.json").read_text())
    left_out, drawn = silhouettes["left_out"], silhouettes["method"] == DRAWN
    facts: dict[str, Any] = {"joined": [{"images": len(views)}], "unjoined": [], "support_plane": None}
    if not placements and len(sparse.xyz) < FEW_POINTS:
        facts["middle"], facts["radius"] = _by_outlines(job, views)
    if placements:
        views, sparse, facts = _joined(job, views, sparse, placements, set(left_out), drawn)
    views.save(job.out / "views.npz")
    sparse.save(job.out / "points.npz")
    for gone in facts["unjoined"]:
        job.warn(
            counted(int(gone["images"]), "image shows", "images show")
            + f" another placement of the object, which could not be joined: {gone['reason']}"
        )
    (job.out / "join.json").write_text(json.dumps(facts, indent=1))
    return {"joined": len(facts["joined"]), "unjoined": len(facts["unjoined"])}


def _joined(
    job: Job, views: Views, sparse: SparsePoints, placements: list[dict[str, Any]], left_out: set[str], drawn: bool
) -> tuple[Views, SparsePoints, dict[str, Any]]:
    """Views and points of the best placement, that most images show, and of those that fit onto it.

    Args:
        drawn: the silhouettes were drawn from each placement's shape.
    """
    from massprops.run.stages.shape import placement_folder
    from massprops.surface.cloud import Cloud
    from massprops.surface.registration import register

    number = {name: i for i, name in enumerate(views.names)}
    index = [np.array([number[n] for n in p["images"] if n not in left_out], int) for p in placements]
    shown = _sides(job, views, placements, index) if len(placements) > 1 else {}
    coarse = {k for k, p in enumerate(placements) if p["method"] != "measured"}
    order = _best_first(placements, [len(i) for i in index], {k: side[0].rim_error for k, side in shown.items()})
    first = order[0]
    facts: dict[str, Any] = {"joined": [{"images": len(index[first])}], "unjoined": []}
    parts = [(index[first], np.eye(3), np.zeros(3), first)]
    for done, k in enumerate(order[1:]):
        job.progress(done, len(order) - 1, "joining placements")
        registration = register(shown[first][0], shown[k][0], job.seed)
        entry, R, t = _laid(job, shown[first], shown[k], registration)
        if drawn and not entry.get("fits", True):
            entry, R, t = _laid_again(job, views, placements, {j: index[j] for j in (first, k)}, shown, registration)
        if "reason" not in entry and coarse & {first, k} and not entry["by_outlines"]:
            entry |= {"fits": True, "reason": TOO_COARSE}
        if "reason" in entry:
            facts["unjoined"].append({"images": len(index[k]), "placement": k, **entry})
        else:
            begin = sum(len(p[0]) for p in parts)
            entry["joint"]["views"] = [begin, begin + len(index[k]) - 1]
            facts["joined"].append({"images": len(index[k]), **entry})
            parts.append((index[k], R, t, k))
    facts |= _support(placements, shown, parts)
    if len(parts) > 1 and drawn:
        facts["redrawn"] = _redrawn(job, placements, [(views.take(m).moved(R, t), R, t, k) for m, R, t, k in parts])
        if facts["redrawn"]:
            parts = _settled(job, views, parts, {k: side[0] for k, side in shown.items()}, facts["joined"])
    around, all_views, all_points, before = [], [], [], 0
    for member, R, t, k in parts:
        folder = placement_folder(job.work("shape"), k)
        object_points = Cloud.load(folder / "object.npz").xyz
        middle = np.median(object_points, axis=0)
        radius = float(np.percentile(np.linalg.norm(object_points - middle, axis=1), 99))
        if k == first:
            facts["middle"], facts["radius"] = middle.tolist(), radius
        all_views.append(views.take(member).moved(R, t))
        all_points.append(sparse.of_views(member).near(middle, AROUND * radius).moved(R, t, before))
        # lines of sight of images that were left out go
        place = {views.names[i]: n for n, i in enumerate(member)}
        kept = np.array([place.get(name, -1) for name in placements[k]["images"]])
        around.append(Cloud.load(folder / "other.npz").of_views(kept).moved(R, t, before))
        before += len(member)
    Cloud.joined(around).save(job.out / "other.npz")
    return Views.joined(all_views), SparsePoints.joined(all_points), facts


def _support(
    placements: list[dict[str, Any]],
    shown: dict[int, tuple[Placed, Side]],
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray, int]],
) -> dict[str, Any]:
    """What the object stands on in the first of the joined placements (`parts`, as in `_settled`), as `join.json` says it; no plane where
    it was turned over, as every side was seen then. A shoe that was turned on a table and photographed all round again was left open
    below, and its volume known to 59 %, where each round alone knows it to 9 %.
    """
    from massprops.surface.stood_on import same_side

    first, *others = (k for *_, k in parts)
    turns = (R for _, R, *_ in parts[1:])
    if all(same_side(shown[first][0], shown[k][0], R) for k, R in zip(others, turns, strict=True)):
        return {key: placements[first][key] for key in ("support_plane", "support_rise")}
    return {"support_plane": None}


def _sides(
    job: Job, views: Views, placements: list[dict[str, Any]], index: list[np.ndarray]
) -> dict[int, tuple[Placed, Side]]:
    """Placements by their number, as they are laid onto each other; index: views of each."""
    out = {}
    for k, placement in enumerate(placements):
        here, support = views.take(index[k]), placement["support_plane"]
        out[k] = _placed(job, here, k, None if support is None else np.array(support)), _side(job, here, k)
    return out


def _best_first(placements: list[dict[str, Any]], images: list[int], rim_error: dict[int, float]) -> list[int]:
    """Numbers of placements, that first onto which the others are laid: a measured shape before one that is known by what it
    hides, one whose silhouettes agree with each other before one whose do not, and of these that of most images.

    Args:
        images: of each placement.
        rim_error: of those that were measured, how far the rims miss their own silhouettes [px].
    """
    from massprops.surface.registration import LARGEST

    def worth(k: int) -> tuple[bool, bool, int]:
        return placements[k]["method"] != "measured", rim_error.get(k, 0.0) > LARGEST, -images[k]

    return sorted(range(len(placements)), key=worth)


def _redrawn(
    job: Job, placements: list[dict[str, Any]], parts: list[tuple[Views, np.ndarray, np.ndarray, int]]
) -> list[str]:
    """Draws each view's silhouette from the shapes of all placements, into masks/ where it holds more of what was measured.

    What lies in shade next to its support in one placement is on top in another.

    Args:
        parts: of each joined placement its views in the object's frame, R and t that laid it there, and its number.

    Returns:
        the names of the views whose silhouettes were replaced.
    """
    from massprops.run.stages.shape import measured_folders, placement_folder

    work = job.work("shape")
    painted = learned_paint(measured_folders(work, placements))
    shown = [scene_in(placement_folder(work, k), painted).moved(R, t) for _, R, t, k in parts]
    points = np.concatenate([s.own for s in shown])
    points = points[:: max(1, len(points) // TESTED)]
    names: list[str] = []
    done, total = 0, sum(len(part[0]) for part in parts)
    for n, (views, *_) in enumerate(parts):
        whole = shown[n]
        for other in shown[:n] + shown[n + 1 :]:
            whole = whole.with_shape(other)
        before = _masks(job, views)
        for i, name in enumerate(views.names):
            if redrawn(job, views, i, whole, before[i], points, HOLDS_MORE):
                names.append(name)
            done += 1
            job.progress(done, total, "silhouettes again")
    return names


def _settled(
    job: Job,
    views: Views,
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray, int]],
    shown: dict[int, Placed],
    entries: list[dict[str, Any]],
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, int]]:
    """The parts, and what is said of them, with those that outlines alone laid fitted once more to the silhouettes drawn again.

    A first shape may lack a side, and with it the silhouettes from there: of a photographed stamp the one from its side lacked the
    handle and most of the rim, and with all of it the plate is 2 px thicker.

    Args:
        parts: of each joined placement its views, R and t that laid it onto the first, and its number.
        shown: placements by their number; entries: of `join.json`, `joint` is brought up to date.
    """
    from massprops.surface.laid_again import settled
    from massprops.surface.placed import with_silhouettes

    now = [with_silhouettes(shown[k], views.take(m), _latest(job, views.take(m)), job.seed) for m, _, _, k in parts]
    out = parts[:1]
    for (member, R, t, k), placed, facts in zip(parts[1:], now[1:], entries[1:], strict=True):
        if not facts["features"] and not facts.get("alike"):
            R, t = settled(now[0], placed, R, t)
            facts["joint"]["about"] = (R @ placed.middle + t).tolist()
        out.append((member, R, t, k))
    return out


def _entry_of(registration: Registration) -> dict[str, Any]:
    """What `join.json` says of a registration."""
    return {
        "outside_px": registration.outside_px,
        "own_px": registration.own_px,
        "rival_px": registration.rival_px,
        "colour_correlation": registration.colour,
        "rival_colour_correlation": registration.rival_colour,
        "colour_correlation_noise": registration.colour_noise,
        "symmetric": registration.symmetric,
        "by_outlines": registration.by_outlines,
    }


def _laid_again(
    job: Job,
    views: Views,
    placements: list[dict[str, Any]],
    index: dict[int, np.ndarray],
    shown: dict[int, tuple[Placed, Side]],
    registration: Registration,
) -> tuple[dict[str, Any], np.ndarray, np.ndarray]:
    """As `_laid`, of two placements that missed each other's silhouettes, by silhouettes that are drawn again from both shapes.

    A first shape lacks what lies in shade beside its support, and so do the silhouettes drawn from it. The next answer has its own
    drawn, too: a plain rock (Blender) laid rightly missed them by 2.2 px before and .5 px after, the next answer by 3.6 and 2.5.

    Args:
        index: views of the placement laid onto and of the one that is laid, by their numbers; registration: by the silhouettes before.
    """
    from massprops.surface.laid_again import drawn_again, next_answer
    from massprops.surface.placed import with_silhouettes

    pair = tuple(index)
    trial, fits = replace(job, out=job.out / "trial"), []
    for R, t in filter(None, ((registration.R, registration.t), next_answer(registration))):
        pair_views = [views.take(index[k]) for k in pair]
        _redrawn(
            trial,
            placements,
            [(pair_views[0], np.eye(3), np.zeros(3), pair[0]), (pair_views[1].moved(R, t), R, t, pair[1])],
        )
        now = [
            with_silhouettes(shown[k][0], v, _latest(trial, v), job.seed) for k, v in zip(pair, pair_views, strict=True)
        ]
        fits.append((now[0], now[1], R, t))
        shutil.rmtree(trial.out, ignore_errors=True)
    base, other = ((placed, shown[k][1]) for placed, k in zip(fits[0][:2], pair, strict=True))
    return _laid(job, base, other, drawn_again(registration, fits))


def _laid(
    job: Job, base: tuple[Placed, Side], other: tuple[Placed, Side], registration: Registration
) -> tuple[dict[str, Any], np.ndarray, np.ndarray]:
    """What is said of one placement's place on another, with a `reason` where it is not joined; and R and t.

    Args:
        registration: how they lie by their silhouettes.
    """
    from massprops.sfm.across import contradicted
    from massprops.surface.paint import overlap

    laid = _by_features(base, other, registration)
    entry = {**_entry_of(registration), "features": 0}
    alike = False
    not_turned, seen_again = _seen_again(base, other, registration, laid)
    if registration.turned is not None and not_turned and not seen_again:
        # it was turned to be seen from below
        alike, registration, laid = True, registration.turned, None
        entry = {**_entry_of(registration), "features": 0, "alike": True}
    if laid is None and not registration.clear:
        return {**entry, "fits": registration.fits, "reason": _reason(registration)}, registration.R, registration.t
    if not_turned and not alike and seen_again is False and registration.may_be_turned:
        return {**entry, "fits": True, "reason": LOOKS_ALIKE}, registration.R, registration.t
    R, t = (registration.R, registration.t) if laid is None else (laid.R, laid.t)
    # features of a body that looks alike from below have spoken for a wrong turn
    if laid is None and not (registration.unpainted or alike):
        laid = _on_both_shapes(base[1], other[1], R, t)
    # of a body of revolution another turn of the same body may have been taken, whose paint and features are elsewhere
    exact = laid is not None or not (registration.symmetric or registration.unpainted or alike)
    if exact and contradicted(base[1], other[1], R, t, overlap(base[0], other[0], R, t)):
        return {**entry, "fits": True, "reason": LOOKS_ALIKE}, R, t
    if alike:
        job.warn(ALIKE)
    if laid is not None:
        entry |= {
            "features": laid.tracks,
            "feature_matches": laid.matches,
            "feature_matches_by_chance": laid.chance,
            "features_rms_px": laid.rms_px,
        }
        entry["joint"] = {"about": laid.about.tolist(), "covariance": laid.covariance.tolist()}
        return entry, laid.R, laid.t
    about = registration.R @ other[0].middle + registration.t
    entry["joint"] = {"about": about.tolist(), "covariance": registration.covariance.tolist()}
    return entry, registration.R, registration.t


def _by_features(base: tuple[Placed, Side], other: tuple[Placed, Side], registration: Registration) -> Laid | None:
    """One placement laid onto another by features; None where too few match, or where they are of light and shade.

    Where outlines and paint are clear, features that match elsewhere are held against those that match where these say, on the shapes of
    both placements. The two ends of a toy (Blender) look alike: 42 features agreed with the wrong one, of 154, and too few with the right
    one; on both shapes it was 132 with the wrong one, 32 by chance, and 184 with the right one, 24 by chance.

    Args:
        registration: how they lie by outlines and paint.
    """
    from massprops.sfm.across import lay
    from massprops.surface.laid_again import outlines_exclude

    if registration.unpainted:
        # 509 matches of a plain rock (Blender), three times those by chance, laid it 1.4 degrees off where its outlines were 0.1 off
        return None
    laid = lay(base[1], other[1], registration.candidates, anywhere=not registration.clear)
    if laid is None or not registration.is_clearly_not(laid.R):
        return laid
    if outlines_exclude(base[0], other[0], registration, laid.R, laid.t):
        # two sides of one pattern
        return lay(base[1], other[1], registration.candidates[:1], anywhere=False)
    there = _on_both_shapes(base[1], other[1], registration.R, registration.t)
    if there is None:
        return laid
    here = _on_both_shapes(base[1], other[1], laid.R, laid.t)
    return laid if here is not None and here.over_chance > there.over_chance else there


def _on_both_shapes(base: Side, other: Side, R: np.ndarray, t: np.ndarray) -> Laid | None:
    """As `lay`, from R and t: what stereo measured of one placement only, such as a plate's rims, the other's photographs show too."""
    from massprops.sfm.across import lay

    return lay(base.beside(other, R, t), other.beside(base, R.T, -R.T @ t), [(R, t)], anywhere=False)


def _seen_again(
    base: tuple[Placed, Side], other: tuple[Placed, Side], registration: Registration, laid: Laid | None
) -> tuple[bool, bool | None]:
    """Whether a placement was laid so that both show the same side of the body, and whether their features say that they do; None where
    these are too few to tell.

    Of a screwdriver (Blender) turned over, laid half a turn wrong, and of one that was only turned on its cloth .2 to .4 of the features
    agreed that would if both showed one side; of a shoe and a bottle turned on a table .8 and .1. So they are asked only where outlines
    bear that it was turned over.
    """
    from massprops.sfm.across import same_surface
    from massprops.surface.stood_on import same_side

    R, t = (registration.R, registration.t) if laid is None else (laid.R, laid.t)
    alike = same_side(base[0], other[0], R)
    return alike, same_surface(base[1], other[1], R, t) if alike else None


def _reason(registration: Registration) -> str:
    """Why a placement is not joined."""
    if registration.fits:
        return "two ways of turning it fit equally well"
    return (
        f"however it is turned, its points fall {registration.outside_px:.1f} px outside the other's silhouettes: another "
        "object, or too little of it was measured"
    )


def _by_outlines(job: Job, views: Views) -> tuple[list[float], float]:
    """Middle and radius of the body, from its silhouettes."""
    from massprops.surface.outline_cloud import ball_of_outlines

    middle, radius = ball_of_outlines(views, _masks(job, views))
    return middle.tolist(), radius


def _placed(job: Job, views: Views, number: int, support: np.ndarray | None) -> Placed:
    """A placement as the registration wants it."""
    from massprops.run.stages.shape import placement_folder, placement_points
    from massprops.surface.photo_consistency import photographs
    from massprops.surface.placed import placed

    cloud, colour = placement_points(job.work("shape"), number)
    with np.load(placement_folder(job.work("shape"), number) / "shape.npz", allow_pickle=False) as z:
        vertices, faces = z["vertices"], z["faces"]
    masks = _masks(job, views)
    images = [undistorted_frame(job, views, i)[..., ::-1] for i in range(len(views))]
    shown = photographs(views, images, masks, vertices, faces)
    side = placed(cloud, colour, views, masks, vertices, centroid(vertices, faces), support, job.seed)
    return replace(side, photographs=shown)


def _side(job: Job, views: Views, number: int) -> Side:
    """A placement as features across placements want it."""
    from massprops.run.stages.shape import placement_folder
    from massprops.sfm.across import side_of

    with np.load(placement_folder(job.work("shape"), number) / "shape.npz", allow_pickle=False) as z:
        vertices, faces = z["vertices"], z["faces"]
    images = [undistorted_frame(job, views, i, 0) for i in range(len(views))]
    return side_of(views, images, _masks(job, views), vertices, faces)


def _masks(job: Job, views: Views) -> list[np.ndarray]:
    """Undistorted silhouettes (h, w) uint8 of the views, as each placement knows them."""
    return [undistorted_mask(job, views, i, "silhouettes") for i in range(len(views))]


def _latest(job: Job, views: Views) -> list[np.ndarray]:
    """The silhouettes of `_masks`, with those that this stage has drawn again in their place."""
    out = _masks(job, views)
    for i, name in enumerate(views.names):
        again = job.out / "masks" / f"{name}.png"
        if again.is_file():
            out[i] = undistort(read_image(again, 0), views.K[i], views.distortion[i], nearest=True)
    return out
