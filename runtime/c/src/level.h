/* A level of a .gsgi file. */
#ifndef GSGI_LEVEL_H
#define GSGI_LEVEL_H

#include "header.h"
#include "integers.h"

/* Room for `count` Gaussians of so many floats; the rest of the last row is 0. Returns false if there is no memory. */
bool gsgi__allocate_texels(gsgi__texels* data, const gsgi_callbacks* callbacks, uint32_t count, uint32_t floats);

/* The fewest bytes that the streams of a level take. */
uint64_t gsgi__least_level_bytes(const gsgi__level_header* record);

/* Decode the streams of a level, which take the section at `reader`; `record` is checked. The textures of `level` are
 * the caller's to release, also after an error. */
gsgi_result gsgi__decode_level(gsgi__level* level, const gsgi__level_header* record, gsgi__reader* reader);

/* Decode the streams of a light group to the sh and slope of `level`, whose other fields and textures are those of the
 * level that `record` describes, but for the steps. */
gsgi_result gsgi__decode_group_light(gsgi__level* level, const gsgi__level_header* record, gsgi__reader* reader);

/* Decode the section of relief at `reader` to that of the fine level, which has its sh. */
gsgi_result gsgi__decode_relief(gsgi__level* level, gsgi__reader* reader);

#endif
