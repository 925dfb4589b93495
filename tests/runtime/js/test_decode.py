"""The JavaScript decoder against the Python one: the same numbers to the last bit, the same refusals."""

import json
from dataclasses import asdict

from gsgi_files import NONSENSE, STORED, changed, damaged_files, example, stored, surface_example
from javascript import JS, node
from repository import TESTS
from surface_cases import grouped, with_relief

from gsgi.runtime.errors import FormatError
from gsgi.runtime.file import codec

FILES = {
    **{name: stored(name) for name in STORED},
    **{f"over_{degree}": codec.encode(example(300, degree)) for degree in range(4)},
    **{f"surface_{degree}": codec.encode(surface_example(700, degree, 90, 2 - degree)) for degree in range(3)},
    "light_groups": codec.encode(grouped(surface_example())),
    "relief": codec.encode(with_relief(surface_example())),  # which is skipped
    "not_sloped": codec.encode(surface_example(sloped=False)),
    "empty": codec.encode(surface_example(0, 0, 0, 0)),
}
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
    }
    (folder / f"{name}.gsgi.json").write_text(json.dumps(header))
    for level, gaussians in (("fine", bake.gaussians), ("coarse", bake.coarse)):
        for field in ("position", "rotation", "scale", "opacity", "sh", "slope") if gaussians is not None else ():
            if field != "slope" or gaussians.sloped:
                (folder / f"{name}.gsgi.{level}.{field}").write_bytes(getattr(gaussians, field).tobytes())


def test_it_decodes_and_refuses_what_python_does(tmp_path):
    for name, data in FILES.items():
        write(tmp_path, name, data, codec.decode(data))
    strange = [changed(codec.encode(bake), field, value) for bake, field, value in NONSENSE]
    strange += [damaged for name in STORED for damaged in damaged_files(name, 100)]
    for number, data in enumerate(strange):
        bake = decoded(data)
        write(tmp_path, f"{'refused' if bake is None else 'damaged'}_{number}", data, bake)
    node("--test", TESTS / "runtime" / "js" / "decode.test.mjs", JS=JS, VECTORS=tmp_path)


def test_the_shaders_are_those_of_the_glsl_folder():
    node(JS / "build.mjs", "--check")
