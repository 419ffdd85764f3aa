"""Pictures for surfaces, drawn from a seed: (n, n, 3) uint8 RGB that repeat without a seam where they are noise."""

from __future__ import annotations

import cv2
import numpy as np

SIDE = 1024


def noise(rng: np.random.Generator, steepness: float, side: int = SIDE) -> np.ndarray:
    """(side, side) random field of mean 0 and deviation 1, amplitude falling as frequency^-steepness; periodic."""
    f = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side)[None])
    f[0, 0] = np.inf
    white = np.fft.rfft2(rng.standard_normal((side, side)))
    field = np.fft.irfft2(white * f**-steepness, s=(side, side))
    return (field - field.mean()) / field.std()


def colour(rng: np.random.Generator, saturation: float = 0.6) -> np.ndarray:
    """(3,) a colour in 0..1."""
    hsv = np.array([[[rng.uniform(0, 360), saturation * rng.uniform(0.4, 1), rng.uniform(0.35, 0.9)]]], np.float32)
    return cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[0, 0]


def _finish(image: np.ndarray) -> np.ndarray:
    return np.clip(255 * image, 0, 255).astype(np.uint8)


def plain(rng: np.random.Generator) -> np.ndarray:
    """A painted desk: hardly any detail."""
    base = rng.uniform(0.55, 0.85) + 0.05 * (colour(rng) - 0.5)
    return _finish(base * (1 + 0.006 * noise(rng, 0.4)[..., None] + 0.01 * noise(rng, 1.5)[..., None]))


def wood(rng: np.random.Generator) -> np.ndarray:
    """Boards with grain."""
    x = np.arange(SIDE)[None, :] / SIDE
    y = np.arange(SIDE)[:, None] / SIDE
    bend = cv2.resize(noise(rng, 2.0, 128).astype(np.float32), (SIDE, SIDE), interpolation=cv2.INTER_CUBIC)
    streak = cv2.blur(noise(rng, 0.5).astype(np.float32), (181, 1), borderType=cv2.BORDER_REFLECT)
    ring = np.sin(2 * np.pi * (14 * y + 0.8 * bend + 0.2 * np.sin(4 * x)))
    tone = 0.75 + 0.07 * ring + 0.10 * streak / streak.std() + 0.03 * noise(rng, 0.5)
    board = np.floor(4 * y)
    tone *= 1 + 0.12 * np.sin(37.0 * board + 2) - 0.5 * (np.abs(4 * y - np.round(4 * y)) < 0.012)
    return _finish(tone[..., None] * (np.array([0.72, 0.5, 0.32]) * rng.uniform(0.6, 1.2)))


def tiles(rng: np.random.Generator) -> np.ndarray:
    """Patterned tiles: the same drawing again and again, with slight wear."""
    size, a, b, c = SIDE // 4, colour(rng), colour(rng), colour(rng, 0.2)
    y, x = np.mgrid[0:size, 0:size] / size * 2 - 1
    r, angle = np.hypot(x, y), np.arctan2(y, x)
    one = np.where((r < 0.55 + 0.25 * np.cos(4 * angle))[..., None], a, c)
    one = np.where((r < 0.3 + 0.1 * np.cos(8 * angle))[..., None], b, one)
    one = np.where((np.maximum(abs(x), abs(y)) > 0.95)[..., None], 0.35, one)
    return _finish(
        np.tile(one, (4, 4, 1)) * (1 + 0.05 * noise(rng, 1.2)[..., None] + 0.03 * noise(rng, 0.3)[..., None])
    )


def cloth(rng: np.random.Generator) -> np.ndarray:
    """A checked tablecloth with a weave."""
    y, x = np.mgrid[0:SIDE, 0:SIDE]
    a, b = colour(rng), 0.9 * np.ones(3)
    stripes = 0.5 * (((x // 64) % 2)[..., None] + ((y // 64) % 2)[..., None])
    weave = 1 + 0.06 * np.sin(x * np.pi / 2) * np.sin(y * np.pi / 2) + 0.05 * noise(rng, 0.3)
    return _finish((stripes * a + (1 - stripes) * b) * weave[..., None])


def newspaper(rng: np.random.Generator) -> np.ndarray:
    """Columns of letters with headlines and grey pictures."""
    page = np.full((SIDE, SIDE), 220, np.uint8)
    letters = list("abcdefghijklmnopqrstuvwxyz    ")
    for left in range(12, SIDE, 250):
        y = 20
        while y < SIDE - 20:
            kind = rng.random()
            if kind < 0.12 and y < SIDE - 150:
                height = int(rng.integers(70, 130))
                field = cv2.resize(noise(rng, 1.5, 64).astype(np.float32), (236, height))
                page[y : y + height, left : left + 236] = np.clip(128 + 46 * field[:, : SIDE - left], 0, 255)
                y += height + 16
                continue
            big = kind > 0.9
            text = "".join(rng.choice(letters, 12 if big else 36))
            size, step = (1.0, 34) if big else (0.33, 13)
            cv2.putText(
                page,
                text[: 12 if big else 34],
                (left, y),
                cv2.FONT_HERSHEY_SIMPLEX,
                size,
                30,
                2 if big else 1,
                cv2.LINE_AA,
            )
            y += step
    return _finish(page[..., None] / 255 * (1 + 0.02 * noise(rng, 1.0)[..., None]))


def painted(rng: np.random.Generator) -> np.ndarray:
    """Patches of paint with brush marks and specks: a textured object."""
    fields = np.stack([noise(rng, 1.8) for _ in range(4)])
    palette = np.stack([colour(rng, 0.8) for _ in range(4)])
    image = palette[fields.argmax(0)]
    brush = cv2.blur(noise(rng, 0.3).astype(np.float32), (3, 25), borderType=cv2.BORDER_REFLECT)
    specks = noise(rng, 0.7) > 2.2
    return _finish(np.where(specks[..., None], 0.15, image) * (1 + 0.12 * (brush / brush.std())[..., None]))


def stone(rng: np.random.Generator) -> np.ndarray:
    """Grains and stains."""
    grey = 0.45 + 0.10 * noise(rng, 0.6) + 0.07 * noise(rng, 1.4) + 0.05 * noise(rng, 0.1)
    return _finish(grey[..., None] * (0.85 + 0.3 * colour(rng, 0.3)))


def metal(rng: np.random.Generator) -> np.ndarray:
    """Turned and scratched metal with marks."""
    brush = cv2.blur(noise(rng, 0.2).astype(np.float32), (61, 1), borderType=cv2.BORDER_REFLECT)
    grey = 0.55 + 0.05 * brush / brush.std() + 0.04 * noise(rng, 1.3)
    stained = np.where(noise(rng, 1.0) > 1.9, 0.6, 1.0)
    return _finish(np.repeat((grey * stained)[..., None], 3, 2))


def faint(rng: np.random.Generator) -> np.ndarray:
    """One colour with faint, fine unevenness: a plain object, as of unpainted plastic or plaster."""
    return _finish(
        (0.5 + 0.4 * colour(rng, 0.25)) * (1 + 0.02 * noise(rng, 0.5)[..., None] + 0.02 * noise(rng, 1.5)[..., None])
    )


def poster(rng: np.random.Generator) -> np.ndarray:
    """Shapes of many colours, for covers, cards and walls."""
    image = np.zeros((512, 512, 3), np.uint8) + _finish(colour(rng, 0.5))
    for _ in range(int(rng.integers(12, 40))):
        centre = tuple(int(v) for v in rng.integers(0, 512, 2))
        paint = tuple(float(255 * v) for v in colour(rng, 0.9))
        if rng.random() < 0.5:
            axes = tuple(int(v) for v in rng.integers(10, 90, 2))
            cv2.ellipse(image, centre, axes, float(rng.uniform(0, 180)), 0, 360, paint, -1, cv2.LINE_AA)
        else:
            corner = tuple(int(v) for v in np.array(centre) + rng.integers(10, 140, 2))
            cv2.rectangle(image, centre, corner, paint, -1 if rng.random() < 0.6 else 4)
    for _ in range(6):
        at = (int(rng.integers(0, 350)), int(rng.integers(30, 500)))
        text = "".join(rng.choice(list("ABCDEFGHKLMNRSTXZ 0123456789"), 9))
        cv2.putText(
            image, text, at, cv2.FONT_HERSHEY_DUPLEX, float(rng.uniform(0.5, 1.4)), (25, 25, 25), 2, cv2.LINE_AA
        )
    return image


def cells(rng: np.random.Generator) -> np.ndarray:
    """One solar cell with its fingers and bus bars, clipped corners and a pale frame; it repeats."""
    side = 512
    y, x = np.mgrid[0:side, 0:side] / side * 2 - 1
    silicon = np.array([0.03, 0.04, 0.12]) * (1 + 0.25 * noise(rng, 1.2, side)[..., None])
    fingers = (np.mod(np.arange(side), 16) < 1)[None, :, None] | (np.abs(np.abs(y) - 0.4) < 0.02)[..., None]
    image = np.where(fingers, 0.35, silicon)
    outside = (np.maximum(abs(x), abs(y)) > 0.93) | (abs(x) + abs(y) > 1.6)
    return _finish(np.where(outside[..., None], 0.62 * (1 + 0.03 * noise(rng, 0.8, side)[..., None]), image))


def foil(rng: np.random.Generator) -> np.ndarray:
    """Creases of gold foil: facets between ridges. Its brightness serves as relief too."""
    ridges = -np.abs(noise(rng, 1.5)) - 0.5 * np.abs(noise(rng, 1.3)) - 0.25 * np.abs(noise(rng, 1.1))
    ridges = (ridges - ridges.min()) / np.ptp(ridges)
    return _finish((0.55 + 0.45 * ridges[..., None]) * np.array([0.95, 0.68, 0.25]))


def white(rng: np.random.Generator) -> np.ndarray:
    """Plaster or white paint without any detail."""
    return np.full((64, 64, 3), int(rng.integers(185, 215)), np.uint8)
