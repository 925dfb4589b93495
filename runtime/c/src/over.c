/* The pass of the `over` operator: Gaussians as instanced quads, blended back to front. */
#include "light.h"
#include "shaders.h"

#include <stdio.h>

#define QUAD_CORNERS 4

gsgi_result gsgi__over_program(gsgi_light* light, const gsgi__program** to) {
    const gsgi_context* context = light->context;
    const gsgi__gl* gl = &context->gl;
    const gsgi_info* info = &light->info;
    gsgi__program* program = &light->programs[0];
    char defines[64];
    snprintf(defines, sizeof defines, "#define SH_DEGREE %u\n", info->sh_degree[GSGI_FINE]);
    gsgi_result result = gsgi__program_create(gl, &context->callbacks, "over/splat", gsgi__shader_over_splat_vert,
                                              gsgi__shader_over_splat_frag, defines, program);
    if (result) return result;
    light->program_count = 1;
    gsgi__set_float(gl, program, "near", info->near_plane);
    gsgi__set_float(gl, program, "dilation", info->dilation);
    gsgi__set_float(gl, program, "alpha_min", info->alpha_min);
    gsgi__set_float(gl, program, "alpha_max", info->alpha_max);
    *to = program;
    return GSGI_OK;
}

gsgi_result gsgi__over_create_targets(gsgi_light* light) {
    gsgi__targets* t = &light->targets;
    t->width = light->camera.width;
    t->height = light->camera.height;
    t->indirect = gsgi__target_texture(light, GL_RGBA32F, t->width, t->height);
    return gsgi__target(light, (GLuint[GSGI_TARGETS]){t->indirect}, 0, &t->resolved);
}

void gsgi__over_draw(const gsgi_light* light) {
    const gsgi_context* context = light->context;
    const gsgi__gl* gl = &context->gl;
    const gsgi__camera* c = &light->camera;
    const gsgi__part* part = light->parts[0];
    const gsgi__culled* culled = &part->culled;
    const gsgi__program* program = part->program;
    gsgi__clear_color(gl, light->targets.resolved);
    if (culled->visible == 0) return;
    gsgi__blend(gl, true, GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
    gsgi__viewport(gl, 0, 0, c->width, c->height);
    gsgi__use_sampler(context);
    gl->UseProgram(program->name);
    gsgi__set_matrix(gl, program, U_VIEW_FROM_WORLD, &c->view_from_world);
    gl->Uniform3f(program->at[U_EYE], (float)c->world_from_view.at[0][3], (float)c->world_from_view.at[1][3],
                  (float)c->world_from_view.at[2][3]);
    gl->Uniform2f(program->at[U_FOCAL], (float)c->fx, (float)c->fy);
    gl->Uniform2f(program->at[U_CENTRE], (float)c->cx, (float)c->cy);
    gl->Uniform2f(program->at[U_SIZE], (float)c->width, (float)c->height);
    gsgi__bind_texture(gl, 0, part->shape);
    gsgi__bind_texture(gl, 1, part->sh);
    gl->BindBuffer(GL_ARRAY_BUFFER, part->index);
    gl->BufferData(GL_ARRAY_BUFFER, (GLsizeiptr)(culled->count * sizeof *culled->index), NULL, GL_STREAM_DRAW);
    gl->BufferSubData(GL_ARRAY_BUFFER, 0, (GLsizeiptr)(culled->visible * sizeof *culled->index), culled->index);
    gl->BindVertexArray(part->strips);
    gl->DrawArraysInstanced(GL_TRIANGLE_STRIP, 0, QUAD_CORNERS, (GLsizei)culled->visible);
}
