/* What a look-up holds. */
#ifndef GSGI_LOOKUP_H
#define GSGI_LOOKUP_H

#include "internal.h"

struct gsgi_lookup {
    gsgi_callbacks callbacks;
    gsgi_lookup_info info; /* without pointers */
    char* source;
    uint32_t crc; /* of the file */
    float* gaussians;
    uint32_t* cells;
    void* lists; /* of info.list_bits each */
};

#endif
