"""Stage: the surface and the scale -> mass properties with intervals, and the mesh in final units."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from massprops.core.inputs import read_image
from massprops.mass.confidence import (
    Evidence,
    ImageEvidence,
    PlacementEvidence,
    SurfaceEvidence,
    confidence,
    lowered,
)
from massprops.mass.document import document
from massprops.mass.integrals import mesh_integrals, scale_integrals
from massprops.mass.intervals import OWN_LENGTH, intervals, scaled_replicates, valid_bodies
from massprops.mass.properties import ASSUMED_DENSITY, properties_of_integrals
from massprops.mass.symmetric import described, sentences, undecided
from massprops.run.job import Job
from massprops.run.placement_scenes import turned_over
from massprops.sfm.verified_matches import NO_FILM, Film, VerifiedMatches, said_against
from massprops.surface.length import model_length
from massprops.views import Views

READS = ("capture", "sfm", "shape", "silhouettes", "join", "surface", "scale")
OPTIONS = ("density", "seed")


def run(job: Job) -> dict[str, Any]:
    """Writes `massprops.json` and `mesh.npz` (vertices in metres or model units, faces, observed)."""
    surface = json.loads((job.work("surface") / "surface.json").read_text())
    scale = json.loads((job.work("scale") / "scale.json").read_text())
    with np.load(job.work("surface") / "surface.npz", allow_pickle=False) as z:
        vertices, faces, observed = z["vertices"], z["faces"], z["observed"]
        rows, lengths, outer = z["replicate_integrals"], z["replicate_length"], z["outer_integrals"]

    length = model_length(vertices, faces, observed.astype(bool))[0]
    metric = scale["metres_per_unit"] is not None and scale["source"] != "none"
    factor = float(scale["unit_per_sfm"]) * (float(scale["metres_per_unit"]) if metric else 1.0)
    warnings = list(surface["warnings"])
    if not metric:
        warnings.append(
            "no length given: one unit is the object's greatest length, and only k1, k2 and the axes are meaningful "
            "(for metres give --scale, --distance or --marker)"
        )

    final = vertices * factor
    density, assumed = job.options.density, job.options.density is None
    properties = properties_of_integrals(mesh_integrals(final, faces), ASSUMED_DENSITY if density is None else density)
    rng = np.random.default_rng([job.seed, 5])
    by_greatest_length = scale["source"] in OWN_LENGTH
    draws = scaled_replicates(
        rows, lengths, length, factor, float(scale["relative_sigma"] or 0.0), by_greatest_length, rng
    )
    if not metric:
        scale = {**scale, "source": "none", "metres_per_unit": None}
    bounds = intervals(draws, properties, scale_integrals(outer, factor))
    shape = json.loads((job.work("shape") / "shape.json").read_text())
    join = json.loads((job.work("join") / "join.json").read_text())
    open_readings = readings_of(shape, factor, moved=len(join["joined"]) > 1)
    low, high = bounds["volume"]
    half_width = 0.5 * (high - low) / properties.volume
    trust = confidence(_evidence(job, surface, shape, half_width, float(valid_bodies(draws).mean()), open_readings))
    symmetric = described(surface["symmetric"], properties, factor)
    unplaced = undecided(symmetric, bounds)
    for i, line in enumerate(sentences(symmetric, properties, len(surface["silhouette_overlap_by_image"]))):
        trust = lowered(trust, line) if i in unplaced else {**trust, "because": [*trust["because"], line]}
    partial = surface["partial"]
    if partial is None and trust["level"] == "low":
        partial = f"low confidence: {trust['because'][0]}"
    result = document(properties, bounds, scale, _described(surface, final[faces]), warnings, density_assumed=assumed)
    result["confidence"] = trust
    if symmetric:
        result["symmetric"] = symmetric
    if open_readings:
        result["readings"] = open_readings
    (job.out / "massprops.json").write_text(json.dumps(result, indent=1))
    np.savez(job.out / "mesh.npz", vertices=final, faces=faces, observed=observed)
    return {
        "volume": properties.volume,
        "k1": properties.k1,
        "k2": properties.k2,
        "confidence": trust["level"],
        "partial": partial,
    }


def _shares(surface: dict[str, Any]) -> tuple[float, float, float]:
    """Shares of the surface that were measured, inferred and filled."""
    measured, inferred = float(surface["observed_fraction"]), float(surface["inferred_fraction"])
    return measured, inferred, max(0.0, 1.0 - measured - inferred)


def _described(surface: dict[str, Any], corners: np.ndarray) -> dict[str, Any]:
    """`surface` of `massprops.json`; corners (f, 3, 3) of the triangles in final units."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    measured, inferred, filled = _shares(surface)
    return {
        "watertight": bool(surface["watertight"]),
        "area": float(0.5 * np.linalg.norm(cross, axis=1).sum()),
        "observed_fraction": measured,
        "measured_fraction": measured,
        "inferred_fraction": inferred,
        "filled_fraction": filled,
    }


def _evidence(
    job: Job,
    surface: dict[str, Any],
    shape: dict[str, Any],
    half_width: float,
    valid: float,
    readings: list[dict[str, Any]],
) -> Evidence:
    """What the confidence is judged by; half_width: of the volume's interval, valid: share of possible replicates."""
    sfm, join, silhouettes = (
        json.loads((job.work(k) / f"{k}.json").read_text()) for k in ("sfm", "join", "silhouettes")
    )
    contradicted, contradicting = _contradicted(job, shape, _film(job, shape))
    _, inferred, filled = _shares(surface)
    shutter = sfm.get("shutter") or {}
    return Evidence(
        SurfaceEvidence(
            half_width,
            filled,
            inferred,
            valid,
            overlap=float(surface["silhouette_overlap"]),
            outside=float(surface["outside_share"]),
            holes=int(surface["holes"]),
            holes_share=float(surface["holes_possible"]),
            opened=int(surface["holes_opened"]),
            opened_share=float(surface["holes_opened_share"]),
        ),
        ImageEvidence(
            given=int(sfm["given"]),
            used=sum(p["images"] for p in join["joined"]),
            cut=len(silhouettes["cut_off"]),
            scenes=tuple(m["images"] for m in sfm["models"]),
            misfit=sum(p["images"] for p in join["unjoined"] if not p["fits"]),
            contradicted=contradicted,
            contradicting=contradicting,
            matches_required=int(sfm.get("matches_required", 0)),
            readings=tuple(f"{r['reading']} ({r['option']})" for r in readings),
            unsure=bool(sfm.get("unsure", False)),
            shutter=str(shutter["said"]) if shutter.get("doubtful") else "",
        ),
        PlacementEvidence(
            turned=turned_over(join),
            unjoined=len(join["unjoined"]),
            differing=int(surface["differing_placements"]),
            hollow_possible=float(surface["hollow_possible"]),
            hollow_likely=float(surface["hollow_likely"]),
            behind_fill=float(surface["hollow_behind_fill"]),
            hollow_elsewhere=bool(surface["hollow_elsewhere"]),
            alike=any(p.get("alike") for p in join["joined"]),
        ),
    )


def _contradicted(job: Job, shape: dict[str, Any], film: Film = NO_FILM) -> tuple[float, str]:
    """Share of the matches that contradict where images of one placement are, and two such images in words.

    An object that was turned over in a room that stayed contradicts across its placements, each of which is solved by itself.

    Args:
        film: as `massprops.sfm.verified_matches.said_against` takes it.
    """
    path = job.work("sfm") / "matches.npz"
    if not path.is_file():  # nothing contradicts the model, or it was given
        return 0.0, ""
    together = [set(p["images"]) for p in shape["placements"]]
    matches = VerifiedMatches.load(path)
    if together:
        matches = matches.of([any(images.issuperset(pair) for images in together) for pair in matches.pairs])
    folder = job.work("silhouettes") / "masks"
    names = {name for pair in matches.pairs for name in pair}
    masks = {n: read_image(folder / f"{n}.png", 0) for n in names if (folder / f"{n}.png").is_file()}
    share, worst = said_against(matches, matches.on(masks), film)
    return share, " and ".join(name.rsplit("/", 1)[-1] for name in worst or ())


def _film(job: Job, shape: dict[str, Any]) -> Film:
    """The images that a film of one placement has; none where they are photographs, or show a body before a black sky,
    of which a small turn does not tell near from far."""
    from massprops.sfm.footage import read_footage

    footage, placements = read_footage(job.work("capture")), shape["placements"]
    if not footage.moving_pictures or footage.rig or footage.background == "black" or len(placements) > 1:
        return NO_FILM
    used = set(Views.load(job.work("sfm") / "views.npz").names).intersection(*(p["images"] for p in placements))
    turning = footage.motion == "tumbling" and footage.background == "still"
    return Film(tuple(f.name for f in footage.frames if f.name in used), turning)


def readings_of(shape: dict[str, Any], factor: float, moved: bool = False) -> list[dict[str, Any]]:
    """`readings` of `massprops.json`: what the object may be, its extent in final units, and how to ask for it.

    Args:
        shape: `shape.json`; of several placements, the first in which two readings fit speaks.
        factor: final units per unit of the reconstruction.
        moved: what was used was turned over as a whole, and fits itself.
    """
    for placement in shape["placements"]:
        readings = placement.get("readings")
        if readings and not (moved and readings[0]["one_if_moved"]):
            return [
                {
                    "reading": r["reading"],
                    "used": r["used"],
                    "extent": [factor * v for v in r["extent"]],
                    "option": r["option"],
                }
                for r in readings
            ]
    return []
