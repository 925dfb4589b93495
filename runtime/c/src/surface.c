/* The passes of the `surface` operator: B read at surface points from lists of Gaussians by place, and upsampled. */
#include "light.h"
#include "lookup.h"
#include "shaders.h"

#include <stdio.h>
#include <string.h>

#define DEFINES_MAX 512

static bool has_box(const gsgi_light_options* options) {
    for (int k = 0; k < 3; ++k)
        if (options->box_low[k] != 0.0f || options->box_high[k] != 0.0f) return true;
    return false;
}

static gsgi_result create_pass(gsgi_light* light, const char* name, const char* fragment, const char* defines,
                               gsgi__program* program) {
    const gsgi_context* context = light->context;
    return gsgi__program_create(&context->gl, &context->callbacks, name, gsgi__shader_lib_fullscreen_vert, fragment,
                                defines, program);
}

/* Defines of the passes that read the host's textures. */
static void reading_defines(const gsgi_light* light, char defines[DEFINES_MAX]) {
    const gsgi_light_options* o = &light->options;
    snprintf(defines, DEFINES_MAX,
             "#define SECTORS %d\n#define RELIEF %d\n#define SPLAT_SCALE %d\n#define BOX %d\n#define DEPTH_BUFFER %d\n"
             "#define NORMAL_OCTAHEDRAL %d\n#define NORMAL_OCTAHEDRAL_UNSIGNED %d\n#define NORMAL_UNSIGNED %d\n"
             "#define NORMAL_VIEW_SPACE %d\n",
             light->sectors, light->relief, (int)o->splat_scale, has_box(o), o->depth != GSGI_DEPTH_LINEAR,
             o->normal == GSGI_NORMAL_OCTAHEDRAL, o->normal == GSGI_NORMAL_OCTAHEDRAL_UNSIGNED,
             o->normal == GSGI_NORMAL_UNSIGNED, o->normal_space == GSGI_SPACE_VIEW);
}

gsgi_result gsgi__surface_program(gsgi_light* light, const gsgi_lookup* lookup, const gsgi__program** to) {
    char counts[GSGI_LOOKUP_DEFINES], defines[DEFINES_MAX];
    for (uint32_t i = 0; i < light->program_count; ++i)
        if (memcmp(light->kinds[i], lookup->counts, sizeof lookup->counts) == 0) {
            *to = &light->programs[i];
            return GSGI_OK;
        }
    gsgi__lookup_defines(lookup, counts);
    snprintf(defines, sizeof defines, "#define SECTORS %d\n#define RELIEF %d\n#define SPLAT_SCALE %d\n%s",
             light->sectors, light->relief, (int)light->options.splat_scale, counts);
    gsgi__program* program = &light->programs[light->program_count];
    gsgi_result result = create_pass(light, "surface/read", gsgi__shader_surface_read_frag, defines, program);
    if (result) return result;
    if (light->sectors) gsgi__set_float(&light->context->gl, program, "sector_margin", light->margin);
    memcpy(light->kinds[light->program_count++], lookup->counts, sizeof lookup->counts);
    *to = program;
    return GSGI_OK;
}

gsgi_result gsgi__surface_create(gsgi_light* light) {
    const gsgi__gl* gl = &light->context->gl;
    const gsgi_light_options* o = &light->options;
    char defines[DEFINES_MAX];
    reading_defines(light, defines);
    gsgi_result result =
        create_pass(light, "surface/points", gsgi__shader_surface_points_frag, defines, &light->points);
    if (result) return result;
    if (has_box(o)) {
        const char* const names[] = {"box_low", "box_high"};
        const float* const corners[] = {o->box_low, o->box_high};
        for (int i = 0; i < 2; ++i)
            gl->Uniform3f(gl->GetUniformLocation(light->points.name, names[i]),
                          (float)(corners[i][0] - light->origin[0]), (float)(corners[i][1] - light->origin[1]),
                          (float)(corners[i][2] - light->origin[2]));
    }
    if (light->sectors) gsgi__set_float(gl, &light->points, "sector_margin", light->margin);
    if (o->splat_scale == 1) return GSGI_OK;
    result = create_pass(light, "surface/smooth", gsgi__shader_surface_smooth_frag, defines, &light->smooth);
    if (result) return result;
    return create_pass(light, "surface/resolve", gsgi__shader_surface_resolve_frag, defines, &light->resolve);
}

gsgi_result gsgi__surface_create_targets(gsgi_light* light) {
    const int32_t scale = light->options.splat_scale, width = light->camera.width, height = light->camera.height;
    const int32_t read_width = (width + scale - 1) / scale, read_height = (height + scale - 1) / scale;
    gsgi__targets* t = &light->targets;
    t->width = width;
    t->height = height;
    t->read_width = read_width;
    t->read_height = read_height;
    t->position = gsgi__target_texture(light, GL_RGBA32F, read_width, read_height);
    t->plane = gsgi__target_texture(light, GL_RGBA32F, read_width, read_height);
    if (light->relief) t->bend = gsgi__target_texture(light, GL_RGBA16F, read_width, read_height);
    if (scale > 1) t->filled = gsgi__target_texture(light, GL_RGBA32F, read_width, read_height);
    t->indirect = gsgi__target_texture(light, GL_RGBA16F, width, height);
    if (scale > 1) t->rest = gsgi__target_depth(light, width, height);

    const GLuint points[GSGI_TARGETS] = {t->position, t->plane, t->bend};
    gsgi_result result = gsgi__target(light, points, 0, &t->points);
    if (!result && t->filled) result = gsgi__target(light, (GLuint[GSGI_TARGETS]){t->filled}, 0, &t->filled_sums);
    if (!result) result = gsgi__target(light, (GLuint[GSGI_TARGETS]){t->indirect}, t->rest, &t->resolved);
    return result;
}

/* Uniforms of the passes that read the host's textures. */
static void set_host(const gsgi_light* light, const gsgi__program* program) {
    const gsgi__gl* gl = &light->context->gl;
    const gsgi__camera* c = &light->camera;
    const double of_offset[4] = {1.0 / c->fx, 1.0 / c->fy, -1.0, 1.0};
    gsgi__matrix world_from_offset;
    for (int i = 0; i < 4; ++i)
        for (int k = 0; k < 4; ++k) world_from_offset.at[i][k] = c->world_from_view.at[i][k] * of_offset[k];
    gl->UseProgram(program->name);
    gsgi__set_matrix(gl, program, U_WORLD_FROM_VIEW, &c->world_from_host);
    gsgi__set_matrix(gl, program, U_WORLD_FROM_OFFSET, &world_from_offset);
    gl->Uniform2f(program->at[U_AXIS], (float)c->cx, (float)(c->height - c->cy));
    gl->Uniform2f(program->at[U_SIZE], (float)c->width, (float)c->height);
    gl->Uniform2f(program->at[U_CORNER], (float)c->x, (float)c->y);
    gl->Uniform2f(program->at[U_DEPTH_ENDS], c->depth_ends[0], c->depth_ends[1]);
    gl->Uniform2f(program->at[U_DEPTH_LINE], c->depth_line[0], c->depth_line[1]);
    gl->Uniform1i(program->at[U_PARALLEL], c->parallel);
    gl->Uniform2f(program->at[U_Z_TO_CLIP], c->z_to_clip[0], c->z_to_clip[1]);
}

/* Blend what is drawn, or let it replace what is there. */
static void set_blend(const gsgi__gl* gl, bool added) { gsgi__blend(gl, added, GL_ONE, added ? GL_ONE : GL_ZERO); }

/* Choose the points at which B is read; of a world those where sectors of a class have light. */
static void draw_points(const gsgi_light* light, uint32_t class, GLuint depth, GLuint normal, GLuint mapped) {
    const gsgi__gl* gl = &light->context->gl;
    const gsgi__targets* t = &light->targets;
    gl->BindFramebuffer(GL_DRAW_FRAMEBUFFER, t->points);
    gsgi__viewport(gl, 0, 0, t->read_width, t->read_height);
    set_blend(gl, false);
    gsgi__bind_texture(gl, 0, normal);
    gsgi__bind_texture(gl, 1, depth);
    if (light->relief) gsgi__bind_texture(gl, 2, mapped ? mapped : normal); /* the same: nothing is bent */
    set_host(light, &light->points);
    if (light->sectors) {
        gsgi__bind_texture(gl, 3, light->table);
        gl->Uniform1i(light->points.at[U_SECTOR_COUNT], (GLint)light->part_count);
        gl->Uniform1i(light->points.at[U_SECTOR_CLASS], (GLint)class);
    }
    gsgi__draw_triangle(light->context, &light->points);
}

/* Read B of the parts of a class at the points: into sums or, at full resolution, as light. */
static void read_parts(const gsgi_light* light, uint32_t class, bool added) {
    const gsgi__gl* gl = &light->context->gl;
    const gsgi__targets* t = &light->targets;
    const GLuint target = t->filled ? t->filled_sums : t->resolved;
    added = added && !t->filled;
    if (light->sectors && !added)
        gsgi__clear_color(gl, target);
    else
        gl->BindFramebuffer(GL_DRAW_FRAMEBUFFER, target);
    set_blend(gl, added);
    gsgi__bind_texture(gl, 2, t->position);
    gsgi__bind_texture(gl, 3, t->plane);
    gsgi__bind_texture(gl, 4, t->bend);
    for (uint32_t i = 0; i < light->part_count; ++i) {
        const gsgi__part* part = light->parts[i];
        if (!part->in_view || part->class != class) continue;
        gsgi__bind_texture(gl, 0, part->tables[0]);
        gsgi__bind_texture(gl, 1, part->tables[1]);
        gsgi__bind_texture(gl, 5, part->tables[2]);
        gl->UseProgram(part->program->name);
        if (light->sectors) {
            gl->Uniform3f(part->program->at[U_SECTOR_LOW], part->low[0], part->low[1], part->low[2]);
            gl->Uniform3f(part->program->at[U_SECTOR_HIGH], part->high[0], part->high[1], part->high[2]);
        }
        gsgi__draw_triangle(light->context, part->program);
    }
}

/* Turn sums into light at full resolution. */
static void upsample(const gsgi_light* light, bool added, GLuint depth, GLuint normal) {
    const gsgi_context* context = light->context;
    const gsgi__gl* gl = &context->gl;
    const gsgi__targets* t = &light->targets;
    gl->BindFramebuffer(GL_DRAW_FRAMEBUFFER, t->resolved);
    gsgi__viewport(gl, 0, 0, t->width, t->height);
    set_blend(gl, added);
    gl->Enable(GL_DEPTH_TEST); /* without it no depth is written */
    gl->DepthFunc(GL_ALWAYS);
    gl->DepthMask(GL_TRUE);
    gsgi__bind_texture(gl, 0, normal);
    gsgi__bind_texture(gl, 1, depth);
    gsgi__bind_texture(gl, 2, t->filled);
    gsgi__draw_triangle(context, &light->smooth);
    gl->DepthFunc(GL_LESS);
    gl->DepthMask(GL_FALSE);
    set_host(light, &light->resolve);
    gsgi__draw_triangle(context, &light->resolve);
    gl->Disable(GL_DEPTH_TEST);
}

/* The passes of a frame, in the order of glsl/README.md, for the parts of a class. Their light replaces what is there,
 * unless it is `added`. */
static void draw_passes(const gsgi_light* light, uint32_t class, bool added, GLuint depth, GLuint normal,
                        GLuint mapped) {
    draw_points(light, class, depth, normal, mapped);
    read_parts(light, class, added);
    if (light->targets.filled) upsample(light, added, depth, normal);
}

/* The lowest class from `first` on that a part in view has; UINT32_MAX: there is none. */
static uint32_t next_class(const gsgi_light* light, uint32_t first) {
    uint32_t lowest = UINT32_MAX;
    for (uint32_t i = 0; i < light->part_count; ++i) {
        const gsgi__part* part = light->parts[i];
        if (part->in_view && part->class >= first && part->class < lowest) lowest = part->class;
    }
    return lowest;
}

void gsgi__surface_draw(const gsgi_light* light, GLuint depth, GLuint normal, GLuint mapped) {
    const gsgi__gl* gl = &light->context->gl;
    const GLuint read[3] = {depth, normal, mapped};
    const int count = light->relief && mapped ? 3 : 2;
    gsgi__readable readable[3];
    for (int i = 0; i < count; ++i) readable[i] = gsgi__make_readable(gl, read[i]);
    gsgi__use_sampler(light->context);
    uint32_t class = next_class(light, 0);
    draw_passes(light, class, false, depth, normal, mapped);
    while (class < UINT32_MAX && (class = next_class(light, class + 1)) < UINT32_MAX)
        draw_passes(light, class, true, depth, normal, mapped);
    for (int i = count; i-- > 0;) /* the reverse order: they may be the same texture */
        gsgi__unmake_readable(gl, &readable[i]);
}
