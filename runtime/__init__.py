"""The runtime: turns a .gsgi file into pixels. It needs numpy and moderngl, and imports neither the baker nor torch."""


def __getattr__(name: str):
    """`gsgi.runtime.sample`, loaded when it is first used, so that importing the package costs nothing."""
    if name != "sample":
        raise AttributeError(f"module 'gsgi.runtime' has no attribute {name!r}")
    from .sampling import sample

    return sample
