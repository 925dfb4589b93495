// Records of gsgi.runtime as the kernels take them.
#pragma once

#include "arrays.h"
#include "over/records.h"

// A gsgi.runtime.camera.Pinhole.
Camera camera_from(nb::handle pinhole);

// A gsgi.runtime.gaussians.Blend.
Blend blend_from(nb::handle blend);

// The SH degree of K coefficients; throws TypeError where there is none.
int degree_of(size_t coefficients);
