// Converts records of gsgi.runtime to those of the kernels, and the shape of SH to its degree.
#pragma once

#include "arrays.h"
#include "over/records.h"

// Converts a gsgi.runtime.camera.Pinhole.
Camera camera_from(nb::handle pinhole);

// Converts a gsgi.runtime.gaussians.OverBlend.
Blend blend_from(nb::handle blend);

// The SH degree that has this number of coefficients; throws TypeError if there is none.
int degree_of(size_t coefficients);
