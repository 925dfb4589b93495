"""Baked indirect light in Panda3D, for scenes that were loaded from the glTF file of the bake.

    from gsgi.runtime.panda3d import BakedLight

    light = BakedLight("room.gsgi", room)  # room: the NodePath from loader.load_model("room.glb")
    light.attach(base.cam)

Everything that the camera shows gets `scale * albedo * B`: in each of its display regions, wherever nodes and the room
itself move, blended surfaces too, with any lens. The frame must hold linear radiance, which is what simplepbr draws, or
a window with `framebuffer-srgb true`: UnsupportedError says so if it does not. Panda3D 1.10 with GLSL 3.30 is needed.

The albedo is the base colour of Panda3D's material, its texture, vertex colours and colour scale, of metals only if the
bake has their light. Where the file says how, light follows Panda3D's normal maps, at the scale 1 as panda3d-gltf has
them, on vertices with tangents. A node with the tag gsgi=off, such as a sky, gets no light and still hides what is
behind it.

Each camera draws its nodes a second time, at the size of its display region, and reads B by the function of
`gsgi.IndirectLookup`: so the bake must be of the `surface` operator. Fog does not dim the light.

The extra `gsgi[panda3d]` installs panda3d, and panda3d-gltf, its usual reader of glTF.
"""

from .baked_light import BakedLight

__all__ = ["BakedLight"]
