/* What a light has of its bakes: one, or the sectors of a world that are in memory. */
#include "light.h"
#include "lookup.h"
#include "world.h"

#include <math.h>
#include <string.h>

/* Data textures, instance buffer and vertex array of a bake of the `over` operator. */
static gsgi_result upload_gaussians(gsgi_light* light, const gsgi_bake* bake, gsgi__part* part) {
    const gsgi_context* context = light->context;
    const gsgi__gl* gl = &context->gl;
    const gsgi__level* level = &bake->levels[GSGI_FINE];
    const gsgi__texels* texels[] = {&level->shape, &level->sh};
    const gsgi__format floats = {GL_RGBA32F, GL_RGBA, GL_FLOAT};
    GLuint* textures[] = {&part->shape, &part->sh};
    if (!gsgi__culled_create(&part->culled, &context->callbacks, level, &bake->info))
        return gsgi__fail(&context->callbacks, GSGI_OUT_OF_MEMORY, "light: no memory");
    part->bytes = bake->info.light_bytes;
    if (level->count == 0) return GSGI_OK;
    for (int t = 0; t < 2; ++t)
        if (texels[t]->rows > (uint32_t)gl->texture_size_max)
            return gsgi__fail(&context->callbacks, GSGI_UNSUPPORTED,
                              "bake: %u Gaussians are more than this driver's textures hold", level->count);
    for (int t = 0; t < 2; ++t)
        *textures[t] = gsgi__texture_of(gl, floats, GSGI_DATA_WIDTH, (int32_t)texels[t]->rows, texels[t]->texels);
    gl->GenBuffers(1, &part->index);
    gl->GenVertexArrays(1, &part->strips);
    gl->BindVertexArray(part->strips);
    gl->BindBuffer(GL_ARRAY_BUFFER, part->index);
    gl->EnableVertexAttribArray(0);
    gl->VertexAttribIPointer(0, 1, GL_UNSIGNED_INT, 0, NULL);
    gl->VertexAttribDivisor(0, 1);
    return gsgi__over_program(light, &part->program);
}

/* The textures of a look-up. */
static gsgi_result upload_lookup(gsgi_light* light, const gsgi_lookup* lookup, gsgi__part* part) {
    const gsgi_result result = gsgi__lookup_textures(light->context, lookup, part->tables);
    part->bytes = lookup->info.bytes;
    return result ? result : gsgi__surface_program(light, lookup, &part->program);
}

/* The same, of a bake that has none yet; its texels are kept where they can be recoloured. */
static gsgi_result upload_new_lookup(gsgi_light* light, const gsgi_bake* bake, gsgi__part* part) {
    gsgi_lookup* lookup;
    gsgi_result result = gsgi__lookup_create(&light->context->callbacks, bake, light->origin, light->relief, &lookup);
    if (result) return result;
    result = upload_lookup(light, lookup, part);
    if (bake->info.group_count > 0) {
        gsgi__lookup_keep_gaussians(lookup);
        part->lookup = lookup;
    } else {
        gsgi_lookup_close(lookup);
    }
    return result;
}

gsgi_result gsgi__part_create(gsgi_light* light, const gsgi_bake* bake, gsgi__part** out) {
    const gsgi_callbacks* callbacks = &light->context->callbacks;
    gsgi__part* part = gsgi__allocate(callbacks, sizeof *part);
    if (!part) return gsgi__fail(callbacks, GSGI_OUT_OF_MEMORY, "light: no memory");
    memset(part, 0, sizeof *part);
    memcpy(part->drawn, bake->info.gaussian_count, sizeof part->drawn);
    const bool prepared = bake->lookup && bake->in_world == light->sectors; /* for the light's origin */
    const gsgi_result result = light->info.blend == GSGI_OVER ? upload_gaussians(light, bake, part)
                               : prepared                     ? upload_lookup(light, bake->lookup, part)
                                                              : upload_new_lookup(light, bake, part);
    if (result)
        gsgi__part_destroy(light->context, part);
    else
        *out = part;
    return result;
}

void gsgi__part_destroy(const gsgi_context* context, gsgi__part* part) {
    const gsgi__gl* gl = &context->gl;
    if (!part) return;
    if (!context->lost) {
        gl->DeleteTextures(2, (GLuint[2]){part->shape, part->sh}); /* 0 is ignored */
        gl->DeleteBuffers(1, &part->index);
        gl->DeleteVertexArrays(1, &part->strips);
        gl->DeleteTextures(3, part->tables);
    }
    gsgi__culled_destroy(&part->culled, &context->callbacks);
    gsgi_lookup_close(part->lookup);
    gsgi__release(&context->callbacks, part);
}

void gsgi__cull_parts(gsgi_light* light) {
    for (uint32_t i = 0; i < light->part_count; ++i) {
        gsgi__part* part = light->parts[i];
        part->in_view = !light->sectors || (part->weight > 0.0f && gsgi__in_view(&light->camera, part->ball));
        if (light->info.blend == GSGI_SURFACE) continue;
        gsgi__cull_and_sort(&part->culled, &light->camera, &light->info);
        part->drawn[GSGI_FINE] = part->culled.visible;
    }
}

/* ---- Sectors ---- */

/* A ball around all that a sector lights: its Gaussians, cut by its box. The radius is NaN of nothing. */
static void find_ball(const gsgi_light* light, const gsgi_bake* bake, gsgi__part* part) {
    const float margin = (float)light->margin;
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, squares = 0.0f;
    bool any = true;
    for (int l = 0; l < 2; ++l)
        for (size_t i = 0; i < bake->levels[l].count; ++i) {
            const float *shape = bake->levels[l].shape.texels + i * GSGI_SHAPE_FLOATS, *scale = shape + 8;
            const float reach = bake->info.radius * fmaxf(scale[0], fmaxf(scale[1], scale[2]));
            for (int k = 0; k < 3; ++k) {
                const float center = (float)(shape[k] + (bake->origin[k] - light->origin[k]));
                low[k] = fminf(low[k], center - reach);
                high[k] = fmaxf(high[k], center + reach);
            }
        }
    for (int k = 0; k < 3; ++k) {
        low[k] = fmaxf(low[k], part->low[k] - margin);
        high[k] = fminf(high[k], part->high[k] + margin);
        any = any && low[k] <= high[k];
        part->ball[k] = (low[k] + high[k]) / 2;
        squares += (high[k] - low[k]) * (high[k] - low[k]);
    }
    part->ball[3] = any ? sqrtf(squares) / 2 : NAN;
}

static gsgi_result create_sector(gsgi_light* light, const gsgi__sector* sector, gsgi__part** out) {
    gsgi_result result = gsgi__part_create(light, sector->bake, out);
    if (result) return result;
    gsgi__part* part = *out;
    part->serial = sector->serial;
    part->class = sector->class;
    for (int k = 0; k < 3; ++k) {
        const bool low_ends = sector->fade_low[k] > -GSGI_FACE_FAR, high_ends = sector->fade_high[k] < GSGI_FACE_FAR;
        part->low[k] = (float)(low_ends ? sector->fade_low[k] - light->origin[k] : sector->fade_low[k]);
        part->high[k] = (float)(high_ends ? sector->fade_high[k] - light->origin[k] : sector->fade_high[k]);
    }
    find_ball(light, sector->bake, part);
    return GSGI_OK;
}

static gsgi__part* part_of(const gsgi_light* light, uint32_t serial) {
    for (uint32_t i = 0; i < light->part_count; ++i)
        if (light->parts[i]->serial == serial) return light->parts[i];
    return NULL;
}

static bool is_followed(const gsgi_light* light, const gsgi_world* world) {
    bool same = light->part_count == world->resident_count;
    for (uint32_t i = 0; i < light->part_count && same; ++i)
        same = light->parts[i]->serial == world->sectors[world->resident[i]].serial;
    return same;
}

/* Make the parts those of the sectors in memory; those of both have the same serial number. */
static gsgi_result replace_parts(gsgi_light* light, const gsgi_world* world) {
    const gsgi_context* context = light->context;
    const gsgi_callbacks* callbacks = &context->callbacks;
    const uint32_t count = world->resident_count, room = count ? count : 1;
    gsgi_result result = GSGI_OK;
    gsgi__part** parts = gsgi__allocate(callbacks, room * sizeof *parts);
    float* rows = gsgi__allocate(callbacks, room * 8 * sizeof *rows);
    uint32_t done = 0;
    if (!parts || !rows) result = gsgi__fail(callbacks, GSGI_OUT_OF_MEMORY, "light: no memory");
    for (; done < count && !result; ++done) {
        const gsgi__sector* sector = &world->sectors[world->resident[done]];
        parts[done] = part_of(light, sector->serial);
        if (!parts[done]) result = create_sector(light, sector, &parts[done]);
    }
    const gsgi_result memory = gsgi__check_memory(context);
    if (!result) result = memory;
    for (uint32_t i = 0; i < done && result; ++i)
        if (parts[i] && !part_of(light, parts[i]->serial)) gsgi__part_destroy(context, parts[i]);
    if (result) {
        gsgi__release(callbacks, parts);
        gsgi__release(callbacks, rows);
        return result;
    }
    for (uint32_t i = 0; i < light->part_count; ++i) {
        bool kept = false;
        for (uint32_t k = 0; k < count && !kept; ++k) kept = parts[k] == light->parts[i];
        if (!kept) gsgi__part_destroy(context, light->parts[i]);
    }
    gsgi__release(callbacks, light->parts);
    gsgi__release(callbacks, light->rows);
    context->gl.DeleteTextures(1, &light->table);
    light->parts = parts;
    light->rows = rows;
    light->part_count = count;
    light->table = 0;
    return GSGI_OK;
}

/* Tell the passes where each sector has light, and how much. */
static void write_table(gsgi_light* light) {
    const gsgi__gl* gl = &light->context->gl;
    const gsgi__format floats = {GL_RGBA32F, GL_RGBA, GL_FLOAT};
    bool changed = light->table == 0;
    for (uint32_t i = 0; i < light->part_count; ++i) {
        const gsgi__part* p = light->parts[i];
        const float row[8] = {p->low[0],  p->low[1],  p->low[2],  p->weight,
                              p->high[0], p->high[1], p->high[2], (float)p->class};
        changed = changed || memcmp(light->rows + 8 * i, row, sizeof row) != 0;
        memcpy(light->rows + 8 * i, row, sizeof row);
    }
    if (!changed || light->part_count == 0) return;
    gl->DeleteTextures(1, &light->table);
    light->table = gsgi__texture_of(gl, floats, 2, (int32_t)light->part_count, light->rows);
}

gsgi_result gsgi_light_follow(gsgi_light* light, const gsgi_world* world) {
    const gsgi_context* context = light->context;
    gsgi__state host;
    gsgi_result result = gsgi__check_context(context);
    if (result) return result;
    if (!world || !light->sectors)
        return gsgi__fail(&context->callbacks, GSGI_INVALID_ARGUMENT,
                          world ? "light: it was not made of a world" : "world: must not be NULL");
    gsgi__state_begin(&context->gl, context->state, &host);
    if (!is_followed(light, world)) {
        gsgi__drain_errors(context);
        result = replace_parts(light, world);
    }
    if (!result) {
        for (uint32_t i = 0; i < light->part_count; ++i)
            light->parts[i]->weight = world->sectors[world->resident[i]].weight;
        write_table(light);
    }
    gsgi__state_end(&context->gl, context->state, &host);
    return result;
}
