"""What all images of a placement together say of each pixel: whether something stands before the support.

Two pictures of the support are put together. The wide one shows what lies behind the object in low images. The fine one is of the
object's foot, where stereo cannot tell a shadow from the object: its windows reach over both. There the first shape is
believed from the height on that no window reaches (`foot_picture`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from massprops.capture.colours import BINS, colour_cells
from massprops.capture.from_shape import equivalent_diameter, outline_band
from massprops.capture.support_picture import Grid, SupportPicture, grid_about, picture_of_support
from massprops.capture.votes import Evidence
from massprops.documents.arrays import open_arrays
from massprops.geometry.projection import pixels_of
from massprops.geometry.rasterise import silhouette
from massprops.views import Views

PICTURED = 4.0
"""Half the side of the wide picture, over half the size of the shape: what lies behind it in low images."""
MOST_PLACES = 560
LOW = 10.0
"""Height up to which the windows of stereo reach over the object's foot and its support [px]: they are 9 px wide (`dense.patchmatch`)."""
ABOUT = 25.0
"""Width of the fine picture about the foot [px]: the widest foot that shadows made was 13 px too wide, of two jugs."""
EDGE = 2
"""Pixels about what stands higher than the foot that may show it."""
WALL, LEAST_WALL = 40.0, 300
"""Height up to which the object is the one just above its foot [px], and points without which that is not known."""
RARE = 0.01
"""Share of the points just above the foot whose colours say nothing of what the foot looks like. In the deepest shade beside a
blue jug .0007 of them were as rare as the purple cloth."""
FREE = 0.2
"""Distance from the measured silhouette, in its equivalent diameters, from which on pixels are free of the object for
learning, but for a part that it lacks."""
LOOKED_AT = 800
"""Longer side to which images are reduced [px]: the outline's own pixels are decided in the whole image."""


def reduced(views: Views) -> Views:
    """The views at the size in which they are looked at."""
    factor = np.minimum(1.0, LOOKED_AT / views.size.max(1))
    size = np.rint(views.size * factor[:, None]).astype(views.size.dtype)
    scale = size / views.size
    K = views.K.copy()
    K[:, :2] *= scale[:, :, None]
    K[:, :2, 2] += 0.5 * scale - 0.5
    return replace(views, size=size, K=K)


def reduced_image(image: np.ndarray, small: Views, i: int) -> np.ndarray:
    """An image (h, w, 3) uint8 in the size of view i of `small`."""
    import cv2

    size = (int(small.size[i, 0]), int(small.size[i, 1]))
    return image if image.shape[1::-1] == size else cv2.resize(image, size, interpolation=cv2.INTER_AREA)


@dataclass(frozen=True)
class SupportEvidence:
    """What the images of one placement say of its support.

    Attributes:
        names: of its n images.
        pictures: of the support, made of them; where several know a place the first is believed.
        evidence: what differs from them says.
        standing: (m, 3) points of other things that stand on the support.
        pixel: size at the object.
    """

    names: tuple[str, ...]
    pictures: tuple[SupportPicture, ...]
    evidence: Evidence
    standing: np.ndarray
    pixel: float

    def moved(self, R: np.ndarray, t: np.ndarray) -> SupportEvidence:
        """The same after x -> R x + t."""
        pictures = tuple(replace(p, grid=p.grid.moved(R, t)) for p in self.pictures)
        return replace(self, pictures=pictures, standing=self.standing @ R.T + t)

    def at_foot(self, xyz: np.ndarray) -> np.ndarray:
        """(n,) bool: points (n, 3) so low that the windows of stereo reach over them and the support."""
        grid = self.pictures[0].grid
        normal = np.cross(grid.second, grid.first)
        height = (xyz - grid.origin) @ normal / np.linalg.norm(normal)
        return np.asarray(np.abs(height) < LOW * self.pixel)

    def log_odds(self, views: Views, i: int, image: np.ndarray) -> np.ndarray | None:
        """(h, w) float32 log odds of something before the support, 0 where nothing is known; None of an image that is not among
        those of the pictures.

        Args:
            views: in the frame of the pictures; image: (h, w, 3) uint8 of view i, undistorted.
        """
        import cv2

        if views.names[i] not in self.names:
            return None
        place = self.names.index(views.names[i])
        small = reduced(views.take(np.array([i])))
        pictures = [p.of_image(place) for p in self.pictures]
        off, scatter = off_of(pictures, small, 0, reduced_image(image, small, 0))
        odds = np.where(dots(self.standing, small, 0), 0.0, self.evidence.of(off, scatter)).astype(np.float32)
        odds = cv2.blur(odds, (3, 3))
        h, w = image.shape[:2]
        return odds if odds.shape == (h, w) else cv2.resize(odds, (w, h), interpolation=cv2.INTER_LINEAR)

    def save(self, path: Path) -> None:
        """Writes one `.npz`."""
        held = {f"{name}{k}": a for k, p in enumerate(self.pictures) for name, a in p.arrays().items()}
        held |= {"names": np.array(self.names), "log_odds": self.evidence.log_odds}
        held |= {"standing": self.standing, "pixel": np.array(self.pixel)}
        np.savez(path, **held)  # type: ignore[arg-type]

    @staticmethod
    def load(path: Path) -> SupportEvidence:
        """Reads what `save` wrote."""
        with open_arrays(path) as z:
            count = sum(name.startswith("origin") for name in z.files)
            pictures = tuple(SupportPicture.of_arrays(z, str(k)) for k in range(count))
            names, evidence = tuple(z["names"].tolist()), Evidence(z["log_odds"])
            return SupportEvidence(names, pictures, evidence, z["standing"], float(z["pixel"]))


def off_of(
    pictures: Iterable[SupportPicture], views: Views, i: int, image: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """As `SupportPicture.off`, of the first picture that knows what lies behind a pixel."""
    off = scatter = np.full(image.shape[:2], np.nan, np.float32)
    for picture in pictures:
        one, its = picture.off(views, i, image)
        unknown = np.isnan(off)
        off, scatter = np.where(unknown, one, off), np.where(unknown, its, scatter)
    return off, scatter


@dataclass(frozen=True)
class Looked:
    """A placement's images as they are looked at for its support.

    Attributes:
        views: n views, reduced; image: `image(i)` is (h, w, 3) uint8, undistorted, in their size.
        plane: (4,) support; vertices, faces: (v, 3), (f, 3) of the measured shape.
        drawn: n of (h, w) bool, its silhouettes.
        others: n of (h, w) bool, pixels about other things that stand on the support; standing: (m, 3) their points.
        pixel: size at the object.
    """

    views: Views
    image: Callable[[int], np.ndarray]
    plane: np.ndarray
    vertices: np.ndarray
    faces: np.ndarray
    drawn: list[np.ndarray]
    others: list[np.ndarray]
    standing: np.ndarray
    pixel: float

    @staticmethod
    def at(
        views: Views,
        image: Callable[[int], np.ndarray],
        plane: np.ndarray,
        shape: tuple[np.ndarray, np.ndarray],
        standing: np.ndarray,
        pixel: float,
    ) -> Looked:
        """With the silhouettes of a shape, vertices and faces; other arguments are attributes."""
        drawn = [drawn_in(views, i, *shape) for i in range(len(views))]
        others = [dots(standing, views, i) for i in range(len(views))]
        return Looked(views, image, plane, *shape, drawn, others, standing, pixel)

    def near(self, i: int) -> np.ndarray:
        """(h, w) bool: where the object may hide the support in view i, or another thing does."""
        return _grown(self.drawn[i], outline_band(self.drawn[i])) | self.others[i]


def wide_picture(seen: Looked) -> SupportPicture:
    """The support about the object and behind it, from the images in which the object is not near a place."""
    low, high = seen.vertices.min(0), seen.vertices.max(0)
    reach = PICTURED * 0.5 * float(np.linalg.norm(high - low))
    grid = grid_about(seen.plane, 0.5 * (low + high), reach, seen.pixel, MOST_PLACES)
    return picture_of_support(seen.views, seen.image, grid, seen.near)


def foot_picture(seen: Looked, own: tuple[np.ndarray, np.ndarray]) -> SupportPicture:
    """The support at the object's foot.

    The first shape may hide places there in all images that it does not hide in truth. Such a place is taken for the support's where
    it lies beside what rises just above the foot, hangs together with places that are free, and has none of the colours there.

    Args:
        own: (n, 3) measured points of the object and (n, 3) uint8 BGR their colours.
    """
    height = (seen.vertices @ seen.plane[:3] + seen.plane[3]) / seen.pixel
    foot = seen.vertices[height <= max(LOW, float(np.quantile(height, 0.05)))]
    low, high = foot.min(0), foot.max(0)
    reach = 0.5 * float(np.linalg.norm(high - low)) + ABOUT * seen.pixel
    grid = grid_about(seen.plane, 0.5 * (low + high), reach, seen.pixel, MOST_PLACES)
    free = picture_of_support(seen.views, seen.image, grid, seen.near)
    risen = (own[0] @ seen.plane[:3] + seen.plane[3]) / seen.pixel
    wall = own[1][(risen > LOW) & (risen < WALL)]
    if len(wall) < LEAST_WALL:
        return free
    top = seen.faces[height[seen.faces].min(1) > LOW]

    def hidden(i: int) -> np.ndarray:
        return _grown(drawn_in(seen.views, i, seen.vertices, top), EDGE) | seen.others[i]

    perhaps = picture_of_support(seen.views, seen.image, grid, hidden)
    known, there = (np.isfinite(p.colour[..., 0]) for p in (free, perhaps))
    section = _shadow(grid, seen.vertices, top[height[top].max(1) < WALL])
    taken = there & ~known & _beside(section, ABOUT * seen.pixel / grid.step) & ~_has_colours(perhaps.colour, wall)
    taken = _reached_from(known, taken)
    colour = np.where(taken[..., None], perhaps.colour, free.colour)
    return SupportPicture(grid, colour, np.where(taken, perhaps.scatter, free.scatter), free.light)


def _shadow(grid: Grid, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(c, c) bool: places that lie straight below faces, or are enclosed by such."""
    import cv2
    from scipy.ndimage import binary_fill_holes

    off = vertices - grid.origin
    at = np.stack([off @ grid.second, off @ grid.first], axis=1) / grid.step**2
    out = np.zeros((grid.count, grid.count), np.uint8)
    for triangle in np.rint(at[faces]).astype(np.int32):
        cv2.fillConvexPoly(out, triangle, 1)
    return np.asarray(binary_fill_holes(out > 0))


def _beside(section: np.ndarray, reach: float) -> np.ndarray:
    """(c, c) bool: places off a section, and within `reach` steps of it."""
    import cv2

    if not section.any():
        return section
    off = cv2.distanceTransform((~section).astype(np.uint8), cv2.DIST_L2, 5)
    return np.asarray((off > EDGE) & (off < reach))


def _has_colours(colour: np.ndarray, own: np.ndarray) -> np.ndarray:
    """(c, c) bool: places whose colours (c, c, 3) are not among the rarest of own ones (n, 3) uint8 BGR."""
    from scipy.ndimage import gaussian_filter

    cells = colour_cells(own[:, None]).ravel()
    count = np.bincount(cells, minlength=BINS**3).reshape((BINS,) * 3).astype(np.float64)
    density = gaussian_filter(count, 1.0).ravel()
    level = np.clip(np.nan_to_num(colour), 0.0, 255.0).astype(np.uint8)
    return np.asarray(density[colour_cells(level)] >= np.quantile(density[cells], RARE))


def _reached_from(known: np.ndarray, taken: np.ndarray) -> np.ndarray:
    """(c, c) bool: the pieces of `taken` that touch what is known."""
    from scipy.ndimage import binary_dilation, label

    piece, number = label(taken)
    touch = np.bincount(piece[binary_dilation(known)], minlength=number + 1) > 0
    touch[0] = False
    return np.asarray(touch[piece])


def learned(seen: Looked, pictures: tuple[SupportPicture, ...]) -> SupportEvidence:
    """What differs from pictures of the support says, from how the measured object does and what is free of it."""
    import cv2

    inside, free = [], []
    for i, (d, beside) in enumerate(zip(seen.drawn, seen.others, strict=True)):
        off, scatter = off_of(pictures, seen.views, i, seen.image(i))
        known = np.isfinite(off) & ~beside
        deep = cv2.distanceTransform(d.astype(np.uint8), cv2.DIST_L2, 5) > outline_band(d)
        far = cv2.distanceTransform((~d).astype(np.uint8), cv2.DIST_L2, 5) > FREE * equivalent_diameter(d)
        inside.append((off[known & deep], scatter[known & deep]))
        free.append((off[known & far], scatter[known & far]))
    evidence = Evidence.learn(_pooled(inside), _pooled(free))
    return SupportEvidence(seen.views.names, pictures, evidence, seen.standing, seen.pixel)


def _pooled(pixels: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    return np.concatenate([a for a, _ in pixels]), np.concatenate([b for _, b in pixels])


def drawn_in(views: Views, i: int, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(h, w) bool: silhouette of a mesh in view i."""
    size = (int(views.size[i, 0]), int(views.size[i, 1]))
    return silhouette(vertices, faces, views.K[i], views.R[i], views.t[i], size)


def _grown(mask: np.ndarray, pixels: int) -> np.ndarray:
    import cv2

    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8), iterations=pixels) > 0)


def dots(xyz: np.ndarray, views: Views, i: int) -> np.ndarray:
    """(h, w) bool: pixels of view i about the projections of points (m, 3)."""
    import cv2

    out = np.zeros(views.size[i, ::-1], np.uint8)
    _, rows, columns = pixels_of(xyz, views.K[i], views.R[i], views.t[i], out.shape)
    out[rows, columns] = 1
    return np.asarray(cv2.dilate(out, np.ones((9, 9), np.uint8)) > 0)
