"""Global illumination for real-time engines, stored as 3D Gaussians.

    import gsgi

    report = gsgi.bake("room.glb", "room.gsgi", quality="draft")
    print(report.gaussians, report.ssim)

Baking needs the extra `bake` and its compiled kernels; reading and drawing need neither. The names of `__init__.pyi`
beside this file are the stable interface. Each is loaded when it is first used, so `import gsgi` costs nothing.
"""


def __getattr__(name: str):
    homes = _homes()
    if name not in homes:
        raise AttributeError(f"module 'gsgi' has no attribute {name!r}")
    from importlib import import_module

    value = globals()[name] = getattr(import_module(homes[name], __name__), name)
    return value


def __dir__() -> list[str]:
    return [*globals(), *_homes()]


def _homes() -> dict[str, str]:
    """The module that each name of the interface comes from, as the stub says."""
    import ast
    from pathlib import Path

    tree = ast.parse(Path(__file__).with_suffix(".pyi").read_bytes())
    return {alias.name: f".{node.module}" for node in tree.body for alias in node.names}
