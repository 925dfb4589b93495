"""Values of pyrender.RenderFlags."""

from enum import IntFlag


class RenderFlags(IntFlag):
    """Options of `render`, combined by `|`. Names and values are pyrender's; OFFSCREEN and ALL_SOLID have no effect."""

    NONE = 0
    DEPTH_ONLY = 1
    OFFSCREEN = 2
    FLIP_WIREFRAME = 4
    ALL_WIREFRAME = 8
    ALL_SOLID = 16
    SHADOWS_DIRECTIONAL = 32
    SHADOWS_POINT = 64
    SHADOWS_SPOT = 128
    SHADOWS_ALL = 224
    VERTEX_NORMALS = 256
    FACE_NORMALS = 512
    SKIP_CULL_FACES = 1024
    RGBA = 2048
    FLAT = 4096
    SEG = 8192


UNLIT = RenderFlags.DEPTH_ONLY | RenderFlags.FLAT | RenderFlags.SEG
NORMALS = RenderFlags.VERTEX_NORMALS | RenderFlags.FACE_NORMALS
