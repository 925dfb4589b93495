/* The passes of the `surface` operator: Gaussians read at surface points, summed unsorted, divided once. */
#include "light.h"
#include "shaders.h"

#include <stdio.h>

#define OUTLINE_CORNERS 8 /* vertices of a strip; OUTLINE_CORNERS of glsl/lib/ellipsoid.glsl */
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
             "#define SECTORS %d\n#define RELIEF %d\n#define SPLAT_SCALE %d\n#define BOX %d\n#define COARSE "
             "%d\n#define DEPTH_BUFFER %d\n"
             "#define NORMAL_OCTAHEDRAL %d\n#define NORMAL_OCTAHEDRAL_UNSIGNED %d\n#define NORMAL_UNSIGNED %d\n"
             "#define NORMAL_VIEW_SPACE %d\n",
             light->sectors, light->relief, (int)o->splat_scale, has_box(o), light->coarse,
             o->depth != GSGI_DEPTH_LINEAR, o->normal == GSGI_NORMAL_OCTAHEDRAL,
             o->normal == GSGI_NORMAL_OCTAHEDRAL_UNSIGNED, o->normal == GSGI_NORMAL_UNSIGNED,
             o->normal_space == GSGI_SPACE_VIEW);
}

gsgi_result gsgi__surface_program(gsgi_light* light, const gsgi_info* info, int l, bool relief,
                                  const gsgi__program** to) {
    const gsgi_context* context = light->context;
    const gsgi__gl* gl = &context->gl;
    const uint32_t kind =
        info->sh_degree[l] << 3 | (uint32_t)info->sloped[l] << 2 | (uint32_t)relief << 1 | (uint32_t)l;
    char defines[DEFINES_MAX];
    for (uint32_t i = 0; i < light->program_count; ++i)
        if (light->kinds[i] == kind) {
            *to = &light->programs[i];
            return GSGI_OK;
        }
    snprintf(defines, sizeof defines,
             "#define SH_DEGREE %u\n#define NORMAL_POWER %u\n#define SLOPED %d\n"
             "#define RELIEF %d\n#define SECTORS %d\n",
             info->sh_degree[l], l == GSGI_FINE ? info->sharpness : 0u, info->sloped[l], relief, light->sectors);
    gsgi__program* program = &light->programs[light->program_count];
    gsgi_result result =
        gsgi__program_create(gl, &context->callbacks, "surface/gaussians", gsgi__shader_surface_gaussians_vert,
                             gsgi__shader_surface_gaussians_frag, defines, program);
    if (result) return result;
    gsgi__set_float(gl, program, "radius", info->radius);
    gsgi__set_float(gl, program, "cutoff", info->cutoff);
    if (light->sectors) gsgi__set_float(gl, program, "sector_margin", light->margin);
    light->kinds[light->program_count++] = kind;
    *to = program;
    return GSGI_OK;
}

void gsgi__surface_set_floor(const gsgi_light* light) {
    const gsgi__gl* gl = &light->context->gl;
    const gsgi__program* passes[] = {&light->gap, &light->fill, &light->resolve};
    for (int i = 0; i < 3; ++i)
        if (passes[i]->name) {
            gl->UseProgram(passes[i]->name);
            gsgi__set_float(gl, passes[i], "weight_floor", light->info.weight_floor);
        }
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
    if (light->coarse) {
        result = create_pass(light, "surface/gap", gsgi__shader_surface_gap_frag, "", &light->gap);
        if (result) return result;
    }
    if (o->splat_scale > 1) {
        result = create_pass(light, "surface/fill", gsgi__shader_surface_fill_frag, defines, &light->fill);
        if (result) return result;
        result = create_pass(light, "surface/smooth", gsgi__shader_surface_smooth_frag, defines, &light->smooth);
        if (result) return result;
    }
    result = create_pass(light, "surface/resolve", gsgi__shader_surface_resolve_frag, defines, &light->resolve);
    if (!result) gsgi__surface_set_floor(light);
    return result;
}

/* Sums are whole floats: halves have 11 significant bits, so that after 2,048 Gaussians of the same weight each further
 * one would be lost. */
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
    t->fine = gsgi__target_texture(light, GL_RGBA32F, read_width, read_height);
    if (light->coarse) t->coarse = gsgi__target_texture(light, GL_RGBA32F, read_width, read_height);
    if (scale > 1) t->filled = gsgi__target_texture(light, GL_RGBA32F, read_width, read_height);
    t->indirect = gsgi__target_texture(light, GL_RGBA16F, width, height);
    t->depth = gsgi__target_depth(light, read_width, read_height);
    if (scale > 1) t->rest = gsgi__target_depth(light, width, height);

    const struct {
        GLuint colors[GSGI_TARGETS], depth, *framebuffer;
        bool needed;
    } targets[] = {{{t->position, t->plane, t->bend}, t->depth, &t->points, true},
                   {{t->fine}, t->depth, &t->fine_sums, true},
                   {{t->coarse}, t->depth, &t->coarse_sums, t->coarse != 0},
                   {{0}, t->depth, &t->gap, t->coarse != 0},
                   {{t->filled}, 0, &t->filled_sums, t->filled != 0},
                   {{t->indirect}, t->rest, &t->resolved, true}};
    gsgi_result result = GSGI_OK;
    for (size_t i = 0; i < sizeof targets / sizeof *targets && !result; ++i)
        if (targets[i].needed)
            result = gsgi__target(light, targets[i].colors, targets[i].depth, targets[i].framebuffer);
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
    gl->Uniform1f(program->at[U_NEAR], (float)c->near_plane);
}

static void write_depth(const gsgi__gl* gl, GLuint framebuffer) {
    gl->BindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffer);
    gsgi__blend(gl, false, GL_ONE, GL_ZERO);
    gl->Enable(GL_DEPTH_TEST); /* without it no depth is written */
    gl->DepthFunc(GL_ALWAYS);
    gl->DepthMask(GL_TRUE);
}

/* Add a part's sums of a level, where the depth buffer lets Gaussians pass. */
static void draw_level(const gsgi_light* light, const gsgi__part* part, int l) {
    const gsgi__gl* gl = &light->context->gl;
    const gsgi__camera* c = &light->camera;
    const gsgi__program* program = part->levels[l].program;
    const double scale = light->options.splat_scale, rows = light->targets.read_height - c->height / scale;
    if (part->culled[l].visible == 0) return;
    gsgi__blend(gl, true, GL_ONE, GL_ONE);
    gl->Enable(GL_DEPTH_TEST);
    gl->DepthFunc(GL_LESS);
    gl->DepthMask(GL_FALSE);
    gl->UseProgram(program->name);
    gsgi__set_matrix(gl, program, U_VIEW_FROM_WORLD, &c->view_from_world);
    gl->Uniform1f(program->at[U_NEAR], (float)c->near_plane);
    gl->Uniform1i(program->at[U_PARALLEL], c->parallel);
    gl->Uniform2f(program->at[U_SIZE], (float)light->targets.read_width, (float)light->targets.read_height);
    gl->Uniform2f(program->at[U_FOCAL], (float)(c->fx / scale), (float)(c->fy / scale));
    gl->Uniform2f(program->at[U_CENTRE], (float)(c->cx / scale), (float)(c->cy / scale + rows));
    gl->Uniform1f(program->at[U_MARGIN], scale > 1.0 ? 0.5f : 0.0f);
    if (light->sectors) {
        gl->Uniform3f(program->at[U_SECTOR_LOW], part->low[0], part->low[1], part->low[2]);
        gl->Uniform3f(program->at[U_SECTOR_HIGH], part->high[0], part->high[1], part->high[2]);
    }
    gsgi__bind_texture(gl, 2, light->targets.position);
    gsgi__bind_texture(gl, 3, light->targets.plane);
    if (light->targets.bend) gsgi__bind_texture(gl, 5, light->targets.bend);
    gsgi__draw_gaussians(light, part, l, OUTLINE_CORNERS);
}

static bool is_read(const gsgi__part* part, uint32_t class) { return part->in_view && part->class == class; }

static void draw_levels(const gsgi_light* light, uint32_t class, int l, GLuint framebuffer) {
    gsgi__clear_color(&light->context->gl, framebuffer);
    for (uint32_t i = 0; i < light->part_count; ++i)
        if (is_read(light->parts[i], class)) draw_level(light, light->parts[i], l);
}

/* The passes of a frame, in the order of glsl/README.md, for the parts of a class. Their light replaces what is there,
 * unless it is `added`. */
static void draw_passes(const gsgi_light* light, uint32_t class, bool added, GLuint depth, GLuint normal,
                        GLuint mapped) {
    const gsgi_context* context = light->context;
    const gsgi__gl* gl = &context->gl;
    const gsgi__targets* t = &light->targets;

    gsgi__viewport(gl, 0, 0, t->read_width, t->read_height);
    write_depth(gl, t->points);
    gsgi__bind_texture(gl, 0, normal);
    gsgi__bind_texture(gl, 1, depth);
    if (light->relief) gsgi__bind_texture(gl, 2, mapped ? mapped : normal); /* the same: nothing is bent */
    set_host(light, &light->points);
    if (light->sectors) {
        gsgi__bind_texture(gl, 3, light->table);
        gl->Uniform1i(light->points.at[U_SECTOR_COUNT], (GLint)light->part_count);
        gl->Uniform1i(light->points.at[U_SECTOR_CLASS], (GLint)class);
    }
    gsgi__draw_triangle(context, &light->points);

    draw_levels(light, class, GSGI_FINE, t->fine_sums);
    if (t->coarse) {
        write_depth(gl, t->gap);
        gsgi__bind_texture(gl, 6, t->fine);
        gsgi__draw_triangle(context, &light->gap);
        draw_levels(light, class, GSGI_COARSE, t->coarse_sums);
    }

    gsgi__blend(gl, false, GL_ONE, GL_ZERO);
    gl->Disable(GL_DEPTH_TEST);
    gsgi__bind_texture(gl, 2, t->position);
    gsgi__bind_texture(gl, 3, t->plane);
    gsgi__bind_texture(gl, 4, t->coarse);
    gsgi__bind_texture(gl, 6, t->fine);
    if (t->filled) {
        gl->BindFramebuffer(GL_DRAW_FRAMEBUFFER, t->filled_sums);
        gsgi__draw_triangle(context, &light->fill);
        gsgi__bind_texture(gl, 0, normal);
        gsgi__bind_texture(gl, 1, depth);
        gsgi__bind_texture(gl, 2, t->filled);
        gsgi__viewport(gl, 0, 0, t->width, t->height);
        write_depth(gl, t->resolved);
        gsgi__blend(gl, added, GL_ONE, added ? GL_ONE : GL_ZERO);
        gsgi__draw_triangle(context, &light->smooth);
        gl->DepthFunc(GL_LESS);
        gl->DepthMask(GL_FALSE);
        set_host(light, &light->resolve);
    }
    gl->BindFramebuffer(GL_DRAW_FRAMEBUFFER, t->resolved);
    gsgi__viewport(gl, 0, 0, t->width, t->height);
    gsgi__blend(gl, added, GL_ONE, added ? GL_ONE : GL_ZERO);
    gsgi__draw_triangle(context, &light->resolve);
    gl->Disable(GL_DEPTH_TEST);
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
