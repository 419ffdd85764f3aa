"""Native libraries that need preparation before they load."""

from __future__ import annotations

import re
import shutil
import stat
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from massprops.core.processes import captured_output
from massprops.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    import pymeshlab


def prepare_numba_cache() -> None:
    """Sets a folder for numba's compiled code if numba would find none: a read-only install without a writable home.

    Without it numba fails at the first function that it compiles, minutes into a run. Only this user may write there,
    since numba loads what it finds. Call this before numba is imported.
    """
    import os
    import tempfile

    if os.environ.get("NUMBA_CACHE_DIR"):
        return
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") if _has_home() else Path(os.devnull)
    package = Path(__file__).parent
    if _writable(package) and _writable(package / "__pycache__") or _writable(cache):
        return
    try:
        place = Path(tempfile.gettempdir()) / f"massprops-numba-{os.getuid()}"
        place.mkdir(mode=0o700, exist_ok=True)
        status = place.lstat()
        if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & 0o077:
            place = Path(tempfile.mkdtemp(prefix="massprops-numba-"))
    except (OSError, AttributeError):
        return
    os.environ["NUMBA_CACHE_DIR"] = str(place)


def encode(
    path: Path, images: Iterable[np.ndarray], rate_hz: float, codec: str, pixels: str, options: dict[str, str]
) -> None:
    """A video of images (h, w) grey or (h, w, 3) red, green, blue, uint8, all of one size; codec, format of its pixels and
    options as FFmpeg names them."""
    from fractions import Fraction

    import av
    import numpy as np

    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=Fraction(rate_hz).limit_denominator(1000))
        stream.pix_fmt, stream.options = pixels, options
        for k, image in enumerate(images):
            if not k:
                stream.height, stream.width = image.shape[:2]
            style = "gray" if image.ndim == 2 else "rgb24"
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format=style)))
        container.mux(stream.encode())


def _has_home() -> bool:
    try:
        Path.home()
    except (RuntimeError, KeyError):
        return False
    return True


def _writable(path: Path) -> bool:
    """Whether a folder can be written, or made."""
    import os

    while not path.exists() and path != path.parent:
        path = path.parent
    return path.is_dir() and os.access(path, os.W_OK | os.X_OK)


def load_open3d() -> ModuleType:
    """open3d, on machines without the system's libusb too.

    Its extension asks for `libusb-1.0.so.0` when it is imported, which a slim machine lacks; the PyPI package
    `libusb-package` carries that library, and loading it first satisfies the request without root.

    Raises:
        InputError: another system library is missing; says which, and what to type.
    """
    import ctypes

    try:
        ctypes.CDLL("libusb-1.0.so.0", mode=ctypes.RTLD_GLOBAL)
    except OSError:
        import libusb_package

        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise InputError(f"open3d cannot be loaded: {error}; {advice(str(error))}") from None
    return open3d


def ray_scene(*meshes: tuple[np.ndarray, np.ndarray]) -> Any:
    """open3d's `RaycastingScene` of meshes, vertices (v, 3) and faces (f, 3), which it numbers in this order.

    It keeps vertices as float32, and its queries take contiguous arrays of that, of which its types say nothing.
    """
    import numpy as np

    scene = load_open3d().t.geometry.RaycastingScene()
    for vertices, faces in meshes:
        scene.add_triangles(np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.uint32))
    return scene


def mesh_set(vertices: np.ndarray, faces: np.ndarray) -> pymeshlab.MeshSet:
    """A mesh as a MeshLab mesh set: vertices (v, 3), faces (f, 3).

    MeshLab prints on standard output which of its plug-ins it cannot load; this is captured.

    Raises:
        InputError: the part that meshes cannot be loaded; says what is missing, and what to type.
    """
    import numpy as np

    with captured_output() as printed:
        import pymeshlab

        made = pymeshlab.MeshSet(verbose=False)
    if not hasattr(made, "meshing_decimation_quadric_edge_collapse"):
        why = re.search(r"lib[\w.+-]+\.so[\w.]*: cannot open shared object file", "".join(printed))
        reason = why[0] if why else "the part of it that meshes cannot be loaded"
        raise InputError(f"pymeshlab cannot be used: {reason}; {advice(reason)}")
    made.add_mesh(pymeshlab.Mesh(np.asarray(vertices, float), np.asarray(faces, np.int32)))
    return made


WITHOUT_PYCOLMAP = (
    "pycolmap is needed to reconstruct: type 'pip install pycolmap'; on Linux on arm64, for which there is no wheel, "
    "build COLMAP and its Python package from source"
)
COMPILERS = ("c++", "g++", "clang++")


def missing(package: str) -> str:
    """What to do where a package that `reconstruct` needs is not installed, else nothing; the look-up loads nothing.

    Args:
        package: `pycolmap` or `PyMaxflow`.
    """
    if package == "pycolmap":
        return "" if find_spec("pycolmap") is not None else WITHOUT_PYCOLMAP
    if find_spec("maxflow") is not None:
        return ""
    build = "; it has no wheel for every Python, and then a C++ compiler builds it"
    if not any(shutil.which(name) for name in COMPILERS):
        build += ", which is not here: type 'sudo apt-get install g++' first"
    return f"PyMaxflow is needed to reconstruct: type 'pip install PyMaxflow'{build}"


PACKAGES = {
    "libgomp.so.1": "libgomp1",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libX11.so.6": "libx11-6",
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libOpenGL.so.0": "libopengl0",
    "libGLU.so.1": "libglu1-mesa",
    "libxcb.so.1": "libxcb1",
}
"""Debian and Ubuntu packages of the shared libraries that the native wheels ask for."""


def advice(message: str) -> str:
    """What to type for a missing shared library named in a loader's message."""
    for library, package in PACKAGES.items():
        if library in message:
            return f"type: sudo apt-get install {package}"
    other = re.search(r"\b(lib[\w+.-]*?)\.so\.(\d+)", message)
    if other:  # as Debian's policy names the packages of libraries (section 8.1)
        name = other[1].lower().replace("_", "-")
        return f"type: sudo apt-get install {name}{'-' if name[-1].isdigit() else ''}{other[2]}"
    return "run 'massprops doctor'"
