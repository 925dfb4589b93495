/* The light groups of a .gsgi file. */
#ifndef GSGI_GROUPS_H
#define GSGI_GROUPS_H

#include "header.h"

/* Decode the `count` groups of a file whose levels `bake` has, from byte `at` on, where a section begins. */
gsgi_result gsgi__decode_groups(gsgi_bake* bake, const gsgi__header* h, const uint8_t* data, size_t at, uint32_t count);

/* Memory that the groups take. */
size_t gsgi__group_bytes(const gsgi_bake* bake);
void gsgi__groups_release(gsgi_bake* bake);

#endif
