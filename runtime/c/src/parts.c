/* What a light has of its bakes: one, or the sectors of a world that are in memory. */
#include "light.h"
#include "world.h"

#include <math.h>
#include <string.h>

/* The texels of positions that are moved by `shift`, m, which are the caller's to release; those of the level if that
 * is 0. NULL: no memory. */
static float* moved(const gsgi_callbacks* callbacks, const gsgi__level* level, const double shift[3]) {
    if (shift[0] == 0.0 && shift[1] == 0.0 && shift[2] == 0.0) return level->shape.texels;
    const size_t bytes = gsgi__texel_bytes(&level->shape);
    float* shape = gsgi__allocate(callbacks, bytes);
    if (!shape) return NULL;
    memcpy(shape, level->shape.texels, bytes);
    for (size_t i = 0; i < level->count; ++i)
        for (int k = 0; k < 3; ++k) {
            float* at = shape + i * GSGI_SHAPE_FLOATS + k;
            *at = (float)(*at + shift[k]);
        }
    return shape;
}

/* Data textures, instance buffer and vertex array of a level. */
static gsgi_result upload(const gsgi_light* light, const gsgi__level* level, bool relief, const double shift[3],
                          gsgi__gaussians* to) {
    const gsgi_context* context = light->context;
    const gsgi__gl* gl = &context->gl;
    const gsgi__texels none = {NULL, 0, 0};
    const gsgi__texels* texels[] = {&level->shape, &level->sh, &level->slope, relief ? &level->relief : &none};
    const gsgi__format floats = {GL_RGBA32F, GL_RGBA, GL_FLOAT};
    GLuint* textures[] = {&to->shape, &to->sh, &to->slope, &to->relief};
    for (int t = 0; t < 4; ++t)
        if (texels[t]->rows > (uint32_t)gl->texture_size_max)
            return gsgi__fail(&context->callbacks, GSGI_UNSUPPORTED,
                              "bake: %u Gaussians are more than this driver's textures hold", level->count);
    float* shape = moved(&context->callbacks, level, shift);
    if (!shape) return gsgi__fail(&context->callbacks, GSGI_OUT_OF_MEMORY, "light: no memory");
    for (int t = 0; t < 4; ++t)
        if (texels[t]->rows > 0)
            *textures[t] =
                gsgi__texture_of(gl, floats, GSGI_DATA_WIDTH, (int32_t)texels[t]->rows, t ? texels[t]->texels : shape);
    if (shape != level->shape.texels) gsgi__release(&context->callbacks, shape);
    gl->GenBuffers(1, &to->index);
    gl->GenVertexArrays(1, &to->strips);
    gl->BindVertexArray(to->strips);
    gl->BindBuffer(GL_ARRAY_BUFFER, to->index);
    gl->EnableVertexAttribArray(0);
    gl->VertexAttribIPointer(0, 1, GL_UNSIGNED_INT, 0, NULL);
    gl->VertexAttribDivisor(0, 1);
    return GSGI_OK;
}

gsgi_result gsgi__part_create(gsgi_light* light, const gsgi_bake* bake, bool relief, gsgi__part** out) {
    const gsgi_callbacks* callbacks = &light->context->callbacks;
    gsgi_result result = GSGI_OK;
    double shift[3];
    gsgi__part* part = gsgi__allocate(callbacks, sizeof *part);
    if (!part) return gsgi__fail(callbacks, GSGI_OUT_OF_MEMORY, "light: no memory");
    memset(part, 0, sizeof *part);
    part->bytes = bake->info.light_bytes + (relief ? gsgi__texel_bytes(&bake->levels[GSGI_FINE].relief) : 0);
    for (int k = 0; k < 3; ++k) shift[k] = bake->origin[k] - light->origin[k];
    for (int l = 0; l < 2 && !result; ++l) {
        const gsgi__level* level = &bake->levels[l];
        gsgi__gaussians* to = &part->levels[l];
        if (!gsgi__culled_create(&part->culled[l], callbacks, level, &bake->info, shift))
            result = gsgi__fail(callbacks, GSGI_OUT_OF_MEMORY, "light: no memory");
        if (result || level->count == 0) continue;
        if ((result = upload(light, level, relief, shift, to))) continue;
        if (light->info.blend == GSGI_OVER)
            result = gsgi__over_program(light, &to->program);
        else /* a coarse level has the light of all normals, so it needs the bent ones of all parts */
            result =
                gsgi__surface_program(light, &bake->info, l, l == GSGI_FINE ? relief : light->relief, &to->program);
    }
    if (result)
        gsgi__part_destroy(light->context, part);
    else
        *out = part;
    return result;
}

void gsgi__part_destroy(const gsgi_context* context, gsgi__part* part) {
    const gsgi__gl* gl = &context->gl;
    if (!part) return;
    for (int l = 0; l < 2; ++l) {
        const gsgi__gaussians* level = &part->levels[l];
        const GLuint textures[] = {level->shape, level->sh, level->slope, level->relief};
        if (!context->lost) {
            gl->DeleteTextures(4, textures);
            gl->DeleteBuffers(1, &level->index);
            gl->DeleteVertexArrays(1, &level->strips);
        }
        gsgi__culled_destroy(&part->culled[l], &context->callbacks);
    }
    gsgi__release(&context->callbacks, part);
}

void gsgi__cull_parts(gsgi_light* light) {
    for (uint32_t i = 0; i < light->part_count; ++i) {
        gsgi__part* part = light->parts[i];
        part->in_view = true;
        if (light->sectors) {
            float* b = part->ball;
            uint32_t index;
            gsgi__culled ball = {.count = 1, .x = &b[0], .y = &b[1], .z = &b[2], .radius = &b[3], .index = &index};
            gsgi__cull_pyramid(&ball, &light->camera);
            part->in_view = ball.visible && part->weight > 0.0f;
        }
        for (int l = 0; l < 2; ++l)
            if (!part->in_view)
                part->culled[l].visible = 0;
            else if (light->info.blend == GSGI_SURFACE)
                gsgi__cull_pyramid(&part->culled[l], &light->camera);
            else
                gsgi__cull_and_sort(&part->culled[l], &light->camera, &light->info);
    }
}

/* ---- Sectors ---- */

/* A ball around all that a sector lights: its Gaussians, cut by its box. The radius is NaN of nothing. */
static void find_ball(gsgi__part* part, float margin) {
    float low[3], high[3], squares = 0.0f;
    bool any = true;
    for (int k = 0; k < 3; ++k) {
        low[k] = INFINITY;
        high[k] = -INFINITY;
        for (int l = 0; l < 2; ++l) {
            const gsgi__culled* culled = &part->culled[l];
            const float* centers = k == 0 ? culled->x : k == 1 ? culled->y : culled->z;
            for (uint32_t i = 0; i < culled->count; ++i) {
                low[k] = fminf(low[k], centers[i] - culled->radius[i]);
                high[k] = fmaxf(high[k], centers[i] + culled->radius[i]);
            }
        }
        low[k] = fmaxf(low[k], part->low[k] - margin);
        high[k] = fminf(high[k], part->high[k] + margin);
        any = any && low[k] <= high[k];
        part->ball[k] = (low[k] + high[k]) / 2;
        squares += (high[k] - low[k]) * (high[k] - low[k]);
    }
    part->ball[3] = any ? sqrtf(squares) / 2 : NAN;
}

static gsgi_result create_sector(gsgi_light* light, const gsgi__sector* sector, gsgi__part** out) {
    const bool relief = light->relief && sector->bake->info.relief;
    gsgi_result result = gsgi__part_create(light, sector->bake, relief, out);
    if (result) return result;
    gsgi__part* part = *out;
    part->serial = sector->serial;
    part->class = sector->class;
    for (int k = 0; k < 3; ++k) {
        const bool low_ends = sector->fade_low[k] > -GSGI_FACE_FAR, high_ends = sector->fade_high[k] < GSGI_FACE_FAR;
        part->low[k] = (float)(low_ends ? sector->fade_low[k] - light->origin[k] : sector->fade_low[k]);
        part->high[k] = (float)(high_ends ? sector->fade_high[k] - light->origin[k] : sector->fade_high[k]);
    }
    find_ball(part, (float)light->margin);
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
    if (light->info.radius == 0.0f && world->radius > 0.0f) {
        light->info.radius = world->radius;
        light->info.cutoff = world->cutoff;
        light->info.sharpness = world->sharpness;
        light->info.weight_floor = world->weight_floor;
        gsgi__surface_set_floor(light);
    }
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
