"""The compiled kernels, or a clear error if they were not built."""

from gsgi.runtime.errors import UnsupportedError

try:
    from gsgi.baker import _kernels as kernels
except ImportError as error:
    raise UnsupportedError(
        "gsgi was installed without its compiled kernels, which baking needs: install a C++ compiler (Debian: g++), "
        f"then gsgi again ({error})"
    ) from error

__all__ = ["kernels"]
