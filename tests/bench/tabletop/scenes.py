"""The 24 table-top scenes: which object, how it is filmed, and in which room. All else is drawn from `SEED`.

Scenes with an even number are for development. **Scenes with an odd number are held out**: nobody looks at their
pictures or runs the tool on them until the end. Objects of the two halves differ; where a kind of our own objects
stands in both, its shape is drawn anew.

Once the held-out scenes have been looked at, `NAME-2`, `NAME-3` and so on are the same kinds of scenes drawn anew: another
room, camera, path and pose, and another shape of our own objects.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

SEED = 20261122
"""Of every draw: scene number k uses the generator (SEED, k)."""

UPRIGHT = (0.0, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """One scene to render.

    Attributes:
        number: place in `SCENES`.
        name: of its folder.
        item: a folder of the scanned objects, or a kind of `objects.KINDS`.
        images: `video` (hand-held), `photos` (with EXIF), `turntable` (video, the camera and the room stand still).
        turned: the object is turned over half-way, the room stays (photographs only).
        moved: a hand turns the object on the table after every few photographs, and the camera stays on one side of it.
        again: the object is turned on the table half-way, the same side up, and photographed all round once more.
        arc: the photographs are taken from one half of the room.
        flash: the camera's own lamp lights the object, and little else does.
        macro: the lens is wide open, so that what lies before or behind the object's middle is out of focus.
        table: a kind of `rooms.TABLES`.
        cluttered: other things lie about.
        stand: the object stands on a block.
        up: direction in the object's axes that shall point up, or None: the likeliest resting pose.
        finish: `textured`, `plain` or `glossy` of our own objects; scanned ones keep their colours and may be
            `glossy`.
        count: images.
        draw: 1 as in `SCENES`, more of a scene drawn anew.
    """

    number: int
    name: str
    item: str
    images: str
    turned: bool = False
    moved: bool = False
    again: bool = False
    arc: bool = False
    flash: bool = False
    macro: bool = False
    table: str = "plain"
    cluttered: bool = False
    stand: bool = False
    up: tuple[float, float, float] | None = None
    finish: str = "textured"
    count: int = 40
    draw: int = 1

    @property
    def held_out(self) -> bool:
        """Not looked at until the end."""
        return self.number % 2 == 1

    def generator(self) -> np.random.Generator:
        """The scene's own random numbers."""
        return np.random.default_rng([SEED, self.number] if self.draw == 1 else [SEED, self.number, self.draw])


WORDS = ("turned", "moved", "again", "arc", "flash", "macro", "cluttered", "stand")
"""Fields of a scene that its line in the table names where they hold."""


def _scene(number: int, item: str, images: str, table: str, words: str = "", up: tuple | None = None) -> Scene:
    """`words`: any of turned, moved, again, arc, flash, macro, few, cluttered, stand, plain, glossy."""
    said = set(words.split())
    half = "held" if number % 2 else "dev"
    finish = next((f for f in ("plain", "glossy") if f in said), "textured")
    return Scene(
        number=number,
        name=f"{number:02d}_{half}_{item.split('_', 1)[-1] if item[0].isdigit() else item}",
        item=item,
        images=images,
        table=table,
        up=up,
        finish=finish,
        count=56 if "turned" in said else 30 if "moved" in said else 12 if "few" in said else 40,
        **{word: word in said for word in WORDS},
    )


SCENES = (
    _scene(0, "004_sugar_box", "video", "plain", "", UPRIGHT),
    _scene(1, "021_bleach_cleanser", "video", "wood", "cluttered", UPRIGHT),
    _scene(2, "figure", "video", "wood", "cluttered", UPRIGHT),
    _scene(3, "shoe", "photos", "tiles", "cluttered", UPRIGHT),
    _scene(4, "rock", "photos", "cloth", "turned"),
    _scene(5, "043_phillips_screwdriver", "photos", "wood", "turned"),
    _scene(6, "061_foam_brick", "turntable", "plain", "cluttered"),
    _scene(7, "012_strawberry", "photos", "tiles", "stand"),
    _scene(8, "shoe", "photos", "newspaper", "", UPRIGHT),
    _scene(9, "part", "photos", "newspaper", "turned cluttered"),
    _scene(10, "part", "photos", "wood", "turned glossy"),
    _scene(11, "019_pitcher_base", "video", "cloth", "", UPRIGHT),
    _scene(12, "029_plate", "video", "wood", "cluttered glossy", UPRIGHT),
    _scene(13, "chair", "video", "tiles", "", UPRIGHT),
    _scene(14, "011_banana", "photos", "tiles", "turned"),
    _scene(15, "073-g_lego_duplo", "photos", "plain", "turned cluttered"),
    _scene(16, "chair", "photos", "cloth", "cluttered", UPRIGHT),
    _scene(17, "figure", "turntable", "wood", "glossy", UPRIGHT),
    _scene(18, "038_padlock", "photos", "newspaper", "stand"),
    _scene(19, "rock", "photos", "cloth", "turned cluttered plain"),
    _scene(20, "065-a_cups", "photos", "wood", "turned"),
    _scene(21, "figure", "video", "cloth", "stand plain", UPRIGHT),
    _scene(22, "010_potted_meat_can", "turntable", "tiles", "glossy", UPRIGHT),
    _scene(23, "037_scissors", "photos", "newspaper", "cluttered"),
)
"""Half of them hold scanned objects, eight are turned over: four on each side."""


FURTHER = (
    _scene(24, "010_potted_meat_can", "photos", "wood", "moved cluttered", UPRIGHT),
    _scene(25, "021_bleach_cleanser", "photos", "tiles", "moved cluttered", UPRIGHT),
    _scene(26, "shoe", "photos", "wood", "again", UPRIGHT),
    _scene(27, "043_phillips_screwdriver", "photos", "cloth", "again"),
    _scene(28, "figure", "photos", "wood", "flash", UPRIGHT),
    _scene(29, "part", "photos", "tiles", "again"),
    _scene(30, "010_potted_meat_can", "photos", "newspaper", "macro", UPRIGHT),
    _scene(31, "figure", "photos", "cloth", "again", UPRIGHT),
    _scene(32, "021_bleach_cleanser", "photos", "wood", "few", UPRIGHT),
    _scene(33, "021_bleach_cleanser", "photos", "wood", "again", UPRIGHT),
    _scene(34, "shoe", "photos", "tiles", "arc", UPRIGHT),
)
"""Further scenes, not among the 24: objects that a hand turns before a camera that stays on one side, or between two rounds, and other
ways in which people take photographs."""


def by_name(name: str) -> Scene:
    """The scene of that name, drawn anew where `-2` or more follows it.

    Raises:
        KeyError: there is none.
    """
    first, _, draw = name.partition("-")
    known = {s.name: s for s in (*SCENES, *FURTHER)}
    if name in known:
        return known[name]
    if not (draw.isdecimal() and int(draw) > 1):
        raise KeyError(name)
    return replace(known[first], name=name, draw=int(draw))


def render_order() -> tuple[Scene, ...]:
    """Development and held-out scenes by turns, so that both halves grow alike."""
    return SCENES
