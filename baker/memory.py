"""How much memory a bake takes at its peak, from the numbers of what it holds."""

from gsgi.runtime.scene import Scene

# Bytes, from `./dev bench scenes`: libraries and compiled kernels; geometry as arrays, tables and two ray casters'
# trees; decoded textures and the path tracer's copy; images of a view, traced, denoised and as the fit's target;
# a Gaussian with its gradients and moments.
PROCESS = 1_000_000_000
PER_TRIANGLE = 700
PER_TEXEL = 12
PER_PIXEL = 80
PER_GAUSSIAN = 600


def peak_memory(scene: Scene, pixels: int, gaussians: int) -> int:
    """Expected peak of the resident memory of a bake with `pixels` in all its views, bytes."""
    triangles = sum(len(mesh.triangle) for mesh in scene.meshes)
    texels = sum(texture.pixels.size // 4 for texture in scene.textures)
    held = PER_TRIANGLE * triangles + PER_TEXEL * texels
    return PROCESS + held + PER_PIXEL * pixels + PER_GAUSSIAN * gaussians
