/* A host's OpenGL state: read before our passes, and restored after them. */
#include "gl.h"

#include <string.h>

typedef enum where { ANYWHERE, DESKTOP, COMPATIBILITY, SINCE_ES_310 } where;

/* Switches that would change what the passes draw. All are off in them. */
static const struct {
    GLenum name;
    where where;
} switches[] = {{GL_CULL_FACE, ANYWHERE},
                {GL_DEPTH_TEST, ANYWHERE},
                {GL_STENCIL_TEST, ANYWHERE},
                {GL_POLYGON_OFFSET_FILL, ANYWHERE},
                {GL_SAMPLE_ALPHA_TO_COVERAGE, ANYWHERE},
                {GL_SAMPLE_COVERAGE, ANYWHERE},
                {GL_RASTERIZER_DISCARD, ANYWHERE},
                {GL_SAMPLE_MASK, SINCE_ES_310},
                {GL_COLOR_LOGIC_OP, DESKTOP},
                {GL_POLYGON_SMOOTH, DESKTOP},
                {GL_PRIMITIVE_RESTART, DESKTOP},
                {GL_DEPTH_CLAMP, DESKTOP},
                {GL_CLIP_DISTANCE0, DESKTOP},
                {GL_CLIP_DISTANCE0 + 1, DESKTOP},
                {GL_CLIP_DISTANCE0 + 2, DESKTOP},
                {GL_CLIP_DISTANCE0 + 3, DESKTOP},
                {GL_CLIP_DISTANCE0 + 4, DESKTOP},
                {GL_CLIP_DISTANCE0 + 5, DESKTOP},
                {GL_CLIP_DISTANCE0 + 6, DESKTOP},
                {GL_CLIP_DISTANCE0 + 7, DESKTOP},
                {GL_ALPHA_TEST, COMPATIBILITY},
                {GL_POLYGON_STIPPLE, COMPATIBILITY}};
#define SWITCH_COUNT (sizeof switches / sizeof *switches)

/* How uploads read memory. OpenGL ES has all but the first two. */
static const GLenum unpack[8] = {GL_UNPACK_SWAP_BYTES,   GL_UNPACK_LSB_FIRST,   GL_UNPACK_ROW_LENGTH,
                                 GL_UNPACK_SKIP_ROWS,    GL_UNPACK_SKIP_PIXELS, GL_UNPACK_SKIP_IMAGES,
                                 GL_UNPACK_IMAGE_HEIGHT, GL_UNPACK_ALIGNMENT};
#define UNPACK_ALIGNMENT 7

static bool has(const gsgi__gl* gl, where contexts) {
    switch (contexts) {
        case ANYWHERE:
            return true;
        case DESKTOP:
            return !gl->es;
        case COMPATIBILITY:
            return gl->compatible;
        case SINCE_ES_310:
            return !gl->es || gl->version >= 310;
    }
    return false;
}

/* OpenGL's initial values, but for the viewport. */
static gsgi__state initial(void) {
    gsgi__state state;
    memset(&state, 0, sizeof state);
    memset(state.color_mask, GL_TRUE, sizeof state.color_mask);
    state.depth_mask = GL_TRUE;
    state.blend_function[0] = state.blend_function[2] = GL_ONE; /* sources; destinations: GL_ZERO */
    state.blend_equation[0] = state.blend_equation[1] = GL_FUNC_ADD;
    state.depth_function = GL_LESS;
    state.polygon_mode[0] = state.polygon_mode[1] = GL_FILL;
    state.clamp_fragment_color = GL_FALSE; /* what the passes need; compatibility contexts begin with GL_FIXED_ONLY */
    state.active_texture = GL_TEXTURE0;
    state.unpack[UNPACK_ALIGNMENT] = 4;
    state.clip_origin = GL_LOWER_LEFT;
    state.clip_depth = GL_NEGATIVE_ONE_TO_ONE;
    state.depth_range[1] = 1.0;
    return state;
}

static void read_blending(const gsgi__gl* gl, gsgi__state* s) {
    static const GLenum functions[] = {GL_BLEND_SRC_RGB, GL_BLEND_DST_RGB, GL_BLEND_SRC_ALPHA, GL_BLEND_DST_ALPHA};
    static const GLenum equations[] = {GL_BLEND_EQUATION_RGB, GL_BLEND_EQUATION_ALPHA};
    for (GLuint i = 0; i < GSGI_TARGETS; ++i) {
        s->blend[i] = gl->indexed ? gl->IsEnabledi(GL_BLEND, i) : gl->IsEnabled(GL_BLEND);
        if (gl->indexed)
            gl->GetBooleani_v(GL_COLOR_WRITEMASK, i, s->color_mask[i]);
        else
            gl->GetBooleanv(GL_COLOR_WRITEMASK, s->color_mask[i]);
    }
    for (int k = 0; k < 4; ++k)
        if (gl->indexed_blending)
            gl->GetIntegeri_v(functions[k], 0, &s->blend_function[k]);
        else
            gl->GetIntegerv(functions[k], &s->blend_function[k]);
    for (int k = 0; k < 2; ++k)
        if (gl->indexed_blending)
            gl->GetIntegeri_v(equations[k], 0, &s->blend_equation[k]);
        else
            gl->GetIntegerv(equations[k], &s->blend_equation[k]);
}

static void read_textures(const gsgi__gl* gl, gsgi__state* s) {
    gl->GetIntegerv(GL_ACTIVE_TEXTURE, &s->active_texture);
    for (GLuint unit = 0; unit < GSGI_UNITS; ++unit) {
        gl->ActiveTexture(GL_TEXTURE0 + unit);
        gl->GetIntegerv(GL_TEXTURE_BINDING_2D, &s->textures[unit]);
        gl->GetIntegerv(GL_SAMPLER_BINDING, &s->samplers[unit]);
    }
}

static void read(const gsgi__gl* gl, gsgi__state* s) {
    memset(s, 0, sizeof *s);
    for (size_t i = 0; i < SWITCH_COUNT; ++i)
        if (has(gl, switches[i].where)) s->switches[i] = gl->IsEnabled(switches[i].name);
    s->scissor = gl->IsEnabled(GL_SCISSOR_TEST); /* of the first viewport */
    read_blending(gl, s);
    gl->GetBooleanv(GL_DEPTH_WRITEMASK, &s->depth_mask);
    gl->GetIntegerv(GL_DEPTH_FUNC, &s->depth_function);
    gl->GetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &s->framebuffer);
    gl->GetIntegerv(GL_RENDERBUFFER_BINDING, &s->renderbuffer);
    gl->GetIntegerv(GL_VERTEX_ARRAY_BINDING, &s->vertex_array);
    gl->GetIntegerv(GL_ARRAY_BUFFER_BINDING, &s->array_buffer);
    gl->GetIntegerv(GL_PIXEL_UNPACK_BUFFER_BINDING, &s->unpack_buffer);
    gl->GetIntegerv(GL_CURRENT_PROGRAM, &s->program);
    read_textures(gl, s);
    for (int i = gl->es ? 2 : 0; i < 8; ++i) gl->GetIntegerv(unpack[i], &s->unpack[i]);
    gl->GetFloatv(GL_VIEWPORT, s->viewport);
    if (gl->es) {
        GLfloat range[2];
        gl->GetFloatv(GL_DEPTH_RANGE, range);
        s->depth_range[0] = range[0];
        s->depth_range[1] = range[1];
    } else {
        gl->GetDoublev(GL_DEPTH_RANGE, s->depth_range);
        gl->GetIntegerv(GL_POLYGON_MODE, s->polygon_mode);
    }
    if (gl->clip_control) {
        gl->GetIntegerv(GL_CLIP_ORIGIN, &s->clip_origin);
        gl->GetIntegerv(GL_CLIP_DEPTH_MODE, &s->clip_depth);
    }
    if (gl->compatible) gl->GetIntegerv(GL_CLAMP_FRAGMENT_COLOR, &s->clamp_fragment_color);
}

static void set_switch(const gsgi__gl* gl, GLenum name, bool on) {
    if (on)
        gl->Enable(name);
    else
        gl->Disable(name);
}

/* A switch of the draw buffer or viewport `index` alone, where there are such switches. */
static void set_indexed(const gsgi__gl* gl, bool indexed, GLenum name, GLuint index, bool on) {
    if (!indexed)
        set_switch(gl, name, on);
    else if (on)
        gl->Enablei(name, index);
    else
        gl->Disablei(name, index);
}

static void set_depth_range(const gsgi__gl* gl, const GLdouble range[2]) {
    if (gl->es)
        gl->DepthRangef((GLfloat)range[0], (GLfloat)range[1]);
    else if (gl->viewports)
        gl->DepthRangeIndexed(0, range[0], range[1]);
    else
        gl->DepthRange(range[0], range[1]);
}

/* Masks, switches, and how primitives are rasterised and memory is read. */
static void write_fixed(const gsgi__gl* gl, const gsgi__state* s) {
    for (size_t i = 0; i < SWITCH_COUNT; ++i)
        if (has(gl, switches[i].where)) set_switch(gl, switches[i].name, s->switches[i]);
    set_indexed(gl, gl->viewports, GL_SCISSOR_TEST, 0, s->scissor);
    for (GLuint i = 0; i < (gl->indexed ? GSGI_TARGETS : 1u); ++i) {
        const GLboolean* mask = s->color_mask[i];
        set_indexed(gl, gl->indexed, GL_BLEND, i, s->blend[i]);
        if (gl->indexed)
            gl->ColorMaski(i, mask[0], mask[1], mask[2], mask[3]);
        else
            gl->ColorMask(mask[0], mask[1], mask[2], mask[3]);
    }
    const GLenum f[] = {(GLenum)s->blend_function[0], (GLenum)s->blend_function[1], (GLenum)s->blend_function[2],
                        (GLenum)s->blend_function[3]};
    const GLenum e[] = {(GLenum)s->blend_equation[0], (GLenum)s->blend_equation[1]};
    if (gl->indexed_blending) {
        gl->BlendFuncSeparatei(0, f[0], f[1], f[2], f[3]);
        gl->BlendEquationSeparatei(0, e[0], e[1]);
    } else {
        gl->BlendFuncSeparate(f[0], f[1], f[2], f[3]);
        gl->BlendEquationSeparate(e[0], e[1]);
    }
    gl->DepthMask(s->depth_mask);
    gl->DepthFunc((GLenum)s->depth_function);
    set_depth_range(gl, s->depth_range);
    for (int i = gl->es ? 2 : 0; i < 8; ++i) gl->PixelStorei(unpack[i], s->unpack[i]);
    gl->BindBuffer(GL_PIXEL_UNPACK_BUFFER, (GLuint)s->unpack_buffer);
    if (gl->clip_control) gl->ClipControl((GLenum)s->clip_origin, (GLenum)s->clip_depth);
    if (gl->compatible) {
        gl->PolygonMode(GL_FRONT, (GLenum)s->polygon_mode[0]);
        gl->PolygonMode(GL_BACK, (GLenum)s->polygon_mode[1]);
        gl->ClampColor(GL_CLAMP_FRAGMENT_COLOR, (GLenum)s->clamp_fragment_color);
    } else if (!gl->es) {
        gl->PolygonMode(GL_FRONT_AND_BACK, (GLenum)s->polygon_mode[0]);
    }
}

/* Objects, which the passes bind as they need them. */
static void write_bindings(const gsgi__gl* gl, const gsgi__state* s) {
    for (GLuint unit = 0; unit < GSGI_UNITS; ++unit) {
        gl->ActiveTexture(GL_TEXTURE0 + unit);
        gl->BindTexture(GL_TEXTURE_2D, (GLuint)s->textures[unit]);
        gl->BindSampler(unit, (GLuint)s->samplers[unit]);
    }
    gl->ActiveTexture((GLenum)s->active_texture);
    gl->BindFramebuffer(GL_DRAW_FRAMEBUFFER, (GLuint)s->framebuffer);
    gl->BindRenderbuffer(GL_RENDERBUFFER, (GLuint)s->renderbuffer);
    gl->BindVertexArray((GLuint)s->vertex_array);
    gl->BindBuffer(GL_ARRAY_BUFFER, (GLuint)s->array_buffer);
    /* A program that was deleted while in use ceases to exist once another is used. */
    if (s->program == 0 || gl->IsProgram((GLuint)s->program)) gl->UseProgram((GLuint)s->program);
}

void gsgi__state_begin(const gsgi__gl* gl, gsgi_state mode, gsgi__state* state) {
    const gsgi__state plain = initial();
    if (mode == GSGI_STATE_RESTORE) read(gl, state);
    write_fixed(gl, &plain);
}

void gsgi__state_end(const gsgi__gl* gl, gsgi_state mode, const gsgi__state* state) {
    const gsgi__state plain = initial();
    write_fixed(gl, mode == GSGI_STATE_RESTORE ? state : &plain);
    write_bindings(gl, mode == GSGI_STATE_RESTORE ? state : &plain);
    if (mode == GSGI_STATE_DEFAULTS) return;
    const GLfloat* v = state->viewport;
    if (gl->viewports)
        gl->ViewportIndexedf(0, v[0], v[1], v[2], v[3]);
    else
        gl->Viewport((GLint)v[0], (GLint)v[1], (GLsizei)v[2], (GLsizei)v[3]);
}

void gsgi__blend(const gsgi__gl* gl, bool on, GLenum source, GLenum destination) {
    for (GLuint i = 0; i < (gl->indexed ? GSGI_TARGETS : 1u); ++i)
        set_indexed(gl, gl->indexed, GL_BLEND, i, on && i == 0);
    if (gl->indexed_blending)
        gl->BlendFuncSeparatei(0, source, destination, source, destination);
    else
        gl->BlendFuncSeparate(source, destination, source, destination);
}

void gsgi__viewport(const gsgi__gl* gl, GLint x, GLint y, GLsizei width, GLsizei height) {
    if (gl->viewports)
        gl->ViewportIndexedf(0, (GLfloat)x, (GLfloat)y, (GLfloat)width, (GLfloat)height);
    else
        gl->Viewport(x, y, width, height);
}
