"""What can be wrong with footage, one thing at a time."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Poor:
    """How a body is filmed; the defaults are good footage.

    Attributes:
        frames: how many; 0 leaves it to the footage.
        size: width and height [px].
        crf: of H.264.
        noise: the sensor's, over that in full light.
        open_deg: turn of the body while the shutter is open [deg].
        rows_deg: turn of the body from the first row's exposure to the last one's [deg].
        dark: every other so many frames are in the Earth's shadow; 0 for none.
        farther: distance in the last frame over that in the first.
        sky: stars and the Earth's limb behind the body. The Earth's own light does not fall on it.
    """

    frames: int = 0
    size: tuple[int, int] = (720, 540)
    crf: int = 17
    noise: float = 1.0
    open_deg: float = 0.05
    rows_deg: float = 0.0
    dark: int = 0
    farther: float = 1.0
    sky: bool = False


POOR = {
    "": Poor(),
    "few": Poor(frames=16),
    "small": Poor(size=(320, 240)),
    "compressed": Poor(crf=34),
    "noisy": Poor(noise=6.0),
    "blurred": Poor(open_deg=2.0),
    "eclipse": Poor(dark=11),
    "rolling": Poor(rows_deg=3.0),
    "receding": Poor(farther=3.0),
    "sky": Poor(sky=True),
}
"""16 images; 320 x 240; heavy H.264; night's noise; 2 degrees of turn an exposure; no Sun in half of the frames; rows
read one after the other; a distance that grows threefold; stars and limb."""
