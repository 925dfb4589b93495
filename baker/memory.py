"""Estimate the peak memory of a bake from the amount of data that it holds."""

from gsgi.runtime.scene import Scene

# Bytes, from `./dev bench scenes`.
PROCESS = 1_000_000_000  # libraries and compiled kernels
PER_TRIANGLE = 700  # arrays, tables and the trees of two ray casters
PER_TEXEL = 12  # decoded textures and the path tracer's copy
PER_PIXEL = 80  # the images of a view: traced, denoised and as the target of the fit
PER_GAUSSIAN = 600  # with its gradients and moments


def peak_memory(scene: Scene, pixels: int, gaussians: int) -> int:
    """Expected peak of a bake's resident memory, bytes. `pixels` are those of all its views, or its surface samples."""
    triangles = sum(len(mesh.triangle) for mesh in scene.meshes)
    texels = sum(texture.pixels.size // 4 for texture in scene.textures)
    held = PER_TRIANGLE * triangles + PER_TEXEL * texels
    return PROCESS + held + PER_PIXEL * pixels + PER_GAUSSIAN * gaussians
