/* Worlds: which sectors are to be in memory around an eye, and their light at points. */
#include "world.h"
#include "lookup.h"
#include "sha256.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* As runtime/world/world.py has them, with their reasons. */
#define BUDGET ((uint64_t)256 << 20) /* bytes */
#define FADE 1.5f                    /* s */
#define POWER 2.4
#define STEP_MOST (1.0 / 72.0)
#define KEPT 0.9

gsgi_result gsgi_world_open(const void* manifest, size_t size, const gsgi_world_options* given, gsgi_world** out) {
    gsgi_world_options options;
    gsgi_result result = gsgi__read_options(given, &options, sizeof options);
    if (result) return result;
    const gsgi_callbacks* callbacks = &options.callbacks;
    if (!out || !manifest) return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT, "manifest, world: must not be NULL");
    if (options.budget == 0) options.budget = BUDGET;
    if (options.fade == 0.0f) options.fade = FADE;
    if (!(options.fade > 0.0f)) return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT, "fade: expected more than 0 s");

    gsgi_world* world = gsgi__allocate(callbacks, sizeof *world);
    if (!world) return gsgi__fail(callbacks, GSGI_OUT_OF_MEMORY, "manifest: no memory for a world");
    memset(world, 0, sizeof *world);
    world->callbacks = *callbacks;
    world->budget = options.budget;
    world->fade = options.fade;
    world->asked = -1;
    result = gsgi__read_manifest(world, manifest, size);
    for (uint32_t i = 0; i < world->sector_count && !result; ++i)
        if (world->sectors[i].memory > world->budget)
            result =
                gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT, "budget: expected at least %llu bytes for %s, got %llu",
                           (unsigned long long)world->sectors[i].memory, world->sectors[i].file,
                           (unsigned long long)world->budget);
    if (!result) {
        world->resident = gsgi__allocate(callbacks, world->sector_count * sizeof *world->resident);
        world->order = gsgi__allocate(callbacks, world->sector_count * sizeof *world->order);
        if (!world->resident || !world->order)
            result =
                gsgi__fail(callbacks, GSGI_OUT_OF_MEMORY, "manifest: no memory for %u sectors", world->sector_count);
    }
    if (result) {
        gsgi_world_close(world);
        return result;
    }
    gsgi__divide(world, world->resident);
    *out = world;
    return GSGI_OK;
}

void gsgi_world_close(gsgi_world* world) {
    if (!world) return;
    const gsgi_callbacks callbacks = world->callbacks;
    for (uint32_t i = 0; i < world->sector_count && world->sectors; ++i) gsgi_bake_close(world->sectors[i].bake);
    gsgi__release(&callbacks, world->sectors);
    gsgi__release(&callbacks, world->resident);
    gsgi__release(&callbacks, world->order);
    gsgi__release(&callbacks, world);
}

gsgi_result gsgi_world_read_info(const gsgi_world* world, gsgi_world_info* info) {
    const gsgi_world_info found = {sizeof found,  world->sector_count, world->resident_count,
                                   world->scene,  world->effects,      world->changing,
                                   world->margin, world->budget,       world->memory};
    return gsgi__write_struct(&found, sizeof found, info);
}

/* Log that a number is none of a sector. */
static gsgi_result check_number(const gsgi_world* world, uint32_t number, const gsgi_callbacks* callbacks) {
    if (number < world->sector_count) return GSGI_OK;
    return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT, "number: %u is none of 0 to %u", number,
                      world->sector_count - 1);
}

gsgi_result gsgi_world_read_sector(const gsgi_world* world, uint32_t number, gsgi_sector* to) {
    const gsgi_result result = check_number(world, number, &world->callbacks);
    if (result) return result;
    const gsgi__sector* sector = &world->sectors[number];
    gsgi_sector found = {.struct_size = sizeof found,
                         .file = sector->file,
                         .bytes = sector->bytes,
                         .memory = sector->memory,
                         .bake = sector->bake,
                         .weight = sector->weight};
    memcpy(found.low, sector->low, sizeof found.low);
    memcpy(found.high, sector->high, sizeof found.high);
    return gsgi__write_struct(&found, sizeof found, to);
}

/* ---- Sectors come and go ---- */

/* Bytes of the arrays of Gaussians as Python counts them, by which budgets mean the same in both. */
static uint64_t memory_of(const gsgi_bake* bake) {
    uint64_t floats = 0;
    for (int l = 0; l < 2; ++l) {
        const gsgi__level* level = &bake->levels[l];
        const uint64_t coefficients = (uint64_t)(level->sh_degree + 1) * (level->sh_degree + 1);
        floats += level->count * (11 + 3 * coefficients + (level->sloped ? 2 : 0) + (level->relief.rows ? 9 : 0));
    }
    return floats * sizeof(float);
}

/* Make what lights read of a sector, so that a frame has but to upload it. */
static gsgi_result prepare(const gsgi_world* world, gsgi_bake* bake) {
    double origin[3];
    gsgi__world_origin(world, origin);
    bake->in_world = true;
    return gsgi__lookup_prepare(bake, origin);
}

gsgi_result gsgi_world_open_sector(const gsgi_world* world, uint32_t number, const void* data, size_t size,
                                   const gsgi_open_options* given, gsgi_bake** out) {
    gsgi_open_options options;
    uint8_t digest[32];
    gsgi_bake* bake;
    gsgi_result result = gsgi__read_options(given, &options, sizeof options);
    if (result) return result;
    const gsgi_callbacks* callbacks = &options.callbacks;
    if (!out || (!data && size)) return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT, "data, bake: must not be NULL");
    if ((result = check_number(world, number, callbacks))) return result;
    const gsgi__sector* sector = &world->sectors[number];
    if (size != sector->bytes)
        return gsgi__fail(callbacks, GSGI_INVALID_FILE, "%s: bytes: expected %llu, as the manifest says, got %llu",
                          sector->file, (unsigned long long)sector->bytes, (unsigned long long)size);
    gsgi__sha256(data, size, digest);
    if (memcmp(digest, sector->sha256, sizeof digest) != 0)
        return gsgi__fail(callbacks, GSGI_INVALID_FILE, "%s: sha256: expected the one that the manifest says",
                          sector->file);
    options.lists = 0; /* a sector's are from the world's origin */
    if ((result = gsgi_bake_open(data, size, &options, &bake))) return result;
    if (bake->info.blend != GSGI_SURFACE)
        result = gsgi__fail(callbacks, GSGI_INVALID_FILE,
                            "%s: operator: expected surface, as all sectors of a world have, got over", sector->file);
    else if (memory_of(bake) != sector->memory)
        result = gsgi__fail(callbacks, GSGI_INVALID_FILE, "%s: memory: expected %llu, as the manifest says, got %llu",
                            sector->file, (unsigned long long)sector->memory, (unsigned long long)memory_of(bake));
    if (!result) result = prepare(world, bake);
    if (result)
        gsgi_bake_close(bake);
    else
        *out = bake;
    return result;
}

gsgi_result gsgi_world_add(gsgi_world* world, uint32_t number, gsgi_bake* bake) {
    const gsgi_result result = check_number(world, number, &world->callbacks);
    if (result) return result;
    gsgi__sector* sector = &world->sectors[number];
    if (world->asked != (int32_t)number)
        return gsgi__fail(&world->callbacks, GSGI_INVALID_ARGUMENT, "number: sector %u was not asked for", number);
    if (bake && (!bake->in_world || memory_of(bake) != sector->memory))
        return gsgi__fail(&world->callbacks, GSGI_INVALID_ARGUMENT, "bake: not one that gsgi_world_open_sector gave");
    if (bake && world->radius > 0.0f &&
        (bake->info.cutoff != world->cutoff || bake->info.sharpness != world->sharpness ||
         bake->info.weight_floor != world->weight_floor))
        return gsgi__fail(&world->callbacks, GSGI_INVALID_FILE, "%s: expected the blend of other sectors",
                          sector->file);
    world->asked = -1;
    sector->broken = bake == NULL;
    if (!bake) return GSGI_OK;
    world->cutoff = bake->info.cutoff;
    world->sharpness = bake->info.sharpness;
    world->weight_floor = bake->info.weight_floor;
    world->radius = bake->info.radius;
    sector->bake = bake;
    sector->serial = ++world->serial;
    sector->clock = 0.0;
    sector->weight = 0.0f;
    world->resident[world->resident_count++] = number;
    world->memory += sector->memory;
    return GSGI_OK;
}

static bool is_farther(const gsgi__distance* a, const gsgi__distance* b) {
    return a->distance > b->distance || (a->distance == b->distance && a->number > b->number);
}

/* Let the entry at `i` sink to its place in the heap of `count`, whose farthest is first. */
static void sink(gsgi__distance* heap, size_t count, size_t i) {
    for (size_t child; (child = 2 * i + 1) < count; i = child) {
        if (child + 1 < count && is_farther(&heap[child + 1], &heap[child])) ++child;
        if (!is_farther(&heap[child], &heap[i])) return;
        const gsgi__distance moved = heap[i];
        heap[i] = heap[child];
        heap[child] = moved;
    }
}

static void sort_by_distance(gsgi__distance* order, size_t count) {
    for (size_t i = count / 2; i-- > 0;) sink(order, count, i);
    for (size_t end = count; end-- > 1;) {
        const gsgi__distance farthest = order[0];
        order[0] = order[end];
        order[end] = farthest;
        sink(order, end, 0);
    }
}

/* Distance of a box from the eye. Several are at distance 0 where that is on a border: then their middles decide. */
static double distance_of(const gsgi__sector* sector, const float eye[3]) {
    double outside = 0.0, middle = 0.0;
    for (int k = 0; k < 3; ++k) {
        const double before = sector->low[k] - eye[k], behind = eye[k] - sector->high[k];
        const double out = fmax(fmax(before, behind), 0.0), off = (sector->low[k] + sector->high[k]) / 2 - eye[k];
        outside += out * out;
        middle += off * off;
    }
    const double distance = sqrt(outside) + 1e-3 * sqrt(middle);
    return sector->bake ? KEPT * distance : distance;
}

/* Mark the sectors that are to be in memory: the nearest, as many as the budget holds. They come first in `order`, by
 * distance; returns how many they are. */
static uint32_t find_wanted(gsgi_world* world, const float eye[3]) {
    uint32_t count = 0, wanted = 0;
    uint64_t memory = 0;
    for (uint32_t i = 0; i < world->sector_count; ++i) {
        gsgi__sector* sector = &world->sectors[i];
        sector->wanted = false;
        if (!sector->broken) world->order[count++] = (gsgi__distance){distance_of(sector, eye), i};
    }
    sort_by_distance(world->order, count);
    for (; wanted < count; ++wanted) {
        gsgi__sector* sector = &world->sectors[world->order[wanted].number];
        memory += sector->memory;
        if (memory > world->budget) break;
        sector->wanted = true;
    }
    return wanted;
}

gsgi_result gsgi_world_update(gsgi_world* world, const float eye[3], double seconds, int32_t* load) {
    if (!eye || !load) return gsgi__fail(&world->callbacks, GSGI_INVALID_ARGUMENT, "eye, load: must not be NULL");
    if (!(seconds >= 0.0) || !(isfinite(eye[0]) && isfinite(eye[1]) && isfinite(eye[2])))
        return gsgi__fail(&world->callbacks, GSGI_INVALID_ARGUMENT,
                          "eye, seconds: needed are numbers, and time passes");
    const uint32_t wanted = find_wanted(world, eye);
    const double step = isinf(seconds) ? 1.0 : fmin(seconds / world->fade, STEP_MOST);
    uint32_t kept = 0;
    world->changing = false;
    for (uint32_t i = 0; i < world->resident_count; ++i) {
        gsgi__sector* sector = &world->sectors[world->resident[i]];
        const double clock = fmin(fmax(sector->clock + (sector->wanted ? step : -step), 0.0), 1.0);
        if (clock != sector->clock) world->changing = true;
        sector->clock = clock;
        sector->weight = (float)pow(clock, POWER);
        if (clock > 0.0 || sector->wanted) {
            world->resident[kept++] = world->resident[i];
            continue;
        }
        gsgi_bake_close(sector->bake);
        sector->bake = NULL;
        world->memory -= sector->memory;
    }
    world->resident_count = kept;
    *load = -1;
    if (world->asked < 0) {
        uint32_t first = 0;
        while (first < wanted && world->sectors[world->order[first].number].bake) ++first;
        const uint32_t number = first < wanted ? world->order[first].number : 0;
        if (first < wanted && world->sectors[number].memory <= world->budget - world->memory)
            *load = world->asked = (int32_t)number;
    }
    world->changing = world->changing || world->asked >= 0;
    return GSGI_OK;
}

/* ---- B at points ---- */

typedef gsgi_result (*sampler)(const gsgi_bake*, size_t, const float*, const float*, float*);

static gsgi_result sample(const gsgi_world* world, sampler sampled, size_t count, const float* positions,
                          const float* normals, float* light) {
    if (count && (!positions || !normals || !light))
        return gsgi__fail(&world->callbacks, GSGI_INVALID_ARGUMENT, "positions, normals, light: must not be NULL");
    for (size_t p = 0; p < count; ++p) {
        float sum[3] = {0.0f, 0.0f, 0.0f}, total = 0.0f;
        for (uint32_t i = 0; i < world->resident_count; ++i) {
            const gsgi__sector* sector = &world->sectors[world->resident[i]];
            float own[3];
            const float window = sector->weight * gsgi__window(sector, world->margin, positions + 3 * p);
            if (!(window > 0.0f)) continue;
            sampled(sector->bake, 1, positions + 3 * p, normals + 3 * p, own);
            for (int c = 0; c < 3; ++c) sum[c] += window * own[c];
            total += window;
        }
        /* Around a box that is left out windows add up to more than 1. */
        for (int c = 0; c < 3; ++c) light[3 * p + c] = sum[c] / fmaxf(total, 1.0f);
    }
    return GSGI_OK;
}

gsgi_result gsgi_world_sample(const gsgi_world* world, size_t count, const float* positions, const float* normals,
                              float* light) {
    return sample(world, gsgi_bake_sample, count, positions, normals, light);
}

gsgi_result gsgi_world_sample_free(const gsgi_world* world, size_t count, const float* positions, const float* normals,
                                   float* light) {
    return sample(world, gsgi_bake_sample_free, count, positions, normals, light);
}
