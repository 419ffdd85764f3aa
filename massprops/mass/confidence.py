"""How far a result can be trusted, in one word and plain reasons.

The word follows the interval of the volume first: it is what the method itself says it does not know. What the interval
cannot know of (images that show something else, a side filled in without evidence) lowers it further.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from massprops.core.text import counted

WIDE, TOO_WIDE = 0.05, 0.20
"""Half width of the 90 % interval of the volume, relative, above which confidence is medium and low: what a table-top
model should reach, and what an estimate by eye and ruler does."""
FILLED, MOSTLY_FILLED = 0.2, 0.6
"""Share of the surface neither measured nor closed at a support, above which confidence is medium and low."""
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
moved between the photographs) and 0.54 (stars and clouds taken for the object)."""
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
class Evidence:
    """What confidence rests on.

    Attributes:
        half_width: of the volume's 90 % interval, over the volume.
        filled: share of the surface that was filled in.
        inferred: share that was closed at the plane of support.
        images: how many were given to structure from motion.
        used: how many show the object where the model has it.
        unjoined: placements of the object that could not be joined to the one used.
        joined: placements that the mesh is made of.
        valid: share of the replicates that are bodies at all.
        overlap: intersection over union of the mesh's silhouettes and the images' own, median over the images.
        outside: share of the images in which a measured point may lie outside the silhouette, so that it is kept.
        contradicted: share of the matches that contradict where the model has images of one placement.
        contradicting: two such images, in words.
        cut: images in which the object goes on beyond the frame.
        scenes: images of each set that hangs together, the one that was used first.
        misfit: images of placements that do not fit the one used, however they are turned: perhaps another object.
        readings: what else the object may be, in words, where nothing decides; the one that is used first.
        hollow_possible: share of the volume that an underside nobody saw may hide as empty, or filled-in sides of what was
            turned over.
        hollow_likely: the part of it that the interval allows for, since the upper side is hollow too, or much filled in.
        hollow_elsewhere: a placement that could not be joined shows a hollow upper side, or was not measured.
        unlike: placements that could not be joined and have another volume or other moments.
        shutter: what is said of a rolling shutter that may have done harm.
    """

    half_width: float
    filled: float
    inferred: float
    images: int
    used: int
    unjoined: int = 0
    joined: int = 1
    valid: float = 1.0
    overlap: float = 1.0
    readings: tuple[str, ...] = ()
    cut: int = 0
    scenes: tuple[int, ...] = ()
    misfit: int = 0
    hollow_possible: float = 0.0
    hollow_likely: float = 0.0
    hollow_elsewhere: bool = False
    outside: float = 0.0
    contradicted: float = 0.0
    contradicting: str = ""
    unlike: int = 0
    shutter: str = ""


def confidence(evidence: Evidence) -> dict[str, Any]:
    """`confidence` of `massprops.json`: {"level": "high" | "medium" | "low", "because": [text]}."""
    e = evidence
    known = _known(e.half_width)
    findings = [_contradiction(e), _finding(e.half_width, WIDE, TOO_WIDE, known), *_of_surface(e), *_of_images(e)]
    if e.joined > 1 and e.filled > FILLED:
        findings.append((2, _open_though_turned(e)))
    if e.unjoined:
        other = counted(e.unjoined, "other placement", "other placements")
        findings.append((1, f"{other} of the object could not be joined to the one used: what they show is missing"))
    if e.unlike:
        findings.append((2, "another placement of the object, measured by itself, has another volume or other moments"))
    if e.shutter:
        findings.append((1, e.shutter))
    level = max(rank for rank, _ in findings)
    because = [text for rank, text in sorted(findings, key=lambda s: -s[0]) if rank > 0]
    if len(e.readings) > 1:
        level = 2
        other = " or ".join(e.readings[1:])
        because.insert(0, f"it is not clear which object is meant: {e.readings[0]} (measured here), or {other}")
    if not because:
        because = [known]
    return {"level": LEVELS[level], "because": because + _unseen(e)}


def _contradiction(e: Evidence) -> tuple[int, str]:
    return _finding(
        e.contradicted,
        CONTRADICTED,
        MOSTLY_CONTRADICTED,
        f"{100 * e.contradicted:.0f} % of what matches between images contradicts the rest, such as between "
        f"{e.contradicting}: the object was moved between photographs and its surroundings were not, or two of its sides "
        "look alike",
    )


def _of_surface(e: Evidence) -> list[tuple[int, str]]:
    """Rank and words of what the surface itself says."""
    return [
        _finding(
            e.filled,
            FILLED,
            MOSTLY_FILLED,
            f"{100 * e.filled:.0f} % of the surface was filled in, not measured"
            + (DULL if e.filled > MOSTLY_FILLED else ""),
        ),
        _finding(
            1.0 - e.overlap,
            1.0 - AGREES,
            1.0 - DIFFERS,
            f"the mesh and the object's silhouettes in the images overlap by only {100 * e.overlap:.0f} %",
        ),
        _finding(
            e.outside,
            OUTSIDE,
            MOSTLY_OUTSIDE,
            f"measured points lie outside the silhouettes of up to {100 * e.outside:.0f} % of the images: the cameras "
            "or the silhouettes are wrong; film with less compression and blur, or check the silhouettes",
        ),
        _finding(
            1.0 - e.valid,
            0.05,
            0.5,
            "the surface is so uncertain that some of its variants are not closed bodies: take more images, from more sides",
        ),
    ]


def _of_images(e: Evidence) -> list[tuple[int, str]]:
    """Rank and words of what the images say."""
    lost = 1.0 - e.used / e.images if e.images else 0.0
    return [
        _finding(lost, LOST, MOSTLY_LOST, f"{e.images - e.used} of {e.images} images could not be used"),
        _finding(
            e.cut / max(e.used, 1),
            CUT,
            MOSTLY_CUT,
            f"the object reaches the edge of the frame in {e.cut} of {e.used} images: step back, keep hands and arms out",
        ),
        _finding(
            max(e.scenes[1:], default=0) / max(e.images, 1),
            OTHER_SCENE,
            MOSTLY_OTHER,
            f"the images fall into scenes that do not connect ({', '.join(map(str, e.scenes))} images); the largest was used: "
            "give one object in one place, or each placement as a separate INPUT",
        ),
        _finding(
            e.misfit / max(e.images, 1),
            0.0,
            MOSTLY_OTHER,
            counted(e.misfit, "image shows", "images show")
            + " what may be another object: it does not fit the one measured, however it is turned",
        ),
    ]


def _known(half_width: float) -> str:
    if half_width > 1.0:
        return "the images leave open how large the volume is: its interval is wider than twice the volume itself"
    return f"the volume is known to ±{100 * half_width:.0f} %"


def _open_though_turned(e: Evidence) -> str:
    """What is filled in although the object was seen from several sides: it may be open there.

    A flower pot that was turned over and joined rightly was filled to its rim, as nothing was measured in its dark inside.
    """
    return (
        f"the object was turned over, and {100 * e.filled:.0f} % of the surface was filled in all the same: it may be hollow "
        "there; light its inside and photograph it from above"
    )


def _unseen(e: Evidence) -> list[str]:
    """What remains unknown when the underside was not seen."""
    if e.hollow_likely > 0.02 and e.hollow_elsewhere:
        return [
            "a side that was not seen here is shown by another placement, which could not be joined, and is hollow there or "
            f"was not measured: the interval reaches down to a thin shell, with {100 * e.hollow_likely:.0f} % less volume"
        ]
    if e.hollow_likely > 0.02 and e.joined > 1:
        return [
            "what lies behind the filled-in sides may be empty: the interval reaches down to a body with "
            f"{100 * e.hollow_likely:.0f} % less volume"
        ]
    if e.hollow_likely > 0.02:
        return [
            "it is hollow above, and its underside was not seen: the interval reaches down to a thin shell, with "
            f"{100 * e.hollow_likely:.0f} % less volume; turn it over and photograph it again"
        ]
    if e.inferred <= 0.02:
        return []
    sentence = f"{100 * e.inferred:.0f} % of the surface stood on its support and was closed there: "
    if e.hollow_possible <= 0.02:
        return [sentence + "a hollow underneath would not be seen"]
    return [
        sentence
        + "it is taken to be solid; a hollow underneath would not be seen, and of a thin shell the volume would be "
        f"{100 * e.hollow_possible:.0f} % less"
    ]


def lowered(trust: dict[str, Any], text: str) -> dict[str, Any]:
    """The confidence one level lower, for a reason of its own."""
    level = LEVELS[min(LEVELS.index(trust["level"]) + 1, len(LEVELS) - 1)]
    kept = trust["because"] if trust["level"] != LEVELS[0] else trust["because"][1:]
    return {"level": level, "because": [text, *kept]}


def _finding(value: float, medium: float, low: float, text: str) -> tuple[int, str]:
    return (2 if value > low else 1 if value > medium else 0), text
