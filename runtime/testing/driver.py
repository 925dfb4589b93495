"""Names of drivers in golden images."""

import re
from collections.abc import Mapping
from typing import NamedTuple

# Software rasterisers. They compute pixels in their own way, independent of the vendor that they report.
_SOFTWARE = ("llvmpipe", "softpipe", "swrast")
_VERSION = re.compile(r"(?:Mesa|NVIDIA) (\d+\.\d+)")


class Driver(NamedTuple):
    """`family`, such as "llvmpipe" or "nvidia"; `key`, the family and the driver's version: "llvmpipe-22.3"."""

    family: str
    key: str


def driver_of(info: Mapping[str, str]) -> Driver:
    """The driver behind `moderngl.Context.info`.

    The family is the software rasteriser or, without one, the first word of the vendor. The version is that of Mesa or
    of NVIDIA's driver, without its last part, or else that of OpenGL.
    """
    renderer, vendor = info["GL_RENDERER"].lower(), info["GL_VENDOR"].lower()
    software = next((name for name in _SOFTWARE if renderer.startswith(name)), None)
    family = software or re.sub(r"\(.*?\)|[^a-z0-9]", "", (vendor.split() or [""])[0]) or "unknown"
    version = _VERSION.search(info["GL_VERSION"]) or re.search(r"(\d+\.\d+)", info["GL_VERSION"])
    return Driver(family, f"{family}-{version[1]}" if version else family)
