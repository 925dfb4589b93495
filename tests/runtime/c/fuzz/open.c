/* Opens untrusted bytes and reads all that a bake gives: for libFuzzer, or for main.c. */
#include "gsgi.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);
int open_and_read(const uint8_t* data, size_t size);

/* Returns 1 if the bytes were opened. */
int open_and_read(const uint8_t* data, size_t size) {
    gsgi_open_options options = {.struct_size = sizeof options, .sampling = 1};
    gsgi_info info = {.struct_size = sizeof info};
    gsgi_bake* bake;
    if (gsgi_bake_open(data, size, &options, &bake)) return 0;
    if (gsgi_bake_info(bake, &info)) abort();
    for (int level = 0; level < 2; ++level) {
        gsgi_texels texels = {.struct_size = sizeof texels};
        float sum = 0.0f;
        if (gsgi_bake_texels(bake, (gsgi_level)level, &texels)) abort();
        for (size_t i = 0; i < (size_t)texels.shape_rows * 2048 * 4; ++i) sum += texels.shape[i];
        for (size_t i = 0; i < (size_t)texels.sh_rows * 2048 * 4; ++i) sum += texels.sh[i];
        if (sum != sum && info.gaussian_count[level] == 0) abort();
    }
    if (info.group_count) {
        static float weights[3 * 255];
        for (uint32_t i = 0; i < 3 * info.group_count; ++i) weights[i] = (float)(i % 5);
        for (uint32_t i = 0; i < info.group_count; ++i)
            if (!gsgi_bake_group_name(bake, i)) abort();
        if (gsgi_bake_weigh(bake, info.group_count, weights)) abort();
    }
    gsgi_lookup* lookup;
    if (!gsgi_lookup_open(bake, &lookup)) {
        gsgi_lookup_info tables = {.struct_size = sizeof tables};
        if (gsgi_lookup_read(lookup, &tables) || tables.bytes == 0) abort();
        gsgi_lookup_close(lookup);
    } else if (info.blend == GSGI_SURFACE) {
        abort(); /* no file of this size has too many Gaussians */
    }
    if (info.blend == GSGI_SURFACE) {
        float positions[6], normals[6] = {0.0f, 1.0f, 0.0f, 0.0f, 0.0f, 1.0f}, light[6];
        for (int k = 0; k < 3; ++k) {
            positions[k] = (float)info.bounds_low[k];
            positions[3 + k] = (float)info.bounds_high[k];
        }
        if (gsgi_bake_sample(bake, 2, positions, normals, light)) abort();
        for (int i = 0; i < 6; ++i)
            if (!(light[i] >= 0.0f && light[i] <= 65504.0f)) abort();
    }
    gsgi_bake_close(bake);
    return 1;
}

/* Write the checksum that the file should have, past which no fuzzer comes by chance. */
static void reseal(uint8_t* data, size_t size) {
    uint32_t crc = 0xFFFFFFFFu;
    memset(data + 8, 0, 4);
    for (size_t i = 0; i < size; ++i) {
        crc ^= data[i];
        for (int bit = 0; bit < 8; ++bit) crc = (crc & 1) ? crc >> 1 ^ 0xEDB88320u : crc >> 1;
    }
    for (int k = 0; k < 4; ++k) data[8 + k] = (uint8_t)(~crc >> 8 * k);
}

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    open_and_read(data, size);
    uint8_t* sealed = malloc(size ? size : 1);
    if (!sealed) return 0;
    memcpy(sealed, data, size);
    if (size >= 12) reseal(sealed, size);
    open_and_read(sealed, size);
    free(sealed);
    return 0;
}
