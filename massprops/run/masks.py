"""`massprops masks`: a run's silhouettes over its images, and in COLMAP's naming, to be mended and given back."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from massprops.capture.given import to_original
from massprops.capture.images import LARGEST_PIXELS
from massprops.core.files import hash_of, write_whole
from massprops.core.inputs import read_image, readable
from massprops.core.outputs import Outputs, claim, verify
from massprops.documents.arrays import open_arrays
from massprops.documents.loading import load_json
from massprops.errors import InputError
from massprops.report.masks_page import Sheet, Silhouette, masks_page
from massprops.sfm.footage import silhouette_file
from massprops.sfm.global_images import SHIFTS, as_read
from massprops.views import AMBIGUOUS

COMMAND = "masks"
PAGE = "masks.html"


def masks(run: str | Path, out: str | Path | None = None, force: bool = False) -> Sheet:
    """Writes the silhouettes of a run at the size of the user's images, and a page that shows them.

    The masks are white on black, named `NAME.png` after the image `NAME`, and lie over its pixels as they are stored:
    `massprops reconstruct IMAGES --masks FOLDER` takes them back. 128 stands where it cannot be told what a pixel
    shows. An image that says nothing of the shape has a black mask: drawn in, it takes part the next time.

    Args:
        run: a run folder that came as far as its silhouettes.
        out: the folder to write; `RUN-masks` beside the run by default.
        force: masks that were mended in that folder, and files that are not of this command, may be replaced.

    Raises:
        InputError: no silhouettes in the run, or the folder holds something else.

    Example:
        >>> sheet = massprops.masks("runs/one")  # doctest: +SKIP
        >>> min(s.iou for s in sheet.images if s.iou is not None)  # doctest: +SKIP
    """
    with _check_unchanged(Path(run)):
        return _masks(readable(Path(run)).resolve(), out, force)


@contextlib.contextmanager
def _check_unchanged(run: Path) -> Iterator[None]:
    """Tells a run folder whose work/ is not what its command left there, and that has no record to tell it by."""
    try:
        yield
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, ArithmeticError) as error:
        raise InputError(
            f"{run}: its work/ is not as 'massprops reconstruct' leaves it ({type(error).__name__}): give that command again"
        ) from error


def _masks(run: Path, out: str | Path | None, force: bool) -> Sheet:
    footage = _footage(run)
    out = readable(Path(out)).resolve() if out is not None else run.parent / f"{run.name}-masks"
    if out == run or run in out.parents:
        raise InputError(f"{out}: lies in the run folder, which the next reconstruct tidies: choose another -o")
    names = mask_names(footage)
    given = [Path(p) for p in footage.get("sources") or [footage["source"]]]
    agreement, reasons = against_mesh(run), why_left_out(run, footage)
    listed = [
        Silhouette(f["source_name"], f["name"], file, agreement.get(f["name"]), _said(f["name"], reasons, agreement))
        for f, file in zip(footage["frames"], names, strict=True)
    ]
    refused = [(e["source_name"], e["reason"]) for e in footage.get("left_out") or []]
    with claim(out, COMMAND, [*names, PAGE], [run, *given], force) as outputs:
        _refuse_mended(outputs, force)
        try:
            new = outputs.staging()
            for name, content in _encoded(run, footage, names):
                (new / name).parent.mkdir(parents=True, exist_ok=True)
                write_whole(new / name, content)
            page = masks_page(run.name, Sheet(out, out / PAGE, listed, refused), lambda stored: _pictures(run, stored))
            write_whole(new / PAGE, page)
            outputs.publish(COMMAND, hash_of([str(run), names]), [run], force)
        except OSError as error:
            raise InputError(f"{out}: cannot be written ({error.strerror}): choose another place with -o") from None
    return Sheet(out, out / PAGE, listed, refused)


def _footage(run: Path) -> dict[str, Any]:
    if not (run / "work" / "silhouettes" / "masks").is_dir():
        raise InputError(
            f"{run}: no silhouettes in this folder: give a run that 'massprops reconstruct' brought as far as its "
            "silhouettes"
        )
    verify(run, "work/capture", "work/silhouettes", "work/sfm", "work/join", "work/surface")
    return load_json(run / "work" / "capture" / "footage.json")


def mask_names(footage: dict[str, Any]) -> list[str]:
    """Where the mask of each frame goes: `NAME.png`, in `camN/` where two streams or files share their names."""
    source_names = [f["source_name"] for f in footage["frames"]]
    apart = len({f["name"].split("/", 1)[0] for f in footage["frames"]}) > 1 or len(set(source_names)) < len(
        source_names
    )
    if apart:
        return [f"{f['name']}.png" for f in footage["frames"]]
    return [f"{name}.png" for name in source_names]


def _refuse_mended(outputs: Outputs, force: bool) -> None:
    mended = [n for n, e in outputs.files.items() if e["by"] == COMMAND and not outputs.intact(n)]
    mended = [n for n in mended if (outputs.folder / n).exists()]
    if mended and not force:
        raise InputError(
            f"{outputs.folder / mended[0]}: was changed since it was written: give it to 'massprops reconstruct --masks', "
            "or choose another -o, or --force to replace it"
        )


def _encoded(run: Path, footage: dict[str, Any], names: list[str]) -> Iterator[tuple[str, bytes]]:
    """Every mask as the bytes of a PNG at the size of the user's image."""
    import cv2

    cameras = {c["id"]: c for c in footage["cameras"]}
    for frame, name in zip(footage["frames"], names, strict=True):
        size = tuple(cameras[frame["camera"]].get("source_size") or (frame["width"], frame["height"]))
        size = size[::-1] if frame.get("turn", 0) % 2 else size
        for w, h in (size, (frame["width"], frame["height"])):
            if not (w >= 1 and h >= 1 and w * h <= LARGEST_PIXELS):
                raise ValueError(f"an image of {w}x{h} pixels")
        mask = _over_stored(run, frame["name"])
        if mask is None or not (mask == 255).any():
            mask = np.zeros((frame["height"], frame["width"]), np.uint8)
        done, data = cv2.imencode(".png", to_original(mask, size, _exif(_file(footage, frame))))
        if not done:
            raise OSError(5, "the mask cannot be written", name)
        yield name, data.tobytes()


def _file(footage: dict[str, Any], frame: dict[str, Any]) -> Path:
    """The user's file of a frame; of a video, one that is not there."""
    if "placement" not in frame:
        return Path(footage["source"], frame["source_name"])
    return Path(footage["sources"][frame["placement"]], frame["source_name"].split("/", 1)[1])


def _exif(image: Path) -> int:
    """The file's EXIF orientation, 1 where it is gone or no image."""
    from massprops.capture.images import orientation

    try:
        return orientation(image) if image.is_file() else 1
    except InputError:
        return 1


def read_mask(run: Path, stored: str) -> np.ndarray | None:
    """The silhouette of a frame, (h, w) uint8, or None where the run has none."""
    path = silhouette_file(run / "work", stored)
    return read_image(path, 0) if path.is_file() else None


def _pictures(run: Path, stored: str) -> tuple[np.ndarray, np.ndarray | None]:
    mask = _over_stored(run, stored)
    known = mask is not None and bool((mask == 255).any())
    return read_image(run / "work" / "capture" / "frames" / stored), mask if known else None


def _over_stored(run: Path, stored: str) -> np.ndarray | None:
    """As `read_mask`, over the frame as it was filmed, also where a rolling shutter was corrected."""
    mask = read_mask(run, stored)
    return None if mask is None else as_read(mask, run / "work" / "sfm" / SHIFTS, stored)


def against_mesh(run: Path) -> dict[str, float]:
    """Intersection over union of each silhouette with the final mesh, by stored name; pixels that cannot be told do not
    count. Empty where the run has no mesh yet."""
    from massprops.capture.from_shape import overlap
    from massprops.geometry.rasterise import silhouette
    from massprops.views import Views, undistort

    surface, join = run / "work" / "surface" / "surface.npz", run / "work" / "join" / "views.npz"
    if not surface.is_file() or not join.is_file():
        return {}
    views = Views.load(join)
    with open_arrays(surface) as z:
        vertices, faces = z["vertices"], z["faces"]
    out = {}
    for i, name in enumerate(views.names):
        mask = read_mask(run, name)
        if mask is None or not (mask == 255).any():
            continue
        flat = undistort(mask, views.K[i], views.distortion[i], nearest=True)
        drawn = silhouette(vertices, faces, views.K[i], views.R[i], views.t[i], flat.shape[::-1])
        known = flat != AMBIGUOUS
        out[name] = overlap(drawn & known, (flat == 255) & known)
    return out


def why_left_out(run: Path, footage: dict[str, Any]) -> dict[str, str]:
    """Stored name to the reason for which a frame says nothing of the shape."""
    from massprops.views import Views

    def read(stage: str) -> dict[str, Any]:
        path = run / "work" / stage / f"{stage}.json"
        return load_json(path) if path.is_file() else {}

    names = [f["name"] for f in footage["frames"]]
    placed = set(Views.load(run / "work" / "sfm" / "views.npz").names)
    out = {n: "it could not be placed: too few of its features were found in other images" for n in set(names) - placed}
    elsewhere = read("silhouettes").get("left_out") or []
    out |= dict.fromkeys(elsewhere, "it shows the object in another place than the other images do")
    for gone in read("shape").get("lost") or []:
        out |= dict.fromkeys(gone["images"], f"its placement of the object could not be solved: {gone['reason']}")
    joined = run / "work" / "join" / "views.npz"
    if joined.is_file():
        rest = placed - set(Views.load(joined).names) - set(out)
        out |= dict.fromkeys(rest, "it shows another placement of the object, which could not be joined")
    return out


def _said(name: str, reasons: dict[str, str], agreement: dict[str, float]) -> str:
    if name in reasons:
        return reasons[name]
    return "its mask does not show the object" if agreement and name not in agreement else ""
