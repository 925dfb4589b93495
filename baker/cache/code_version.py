"""A version of the code that computes something. It changes whenever that code does."""

import ast
import functools
import hashlib
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from gsgi.runtime.constants import GLSL_FOLDER

from .digest import digest


@functools.cache
def code_version(module: str, packages: tuple[str, ...]) -> str:
    """Digest of `module` (absolute name), the gsgi modules it imports, the GLSL constants, and packages' versions."""
    hashes = {name: hashlib.blake2b(path.read_bytes()).hexdigest() for name, path in closure(module).items()}
    constants = hashlib.blake2b((GLSL_FOLDER / "lib" / "constants.glsl").read_bytes()).hexdigest()
    return digest({"modules": hashes, "constants": constants, "packages": {name: _version(name) for name in packages}})


def closure(module: str) -> dict[str, Path]:
    """Names and files of `module` and of every gsgi module that it imports, directly or not, anywhere in its code."""
    found, waiting = {}, [module]
    while waiting:
        name = waiting.pop()
        if name not in found and (path := _file(name)):
            found[name] = path
            waiting += _imports(name, path)
    return dict(sorted(found.items()))


@functools.cache
def _imports(module: str, path: Path) -> tuple[str, ...]:
    """Absolute names within gsgi that a module imports; some may not be modules."""
    if path.suffix != ".py":
        return ()
    package = module.split(".") if path.name == "__init__.py" else module.split(".")[:-1]
    names = []
    for node in _statements(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*base, *([node.module] if node.module else [])])
            names += [base, *(f"{base}.{alias.name}" for alias in node.names)]
    return tuple(name for name in names if name.split(".")[0] == "gsgi")


def _statements(block: ast.AST) -> Iterator[ast.AST]:
    """All statements of a block, at any depth. Expressions hold none, and are most of a module."""
    for part in ("body", "orelse", "finalbody", "handlers", "cases"):
        for inner in getattr(block, part, ()):
            yield inner
            yield from _statements(inner)


@functools.cache
def _file(module: str) -> Path | None:
    """The source of a module, or its library if compiled; None if the name is no module. Imports packages only."""
    parent = module.rpartition(".")[0]
    inside = _file(parent) if parent else None
    if inside and inside.name != "__init__.py":  # a name inside a module
        return None
    spec = find_spec(module)
    return Path(spec.origin) if spec and spec.origin else None


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
