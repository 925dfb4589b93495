/* What a look-up holds. */
#ifndef GSGI_LOOKUP_H
#define GSGI_LOOKUP_H

#include "internal.h"

#define GSGI_LOOKUP_DEFINES 128 /* bytes that the defines take */

struct gsgi_lookup {
    gsgi_callbacks callbacks;
    gsgi_lookup_info info; /* without pointers */
    char* source;          /* NULL: no host reads it */
    uint32_t crc;          /* of the file */
    uint32_t counts[3];    /* of a Gaussian: SH coefficients by level; texels with relief, 0 without */
    float* gaussians;
    uint32_t* cells;
    void* lists; /* of info.list_bits each */
};

/* The tables of a bake of the `surface` operator, without `source`, for points relative to `origin`, m. `relief`:
 * whether with that of the file. */
gsgi_result gsgi__lookup_create(const gsgi_callbacks* callbacks, const gsgi_bake* bake, const double origin[3],
                                bool relief, gsgi_lookup** lookup);

/* Bytes of its texels of Gaussians, without relief. */
size_t gsgi__lookup_least_bytes(const gsgi_bake* bake);

/* Those of glsl/surface/lookup.glsl. */
void gsgi__lookup_defines(const gsgi_lookup* lookup, char defines[GSGI_LOOKUP_DEFINES]);

/* Make those of a bake, with relief, which stay with it. */
gsgi_result gsgi__lookup_prepare(gsgi_bake* bake, const double origin[3]);

/* Free all but the texels of the Gaussians. */
void gsgi__lookup_keep_gaussians(gsgi_lookup* lookup);

/* Give `gaussians` the light that the bake of which the look-up was made has now. */
void gsgi__lookup_recolour(gsgi_lookup* lookup, const gsgi_bake* bake);

#endif
