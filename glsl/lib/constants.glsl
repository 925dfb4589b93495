// Constants that GLSL, C++ and Python share. Each is defined here and nowhere else.
// One per line: #define NAME literal  // unit; reason. Only literals, so that every language can parse the file.

// Splatting with the `over` operator (Kerbl et al. 2023; Zwicker et al. 2002, "EWA Splatting").
// The first three are defaults: each .gsgi file records the values with which it was fitted.
#define DILATION           0.3            // px^2; added to both projected variances: an EWA low-pass of about one pixel
#define ALPHA_MIN          0.00392156863  // 1/255; smaller contributions are skipped: an 8-bit pixel would not change
#define ALPHA_MAX          0.99           // keeps 1 - alpha, by which the backward pass divides, above 0
#define TRANSMITTANCE_MIN  0.0001         // (1 - ALPHA_MAX)^2; two opaque layers end a ray
#define FRUSTUM_CLAMP      1.3            // of tan(fov/2); limits the point of linearisation, against off-screen fans
#define FOOTPRINT_MAX      1e9            // px; larger and more distant footprints, and those thinner than its inverse,
                                          // are dropped: float32 could not hold their determinants
#define TILE_SIZE          16             // px; edge of a rasteriser tile: state of 256 pixels stays in the L1 cache

// Reading Gaussians at surfaces (`surface` operator): standard deviations beyond these are clamped to them.
#define SCALE_MIN  1e-12  // m; its inverse times any distance is finite in float32
#define SCALE_MAX  1e18   // m; its square is finite in float32

// Real spherical harmonics, orthonormal on the sphere, with the Condon-Shortley phase.
// Order of the coefficients (l, m): 0,0; 1,-1 1,0 1,1; ...
#define SH_C0    0.28209479177387814  // 1/2 sqrt(1/pi)
#define SH_C1    0.4886025119029199   // 1/2 sqrt(3/pi)
#define SH_C2_0  1.0925484305920792   // 1/2 sqrt(15/pi)
#define SH_C2_1  0.31539156525252005  // 1/4 sqrt(5/pi)
#define SH_C2_2  0.5462742152960396   // 1/4 sqrt(15/pi)
#define SH_C3_0  0.5900435899266435   // 1/4 sqrt(35/(2 pi))
#define SH_C3_1  2.890611442640554    // 1/2 sqrt(105/pi)
#define SH_C3_2  0.4570457994644658   // 1/4 sqrt(21/(2 pi))
#define SH_C3_3  0.3731763325901154   // 1/4 sqrt(7/pi)
#define SH_C3_4  1.445305721320277    // 1/4 sqrt(105/pi)

#define PI  3.141592653589793

// Punctual lights (KHR_lights_punctual, Khronos 2018).
#define SPOT_ANGLE_MIN  0.001    // cosine; minimum width of a spot's edge: keeps the division finite
#define HALF_MAX        65504.0  // radiance; largest finite half float: Inf in a 16F target would spread
#define DECAL_DEPTH 1e-5  // of the depth; a blended surface that little behind a solid one counts as before it

// Shadow maps: how far a receiver is moved before the depth comparison.
#define SHADOW_PCF_RADIUS      1.4142136  // texels; a 2x2 filter reaches this far across the diagonal
#define SHADOW_PULL            1.0        // texels towards the light; keeps walls of a corner from darkening each other
#define SHADOW_POSITION_ERROR  0.00001    // of the view depth; covers the rounding of positions reconstructed from it

// Display: tone curve "Khronos PBR Neutral" (Khronos 2024) after an exposure to mid-grey.
#define MID_GREY               0.18      // radiance; the exposure maps the log-average of an image to it
#define NEUTRAL_F90            0.04      // reflectance at normal incidence that the toe removes
#define NEUTRAL_START          0.8       // of display white; darker colours are only reduced, by up to NEUTRAL_F90
#define NEUTRAL_DESATURATION   0.15      // how fast highlights desaturate to white

// The fit's optimiser: Adam (Kingma and Ba 2015).
#define ADAM_BETA1    0.9    // decay of the mean gradient, per step
#define ADAM_BETA2    0.999  // decay of the mean squared gradient, per step
#define ADAM_EPSILON  1e-15  // far below any gradient of a mean over pixels; as in Kerbl et al. 2023
