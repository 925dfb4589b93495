/* Opens untrusted bytes as the manifest of a world, and lets it ask for all of its sectors: for libFuzzer, or for
 * main.c. */
#include "gsgi.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);
int open_and_read(const uint8_t* data, size_t size);

/* Returns 1 if the bytes were opened. */
int open_and_read(const uint8_t* data, size_t size) {
    gsgi_world_options options = {.struct_size = sizeof options, .budget = UINT64_MAX};
    gsgi_world_info info = {.struct_size = sizeof info};
    const float eye[3] = {1.0f, 2.0f, 3.0f}, normal[3] = {0.0f, 1.0f, 0.0f};
    gsgi_world* world;
    if (gsgi_world_open(data, size, &options, &world)) return 0;
    if (gsgi_world_read_info(world, &info) || info.sector_count == 0 || !(info.margin > 0.0)) abort();
    for (uint32_t asked = 0; asked <= info.sector_count; ++asked) {
        gsgi_sector sector = {.struct_size = sizeof sector};
        int32_t load;
        float light[3];
        gsgi_bake* bake;
        if (gsgi_world_update(world, eye, INFINITY, &load)) abort();
        if ((load < 0) != (asked == info.sector_count)) abort(); /* each is asked for once */
        if (load < 0) break;
        if (gsgi_world_read_sector(world, (uint32_t)load, &sector) || !*sector.file || sector.bake) abort();
        if (strlen(sector.file) > 255 || sector.file[0] == '/' || strstr(sector.file, "..") == sector.file) abort();
        if (!gsgi_world_open_sector(world, (uint32_t)load, data, size, NULL, &bake)) abort();
        if (gsgi_world_add(world, (uint32_t)load, NULL)) abort();
        if (gsgi_world_sample(world, 1, eye, normal, light) || light[0] != 0.0f) abort();
    }
    gsgi_world_close(world);
    return 1;
}

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    open_and_read(data, size);
    return 0;
}
