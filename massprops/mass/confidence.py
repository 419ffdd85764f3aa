"""How far a result can be trusted, in one word and plain reasons.

The word follows the interval of the volume first: it is what the method itself says it does not know. What the interval
cannot know of (images that show something else, a side filled in without evidence) lowers it further.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

from massprops.core.text import counted

OPEN = 1.0
"""Half width of the volume's interval, over the volume, above which the images leave it open."""
WIDE, TOO_WIDE = 0.05, 0.20
"""Half width of the 90 % interval of the volume, relative, above which confidence is medium and low: what a table-top
model should reach, and what an estimate by eye and ruler does."""
FILLED, MOSTLY_FILLED = 0.2, 0.6
"""Share of the surface neither measured nor closed at a support, above which confidence is medium and low."""
HOLES, MANY_HOLES = 0.02, 0.10
"""Share of the volume that dark places may take as holes, above which confidence is medium and low. Of a machined part that was seen from above
only (Blender) they may take .17, and its holes are a fifth of it: its volume lay outside its interval."""
LOST, MOSTLY_LOST = 0.1, 0.5
"""Share of the images that could not be used, likewise."""
AGREES, DIFFERS = 0.95, 0.88
"""Intersection over union of the mesh's silhouettes and the images' own, median over the images, below which confidence
is medium and low. Bodies near the truth had 0.96 and more, a glossy plate with a hole torn into it 0.63."""
CONTRADICTED, MOSTLY_CONTRADICTED = 0.05, 0.10
"""Share of the matches, in pairs of images of one placement, that contradict where the model has these images, likewise. None
of a rough head, of a stamp and of a painted figure; 0.10 and 0.23 in two reconstructions of a parcel that was turned between
photographs while the room stayed."""
OUTSIDE, MOSTLY_OUTSIDE = 0.18, 0.22
"""Share of the images that show sky where stereo measured a point, of all points but the worst hundredth, above which
confidence is medium and low. In nine sound runs it was 0 to 0.16 (tumbling bodies, real and rendered objects on tables); in
four that were wrong 0.23 and 0.26 (heavily compressed video, cameras up to 11 degrees off), 0.44 (an object that had been
moved between the photographs) and 0.54 (stars and clouds taken for the object). From the first on sky counts only where a body would
be lit (`massprops.surface.lit_sky`)."""
CUT, MOSTLY_CUT = 0.1, 0.5
"""Share of the images in which the object goes on beyond the frame, likewise."""
OTHER_SCENE, MOSTLY_OTHER = 0.1, 0.3
"""Share of all images that make up a second scene, or show another object, likewise: a few images that hang together by
themselves are usual in hand-held sets (5 of 32 of a skull), a third of them is another subject."""
DULL = (
    ": mirrors, glass and plain or glossy sides show no points; dull them with powder, mark them, or light them softly"
)
LEVELS = ("high", "medium", "low")


@dataclass(frozen=True)
class SurfaceEvidence:
    """What the surface says of itself.

    Attributes:
        half_width: of the volume's 90 % interval, over the volume.
        filled: share of the area that was filled in.
        inferred: share of the area that was closed at the plane of support.
        valid: share of the replicates that enclose a volume at all.
        overlap: intersection over union of the mesh's silhouettes and the images' own, median over the images.
        outside: share of the images that show sky where a measured point is, of all points but the worst hundredth.
        holes: dark places that may be the mouths of holes; holes_share: what they may take of the volume.
        opened: holes that were opened; opened_share: what they took, over the volume.
    """

    half_width: float
    filled: float
    inferred: float
    valid: float = 1.0
    overlap: float = 1.0
    outside: float = 0.0
    holes: int = 0
    holes_share: float = 0.0
    opened: int = 0
    opened_share: float = 0.0


@dataclass(frozen=True)
class ImageEvidence:
    """What the images say.

    Attributes:
        given: how many were given to structure from motion.
        used: how many show the object where the model has it.
        cut: in how many the object goes on beyond the frame.
        scenes: images of each set that hangs together, the one that was used first.
        misfit: images of placements that do not fit the one used, however they are turned: perhaps another object.
        contradicted: share of the matches that contradict where the model has images of one placement.
        contradicting: two such images, in words.
        matches_required: where sides look alike and pairs of images with few matches were given up, the matches that were asked for; else 0.
        readings: what else the object may be, in words, where nothing decides; the one that is used first.
        unsure: a film was mapped several times, no two results agree, and none convinces.
        shutter: what is said of a rolling shutter that may have done harm.
    """

    given: int
    used: int
    cut: int = 0
    scenes: tuple[int, ...] = ()
    misfit: int = 0
    contradicted: float = 0.0
    contradicting: str = ""
    matches_required: int = 0
    readings: tuple[str, ...] = ()
    unsure: bool = False
    shutter: str = ""


@dataclass(frozen=True)
class PlacementEvidence:
    """What the ways say in which the object lay, and what no image shows of it.

    Attributes:
        turned: the mesh is made of placements on different sides.
        unjoined: placements that could not be joined to the one used.
        differing: those of them that have another volume or other moments, measured by themselves.
        hollow_possible: share of the volume that an underside nobody saw may hide as empty.
        hollow_likely: the part of it that the interval allows for, since the upper side is hollow too.
        behind_fill: the part of the volume behind filled-in sides that the interval allows to be empty.
        hollow_elsewhere: a placement that could not be joined shows a hollow upper side, or was not measured.
        alike: two sides look alike, and placements were joined as of an object that was turned over, not moved.
    """

    turned: bool = False
    unjoined: int = 0
    differing: int = 0
    hollow_possible: float = 0.0
    hollow_likely: float = 0.0
    behind_fill: float = 0.0
    hollow_elsewhere: bool = False
    alike: bool = False


@dataclass(frozen=True)
class Evidence:
    """What confidence rests on."""

    surface: SurfaceEvidence
    images: ImageEvidence
    placements: PlacementEvidence = PlacementEvidence()


Finding = tuple[int, str]
"""Index in `LEVELS` that a finding allows at best, and its words."""


def confidence(evidence: Evidence) -> dict[str, Any]:
    """`confidence` of `massprops.json`: {"level": "high" | "medium" | "low", "because": [text]}."""
    surface, images = evidence.surface, evidence.images
    known = _known(surface.half_width)
    findings = [
        _contradiction(images),
        _finding(surface.half_width, WIDE, TOO_WIDE, known),
        *_of_surface(surface),
        *_of_images(images),
        *_of_placements(evidence.placements, surface.filled),
    ]
    level = max(rank for rank, _ in findings)
    because = [text for rank, text in sorted(findings, key=lambda s: -s[0]) if rank > 0]
    if len(images.readings) > 1:
        level = 2
        other = " or ".join(images.readings[1:])
        because.insert(0, f"it is not clear which object is meant: {images.readings[0]} (measured here), or {other}")
    if not because:
        because = [known]
    return {"level": LEVELS[level], "because": because + _unseen(evidence.placements, surface.inferred)}


def _contradiction(images: ImageEvidence) -> Finding:
    return _finding(
        images.contradicted,
        CONTRADICTED,
        MOSTLY_CONTRADICTED,
        f"{100 * images.contradicted:.0f} % of the matches between images contradict the rest, such as those between "
        f"{images.contradicting}: either the object was moved while its surroundings stayed, or two of its sides look alike",
    )


def _of_surface(surface: SurfaceEvidence) -> list[Finding]:
    return [
        _finding(
            surface.filled,
            FILLED,
            MOSTLY_FILLED,
            f"{100 * surface.filled:.0f} % of the surface was filled in, not measured"
            + (DULL if surface.filled > MOSTLY_FILLED else ""),
        ),
        _finding(
            1.0 - surface.overlap,
            1.0 - AGREES,
            1.0 - DIFFERS,
            f"the mesh and the object's silhouettes in the images overlap by only {100 * surface.overlap:.0f} %",
        ),
        _finding(
            surface.outside,
            OUTSIDE,
            MOSTLY_OUTSIDE,
            f"measured points lie outside the silhouettes of up to {100 * surface.outside:.0f} % of the images: the cameras "
            "or the silhouettes are wrong; look at them with 'massprops masks', and film with less compression and blur",
        ),
        _finding(
            surface.holes_share,
            HOLES,
            MANY_HOLES,
            counted(surface.holes, "dark place of the surface, in which", "dark places of the surface, in which")
            + f" nothing was measured, may be {'a hole' if surface.holes == 1 else 'holes'}: the interval reaches down to a "
            f"body with {100 * surface.holes_share:.0f} % less volume; light them from the camera and take images that look in",
        ),
        _finding(
            surface.opened_share,
            HOLES,
            inf,
            counted(surface.opened, "hole was", "holes were")
            + f" opened through the object ({100 * surface.opened_share:.0f} % of the volume), from two mouths that face each "
            "other: between them nothing was measured; look through, as a wall in between would not be noticed",
        ),
        _finding(
            1.0 - surface.valid,
            0.05,
            0.5,
            "the surface is so uncertain that some shapes within its uncertainty enclose no volume: take more images, from "
            "more sides",
        ),
    ]


def _of_images(images: ImageEvidence) -> list[Finding]:
    findings = [(1, images.shutter)] if images.shutter else []
    if images.matches_required:
        line = (
            f"sides of the object look alike: only pairs of images with at least {images.matches_required} matches were used; if some "
            "of these join different sides, the shape is wrong"
        )
        findings.append((1, line))
    if images.unsure:
        line = "the film was mapped several times, and no two results agree: its images may be placed wrongly"
        findings.append((2, line))
    lost = 1.0 - images.used / images.given if images.given else 0.0
    return [
        *findings,
        _finding(lost, LOST, MOSTLY_LOST, f"{images.given - images.used} of {images.given} images could not be used"),
        _finding(
            images.cut / max(images.used, 1),
            CUT,
            MOSTLY_CUT,
            f"the object reaches the edge of the frame in {images.cut} of {images.used} images: step back, keep hands and "
            "arms out",
        ),
        _finding(
            max(images.scenes[1:], default=0) / max(images.given, 1),
            OTHER_SCENE,
            MOSTLY_OTHER,
            f"the images fall into scenes that do not connect ({', '.join(map(str, images.scenes))} images); the largest was "
            "used: give one object in one place, or each placement as a separate INPUT",
        ),
        _finding(
            images.misfit / max(images.given, 1),
            0.0,
            MOSTLY_OTHER,
            counted(images.misfit, "image shows", "images show")
            + " what may be another object: it does not fit the one measured, however it is turned",
        ),
    ]


def _of_placements(placements: PlacementEvidence, filled: float) -> list[Finding]:
    """Findings of a turned object; filled: share of the surface."""
    findings = []
    if placements.turned and filled > FILLED:
        findings.append((2, _open_though_turned(filled)))
    if placements.alike:
        findings.append(
            (1, "two sides of the object look alike: if it was only moved, and not turned over, its shape is wrong")
        )
    if placements.unjoined:
        other = counted(placements.unjoined, "other placement", "other placements")
        shown = "what it shows" if placements.unjoined == 1 else "what they show"
        findings.append((1, f"{other} of the object could not be joined to the one used: {shown} is missing"))
    if placements.differing:
        findings.append(
            (
                2,
                "measured in another placement alone, the object has another volume or other moments: one of the two is wrong",
            )
        )
    return findings


def _known(half_width: float) -> str:
    if half_width > OPEN:
        return "the images leave open how large the volume is: its interval is wider than twice the volume itself"
    return f"the volume is known to ±{100 * half_width:.0f} %"


def _open_though_turned(filled: float) -> str:
    """What is filled in although the object was seen from several sides: it may be open there.

    A flower pot that was turned over and joined rightly was filled to its rim, as nothing was measured in its dark inside.
    """
    return (
        f"the object was turned over, and {100 * filled:.0f} % of the surface was filled in all the same: it may be hollow "
        "there; light its inside and photograph it from above"
    )


def _unseen(placements: PlacementEvidence, inferred: float) -> list[str]:
    """What remains unknown when the underside was not seen; inferred: share of the surface closed at its support."""
    if placements.behind_fill > max(0.02, placements.hollow_likely):
        return [
            "behind the filled-in sides it may be empty: the interval reaches down to a body with "
            f"{100 * placements.behind_fill:.0f} % less volume"
        ]
    less = f"{100 * placements.hollow_likely:.0f} % less volume"
    if placements.hollow_likely > 0.02 and placements.hollow_elsewhere:
        return [
            "another placement, which could not be joined, shows a side that was not seen here. That side is hollow or was "
            f"not measured: the interval reaches down to a thin shell, with {less}"
        ]
    if placements.hollow_likely > 0.02:
        return [
            f"it is hollow above, and its underside was not seen: the interval reaches down to a thin shell, with {less}; "
            "turn it over and photograph it again"
        ]
    if inferred <= 0.02:
        return []
    sentence = f"{100 * inferred:.0f} % of the surface stood on its support and was closed there"
    if placements.hollow_possible <= 0.02:
        return [f"{sentence}: a hollow underneath would not be seen"]
    return [
        f"{sentence}, as if solid: a hollow underneath would not be seen, and a thin shell would have "
        f"{100 * placements.hollow_possible:.0f} % less volume"
    ]


def lowered(trust: dict[str, Any], text: str) -> dict[str, Any]:
    """The confidence one level lower, for a reason of its own."""
    level = LEVELS[min(LEVELS.index(trust["level"]) + 1, len(LEVELS) - 1)]
    kept = trust["because"] if trust["level"] != LEVELS[0] else trust["because"][1:]
    return {"level": level, "because": [text, *kept]}


def _finding(value: float, medium: float, low: float, text: str) -> Finding:
    return (2 if value > low else 1 if value > medium else 0), text
