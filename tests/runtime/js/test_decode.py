"""The JavaScript decoder against the Python one: the same numbers to the last bit, the same refusals."""

import json
from dataclasses import asdict, replace

import numpy as np
from gsgi_files import NONSENSE, READ, STORED, changed, damaged_files, example, reseal, stored, surface_example
from javascript import JS, node
from repository import TESTS
from surface_cases import grouped, with_coarse_slopes, with_relief

from gsgi.runtime.errors import FormatError
from gsgi.runtime.file import codec
from gsgi.runtime.file.header import GROUP_TAG, RELIEF_TAG, section
from gsgi.runtime.light_groups import weighted

FILES = {
    **{name: stored(name) for name in READ},
    **{f"over_{degree}": codec.encode(example(300, degree)) for degree in range(4)},
    **{f"surface_{degree}": codec.encode(surface_example(700, degree, 90, 2 - degree)) for degree in range(3)},
    "light_groups": codec.encode(grouped(surface_example())),
    **{f"groups_{degree}": codec.encode(grouped(surface_example(60, degree, 9, 2 - degree))) for degree in range(3)},
    "groups_not_sloped": codec.encode(grouped(surface_example(sloped=False))),
    "groups_of_none": codec.encode(grouped(surface_example(0, 0, 0, 0))),
    "relief": codec.encode(with_relief(surface_example())),
    "relief_of_groups": codec.encode(with_relief(grouped(surface_example(60, 2, 9, 1)))),
    "relief_of_none": codec.encode(with_relief(surface_example(0, 0, 0, 0))),
    "not_sloped": codec.encode(surface_example(sloped=False)),
    "empty": codec.encode(surface_example(0, 0, 0, 0)),
}
WEIGHTS = [
    {"lamps": 0.3, "sky": [1, 0.5, 2]},
    {"base": 0, "lamps": 0, "sky": 0},
    {"base": [0, 0, 0.1]},
    {"sky": 1e15},
    {},
]
NAMES = {"alpha_min": "alphaMin", "alpha_max": "alphaMax"}


def decoded(data: bytes):
    """The bake, or None where Python refuses the file."""
    try:
        return codec.decode(data)
    except FormatError:
        return None


def write(folder, name: str, data: bytes, bake) -> None:
    (folder / f"{name}.gsgi").write_bytes(data)
    if bake is None:
        return
    header = {
        "operator": codec.OPERATOR_NAMES[type(bake.blend)],
        "effects": int(bake.effects),
        "bounces": bake.bounces,
        "toneScale": bake.tone_scale,
        "scene": str(bake.scene),
        "blend": {NAMES.get(field, field): value for field, value in asdict(bake.blend).items()},
        "groups": [{"name": group.name, "patterns": list(group.patterns)} for group in bake.groups],
        "weights": WEIGHTS if bake.groups and name in FILES else [],
    }
    (folder / f"{name}.gsgi.json").write_text(json.dumps(header))
    write_levels(folder / f"{name}.gsgi", bake, ("position", "rotation", "scale", "opacity", "sh", "slope", "relief"))
    for group in bake.groups:
        fine = replace(bake.gaussians, sh=group.sh, slope=group.slope)
        part = replace(bake, gaussians=fine, coarse=replace(bake.coarse, sh=group.coarse_sh))
        write_levels(folder / f"{name}.gsgi.{group.name}", part, ("sh", "slope"))
    for i, weights in enumerate(header["weights"]):
        write_levels(folder / f"{name}.gsgi.weighted{i}", weighted(bake, weights), ("sh", "slope", "relief"))


def write_levels(path, bake, fields) -> None:
    for level, gaussians in (("fine", bake.gaussians), ("coarse", bake.coarse)):
        for field in fields if gaussians is not None else ():
            if (field != "slope" or gaussians.sloped) and (field != "relief" or gaussians.bumpy):
                path.with_name(f"{path.name}.{level}.{field}").write_bytes(getattr(gaussians, field).tobytes())


def damaged_groups():
    """Files of which a byte of a group is another, or that have sections where none may stand."""
    small, rng = codec.encode(grouped(surface_example(3, 0, 2, 1))), np.random.default_rng(7)
    first = small.index(GROUP_TAG)
    for at in rng.integers(first, len(small), 150):
        yield reseal(small[:at] + rng.bytes(1) + small[at + 1 :])
    for end in range(first + 1, len(small), 7):
        yield reseal(small[:end])
    bumpy = codec.encode(with_relief(surface_example(3, 0, 2, 1)))
    first = bumpy.index(RELIEF_TAG)
    yield reseal(bumpy + bumpy[first:])
    for at in rng.integers(first, len(bumpy), 60):
        yield reseal(bumpy[:at] + rng.bytes(1) + bumpy[at + 1 :])
    for end in range(first + 1, len(bumpy), 3):
        yield reseal(bumpy[:end])
    yield reseal(small + small[small.index(GROUP_TAG) :])
    for tag in (GROUP_TAG, RELIEF_TAG):
        yield reseal(codec.encode(example(3)) + section(tag, b""))


def test_it_decodes_and_refuses_what_python_does(tmp_path):
    for name, data in FILES.items():
        write(tmp_path, name, data, codec.decode(data))
    strange = [changed(codec.encode(bake), field, value) for bake, field, value in NONSENSE]
    strange += [damaged for name in STORED for damaged in damaged_files(name, 100)]
    strange += [*damaged_groups(), with_coarse_slopes()]
    for number, data in enumerate(strange):
        bake = decoded(data)
        write(tmp_path, f"{'refused' if bake is None else 'damaged'}_{number}", data, bake)
    node("--test", TESTS / "runtime" / "js" / "decode.test.mjs", JS=JS, VECTORS=tmp_path)


def test_the_shaders_are_those_of_the_glsl_folder():
    node(JS / "build.mjs", "--check")
