/* Lights: what is made once, and the frame's calls. */
#include "light.h"
#include "lookup.h"
#include "shaders.h"
#include "world.h"

#include <stdio.h>
#include <string.h>

static gsgi_result check_options(const gsgi_light_options* o, const gsgi_callbacks* callbacks) {
    const struct {
        const char* name;
        int value, first, last;
    } fields[] = {{"depth", (int)o->depth, 0, GSGI_DEPTH_LINEAR},
                  {"normal", (int)o->normal, 0, GSGI_NORMAL_OCTAHEDRAL_UNSIGNED},
                  {"normal_space", (int)o->normal_space, 0, GSGI_SPACE_VIEW},
                  {"albedo", (int)o->albedo, 0, GSGI_ALBEDO_SRGB},
                  {"rows", (int)o->rows, 0, GSGI_ROWS_TOP_DOWN},
                  {"splat_scale", o->splat_scale, 1, 4}};
    for (size_t i = 0; i < sizeof fields / sizeof *fields; ++i)
        if (fields[i].value < fields[i].first || fields[i].value > fields[i].last)
            return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT, "%s: %d is none of %d to %d", fields[i].name,
                              fields[i].value, fields[i].first, fields[i].last);
    const float first = o->depth_range[0], last = o->depth_range[1];
    if (!(first >= 0.0f && first <= 1.0f && last >= 0.0f && last <= 1.0f && first != last))
        return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT,
                          "depth_range: needed are two different numbers from 0 to 1");
    for (int k = 0; k < 3; ++k)
        if (!(o->box_low[k] <= o->box_high[k]))
            return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT,
                              "box_low, box_high: needed are the lowest and the highest corner");
    return GSGI_OK;
}

/* The passes of a light, and the only part of one that is made of a bake. */
static gsgi_result create_on_gpu(gsgi_light* light, const gsgi_bake* bake) {
    const gsgi_context* context = light->context;
    char defines[64];
    gsgi_result result = GSGI_OK;
    if (bake) {
        result = gsgi__part_create(light, bake, &light->parts[0]);
        if (!result) light->part_count = 1;
    }
    if (!result && light->info.blend == GSGI_SURFACE) result = gsgi__surface_create(light);
    if (!result) {
        snprintf(defines, sizeof defines, "#define ALBEDO_SRGB %d\n", light->options.albedo == GSGI_ALBEDO_SRGB);
        result = gsgi__program_create(&context->gl, &context->callbacks, "surface/add_light",
                                      gsgi__shader_lib_fullscreen_vert, gsgi__shader_surface_add_light_frag, defines,
                                      &light->add_light);
    }
    return result;
}

/* A light without parts, with checked options. */
static gsgi_result create_empty(gsgi_context* context, const gsgi_light_options* given, gsgi_light** out) {
    const gsgi_callbacks* callbacks = &context->callbacks;
    gsgi_light_options options;
    gsgi_result result = gsgi__read_options(given, &options, sizeof options);
    if (result) return gsgi__fail(callbacks, result, "options: struct_size is not that of any version of this library");
    if (options.splat_scale == 0) options.splat_scale = 2;
    if (options.depth_range[0] == 0.0f && options.depth_range[1] == 0.0f) options.depth_range[1] = 1.0f;
    if ((result = gsgi__check_context(context)) || (result = check_options(&options, callbacks))) return result;
    gsgi_light* light = gsgi__allocate(callbacks, sizeof *light);
    if (!light) return gsgi__fail(callbacks, GSGI_OUT_OF_MEMORY, "light: no memory");
    memset(light, 0, sizeof *light);
    light->context = context;
    light->options = options;
    *out = light;
    return GSGI_OK;
}

/* Make the light's passes, and its part of a bake, which may be NULL; or destroy it. */
static gsgi_result complete(gsgi_light* light, const gsgi_bake* bake, gsgi_light** out) {
    const gsgi_context* context = light->context;
    gsgi__state host;
    gsgi__drain_errors(context);
    gsgi__state_begin(&context->gl, context->state, &host);
    gsgi_result result = create_on_gpu(light, bake);
    gsgi_result memory = gsgi__check_memory(context);
    if (!result) result = memory;
    gsgi__state_end(&context->gl, context->state, &host);
    if (result)
        gsgi_light_destroy(light);
    else
        *out = light;
    return result;
}

gsgi_result gsgi_light_create(gsgi_context* context, const gsgi_bake* bake, const gsgi_light_options* given,
                              gsgi_light** out) {
    const gsgi_callbacks* callbacks = &context->callbacks;
    gsgi_light* light;
    if (!bake || !out) return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT, "bake, light: must not be NULL");
    gsgi_result result = create_empty(context, given, &light);
    if (result) return result;
    if (bake->info.blend == GSGI_OVER && !context->gl.float_blend) {
        gsgi_light_destroy(light);
        return gsgi__fail(callbacks, GSGI_UNSUPPORTED, "context: GL_EXT_float_blend is needed by the operator over");
    }
    light->info = bake->info;
    light->relief = light->options.relief && bake->info.relief;
    memcpy(light->origin, bake->origin, sizeof light->origin);
    light->crc = bake->crc;
    if (!(light->parts = gsgi__allocate(callbacks, sizeof *light->parts))) {
        gsgi_light_destroy(light);
        return gsgi__fail(callbacks, GSGI_OUT_OF_MEMORY, "light: no memory");
    }
    return complete(light, bake, out);
}

gsgi_result gsgi_light_create_world(gsgi_context* context, const gsgi_world* world, const gsgi_light_options* given,
                                    gsgi_light** out) {
    gsgi_light* light;
    if (!world || !out) return gsgi__fail(&context->callbacks, GSGI_INVALID_ARGUMENT, "world, light: must not be NULL");
    gsgi_result result = create_empty(context, given, &light);
    if (result) return result;
    light->info.blend = GSGI_SURFACE;
    light->relief = light->options.relief && world->effects & GSGI_EFFECT_NORMAL_MAP;
    light->sectors = true;
    light->margin = world->margin;
    gsgi__world_origin(world, light->origin);
    return complete(light, NULL, out);
}

void gsgi_light_destroy(gsgi_light* light) {
    if (!light) return;
    const gsgi_context* context = light->context;
    const gsgi__gl* gl = &context->gl;
    const gsgi__program* passes[] = {&light->points, &light->smooth, &light->resolve, &light->add_light};
    gsgi__targets_release(light);
    for (uint32_t i = 0; i < light->part_count; ++i) gsgi__part_destroy(context, light->parts[i]);
    if (!context->lost) {
        for (size_t i = 0; i < sizeof passes / sizeof *passes; ++i) gl->DeleteProgram(passes[i]->name);
        for (uint32_t i = 0; i < light->program_count; ++i) gl->DeleteProgram(light->programs[i].name);
        gl->DeleteTextures(1, &light->table);
    }
    gsgi__release(&context->callbacks, light->parts);
    gsgi__release(&context->callbacks, light->rows);
    gsgi__release(&context->callbacks, light);
}

gsgi_result gsgi_light_cull(gsgi_light* light, const gsgi_view* given) {
    const gsgi_callbacks* callbacks = &light->context->callbacks;
    gsgi_view view;
    gsgi__camera camera;
    if (!given || gsgi__read_options(given, &view, sizeof view))
        return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT,
                          "view: struct_size is not that of any version of this library");
    gsgi_result result = gsgi__camera_of_view(&view, &light->options, light->origin, callbacks, &camera);
    if (result) return result;
    if (camera.parallel && light->info.blend == GSGI_OVER)
        return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT,
                          "clip_from_view: an orthographic one needs a file of the `surface` operator");
    if (memcmp(view.viewport, light->viewport, sizeof view.viewport) != 0)
        memset(&light->checked, 0, sizeof light->checked);
    memcpy(light->viewport, view.viewport, sizeof view.viewport);
    light->camera = camera;
    light->has_view = true;
    light->has_drawn = false;
    gsgi__cull_parts(light);
    return GSGI_OK;
}

gsgi_result gsgi_light_recolour(gsgi_light* light, const gsgi_bake* bake) {
    const gsgi_context* context = light->context;
    const gsgi__gl* gl = &context->gl;
    gsgi__state host;
    gsgi_result result = gsgi__check_context(context);
    if (result) return result;
    if (!bake || light->sectors || bake->crc != light->crc ||
        bake->info.gaussian_count[0] != light->info.gaussian_count[0])
        return gsgi__fail(&context->callbacks, GSGI_INVALID_ARGUMENT, "bake: not the one that the light was made of");
    const gsgi__part* part = light->parts[0];
    if (bake->info.group_count == 0) return GSGI_OK; /* light never changes */
    const gsgi_lookup* lookup = part->lookup ? part->lookup : bake->lookup;
    if (!lookup)
        return gsgi__fail(&context->callbacks, GSGI_INVALID_ARGUMENT,
                          "bake: opened without `lists`, with which the light's was");
    if (part->lookup) gsgi__lookup_recolour(part->lookup, bake); /* gsgi_bake_weigh has done the other */
    gsgi__state_begin(gl, context->state, &host);
    gsgi__write_rows(gl, part->tables[0], lookup->info.gaussian_rows, lookup->gaussians);
    gsgi__state_end(gl, context->state, &host);
    return GSGI_OK;
}

/* Make the targets anew if the size of the view has changed. */
static gsgi_result prepare_targets(gsgi_light* light) {
    const gsgi_context* context = light->context;
    const gsgi__targets* targets = &light->targets;
    if (targets->width == light->camera.width && targets->height == light->camera.height) return GSGI_OK;
    gsgi__targets_release(light);
    gsgi__drain_errors(context);
    gsgi_result result =
        light->info.blend == GSGI_SURFACE ? gsgi__surface_create_targets(light) : gsgi__over_create_targets(light);
    gsgi_result memory = gsgi__check_memory(context);
    if (!result) result = memory;
    if (result) gsgi__targets_release(light);
    return result;
}

gsgi_result gsgi_light_draw(gsgi_light* light, uint32_t depth, uint32_t normal, uint32_t* indirect) {
    return gsgi_light_draw_mapped(light, depth, normal, 0, indirect);
}

gsgi_result gsgi_light_draw_mapped(gsgi_light* light, uint32_t depth, uint32_t normal, uint32_t mapped,
                                   uint32_t* indirect) {
    const gsgi_context* context = light->context;
    const gsgi__gl* gl = &context->gl;
    gsgi__state host;
    gsgi_result result = gsgi__check_context(context);
    if (result) return result;
    if (!light->has_view) return gsgi__fail(&context->callbacks, GSGI_NOTHING_CULLED, "light: cull first");
    light->has_drawn = false;
    gsgi__state_begin(gl, context->state, &host);
    const bool surface = light->info.blend == GSGI_SURFACE;
    if (surface) result = gsgi__check_surfaces(light, depth, normal, mapped);
    if (!result) result = prepare_targets(light);
    if (!result && surface) gsgi__surface_draw(light, depth, normal, mapped);
    if (!result && !surface) gsgi__over_draw(light);
    gsgi__state_end(gl, context->state, &host);
    if (result) return result;
    light->has_drawn = true;
    if (indirect) *indirect = light->targets.indirect;
    return GSGI_OK;
}

/* Add B to the first attachment of the framebuffer, whose draw buffers are set and restored. */
static void add_to(const gsgi_light* light, GLuint framebuffer, GLuint albedo) {
    static const GLenum first = GL_COLOR_ATTACHMENT0;
    const gsgi_context* context = light->context;
    const gsgi__gl* gl = &context->gl;
    GLenum buffers[GSGI_DRAW_BUFFERS];
    gl->BindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffer);
    if (framebuffer) {
        for (int i = 0; i < gl->draw_buffers; ++i) gl->GetIntegerv(GL_DRAW_BUFFER0 + (GLenum)i, (GLint*)&buffers[i]);
        gl->DrawBuffers(1, &first);
    }
    gsgi__blend(gl, true, GL_ONE, GL_ONE);
    gsgi__viewport(gl, light->camera.x, light->camera.y, light->camera.width, light->camera.height);
    gsgi__bind_texture(gl, 0, albedo);
    gsgi__bind_texture(gl, 1, light->targets.indirect);
    gsgi__use_sampler(context);
    gl->UseProgram(light->add_light.name);
    gl->Uniform2f(light->add_light.at[U_CORNER], (GLfloat)light->camera.x, (GLfloat)light->camera.y);
    gsgi__draw_triangle(context, &light->add_light);
    if (framebuffer) gl->DrawBuffers(gl->draw_buffers, buffers);
}

gsgi_result gsgi_light_add(gsgi_light* light, uint32_t framebuffer, uint32_t albedo) {
    const gsgi_context* context = light->context;
    const gsgi__gl* gl = &context->gl;
    gsgi__state host;
    gsgi_result result = gsgi__check_context(context);
    if (result) return result;
    if (!light->has_drawn) return gsgi__fail(&context->callbacks, GSGI_NOTHING_CULLED, "light: draw first");
    gsgi__state_begin(gl, context->state, &host);
    result = gsgi__check_addition(light, framebuffer, albedo);
    if (!result) {
        gsgi__readable readable = gsgi__make_readable(gl, albedo);
        add_to(light, framebuffer, albedo);
        gsgi__unmake_readable(gl, &readable);
    }
    gsgi__state_end(gl, context->state, &host);
    return result;
}

gsgi_result gsgi_light_stats(const gsgi_light* light, gsgi_stats* stats) {
    gsgi_stats found = {.struct_size = sizeof found, .target_bytes = light->targets.bytes};
    for (uint32_t i = 0; i < light->part_count; ++i) {
        const gsgi__part* part = light->parts[i];
        for (int l = 0; l < 2; ++l) found.drawn[l] += part->in_view ? part->drawn[l] : 0;
        found.gaussian_bytes += part->bytes;
    }
    return gsgi__write_struct(&found, sizeof found, stats);
}

gsgi_result gsgi_light_reset(gsgi_light* light) {
    gsgi_result result = gsgi__check_context(light->context);
    if (result) return result;
    gsgi__targets_release(light);
    memset(&light->checked, 0, sizeof light->checked);
    light->has_view = light->has_drawn = false;
    for (uint32_t i = 0; i < light->part_count; ++i) light->parts[i]->in_view = false;
    return GSGI_OK;
}
