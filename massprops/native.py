"""Native libraries that need a hand before they load."""

from __future__ import annotations

from types import ModuleType

from massprops.errors import InputError


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
    return "run 'massprops doctor'"
