"""Which pairs of images are compared, so that the number of pairs grows linearly with the number of images."""

from __future__ import annotations

import numpy as np

from massprops.geometry.vectors import unit

Pairs = list[tuple[int, int]]


def exhaustive(n: int) -> Pairs:
    """All pairs of n images."""
    return [(i, j) for i in range(n) for j in range(i + 1, n)]


def sequential(n: int, overlap: int) -> Pairs:
    """Each image with its next `overlap` ones, and with the images 2, 4, 8 ... overlaps further on while few."""
    steps = list(range(1, overlap + 1)) + [overlap * k for k in (2, 3)]
    return [(i, i + s) for i in range(n) for s in steps if i + s < n]


def near(n: int, overlap: int) -> Pairs:
    """Each of n images with its next `overlap` ones."""
    return [(i, j) for i in range(n) for j in range(i + 1, min(n, i + overlap + 1))]


def similar(signatures: np.ndarray, most: int, apart: int) -> Pairs:
    """Each image with the `most` images whose signatures are nearest, at least `apart` places away in the list.

    Args:
        signatures: (n, d) unit rows.
    """
    n = len(signatures)
    order = np.arange(n)
    far = np.abs(order[:, None] - order) >= max(1, apart)
    score = np.where(far, signatures @ signatures.T, -np.inf)
    best = np.argsort(-score, axis=1, kind="stable")[:, :most]
    return sorted({(min(i, j), max(i, j)) for i in range(n) for j in best[i].tolist() if far[i, j]})


def spread_facing(directions: np.ndarray, most: int, apart: int, widest_deg: float) -> Pairs:
    """Each image with at most `most` that see the body from nearly the same direction, `apart` places from each other.

    Neighbours in time look alike and add little to each other; a body that shows the same side again after a full
    turn gives one partner per turn.
    """
    n = len(directions)
    cosine = directions @ directions.T
    least = np.cos(np.deg2rad(widest_deg))
    pairs: set[tuple[int, int]] = set()
    for i in range(n):
        taken = [i]
        for j in np.argsort(-cosine[i], kind="stable"):
            if cosine[i, j] < least or len(taken) > most:
                break
            if all(abs(int(j) - k) >= apart for k in taken):
                taken.append(int(j))
        pairs.update((min(i, j), max(i, j)) for j in taken[1:])
    return sorted(pairs)


def signatures(descriptors: list[np.ndarray], seed: int, words: int = 48, sample: int = 300) -> np.ndarray:
    """One unit vector per image: residuals of its descriptors to a small vocabulary (VLAD, Jégou 2010, eq. 1).

    The vocabulary is learnt from the images themselves by a few rounds of k-means.

    Args:
        descriptors: per image (k, 128) uint8.

    Returns:
        (n, words * 128).
    """
    rng = np.random.default_rng(seed)
    some = []
    for d in descriptors:
        take = rng.permutation(len(d))[:sample]
        some.append(unit(d[take].astype(np.float32)))
    pool = np.concatenate([x[:60] for x in some]) if some else np.zeros((0, 128), np.float32)
    if len(pool) < words:
        return np.zeros((len(descriptors), words * 128), np.float32)
    centres = pool[rng.permutation(len(pool))[:words]]
    for _ in range(8):
        nearest = np.argmax(pool @ centres.T - 0.5 * (centres**2).sum(1), axis=1)
        for k in range(words):
            if np.any(nearest == k):
                centres[k] = pool[nearest == k].mean(0)
    out = np.zeros((len(some), words, 128), np.float32)
    for i, x in enumerate(some):
        if len(x):
            nearest = np.argmax(x @ centres.T - 0.5 * (centres**2).sum(1), axis=1)
            np.add.at(out[i], nearest, x - centres[nearest])
    out = out.reshape(len(some), -1)
    out = np.sign(out) * np.sqrt(np.abs(out))
    return unit(out)
