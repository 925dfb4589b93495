/* The functions of a context, and programs. */
#include "gl.h"

#include <stdio.h>
#include <string.h>

static bool has_extension(const gsgi__gl* gl, const char* name) {
    GLint count = 0;
    gl->GetIntegerv(GL_NUM_EXTENSIONS, &count);
    for (GLint i = 0; i < count; ++i) {
        const GLubyte* found = gl->GetStringi(GL_EXTENSIONS, (GLuint)i);
        if (found && strcmp((const char*)found, name) == 0) return true;
    }
    return false;
}

/* Load a function by the name that this context has for it, or return. */
#define LOAD_AS(result, name, parameters, found) \
    gl->name = (result(GSGI_GLAPI*) parameters)options->get_proc_address(found, options->get_proc_address_user); \
    if (!gl->name) \
        return gsgi__fail(&options->callbacks, GSGI_UNSUPPORTED, "get_proc_address: there is no function %s", found);
#define LOAD(result, name, parameters) LOAD_AS(result, name, parameters, "gl" #name)
static gsgi_result load_optional(gsgi__gl* gl, const gsgi_context_options* options) {
    const bool desktop = !gl->es;
    gl->indexed = desktop || gl->version >= 320;
    gl->indexed_blending = desktop ? gl->version >= 400 || has_extension(gl, "GL_ARB_draw_buffers_blend") : gl->indexed;
    gl->viewports = desktop && (gl->version >= 410 || has_extension(gl, "GL_ARB_viewport_array"));
    gl->clip_control = desktop ? gl->version >= 450 || has_extension(gl, "GL_ARB_clip_control")
                               : has_extension(gl, "GL_EXT_clip_control");
    gl->texture_levels = desktop || gl->version >= 310;
    gl->stencil_textures =
        desktop ? gl->version >= 430 || has_extension(gl, "GL_ARB_stencil_texturing") : gl->version >= 310;
    if (desktop) {
        GSGI_GL_DESKTOP(LOAD)
    } else {
        GSGI_GL_ES(LOAD)
    }
    if (gl->indexed) {
        GSGI_GL_INDEXED(LOAD)
    }
    if (gl->indexed_blending) {
        const bool core = gl->es || gl->version >= 400;
        const char* names[] = {core ? "glBlendEquationSeparatei" : "glBlendEquationSeparateiARB",
                               core ? "glBlendFuncSeparatei" : "glBlendFuncSeparateiARB"};
        LOAD_AS(void, BlendEquationSeparatei, (GLuint, GLenum, GLenum), names[0])
        LOAD_AS(void, BlendFuncSeparatei, (GLuint, GLenum, GLenum, GLenum, GLenum), names[1])
        LOAD(void, GetIntegeri_v, (GLenum, GLuint, GLint*))
    }
    if (gl->viewports) {
        GSGI_GL_VIEWPORTS(LOAD)
    }
    if (gl->clip_control) {
        const char* name = desktop ? "glClipControl" : "glClipControlEXT";
        LOAD_AS(void, ClipControl, (GLenum, GLenum), name)
    }
    if (gl->texture_levels) {
        GSGI_GL_TEXTURE_LEVELS(LOAD)
    }
    return GSGI_OK;
}

gsgi_result gsgi__gl_load(gsgi__gl* gl, const gsgi_context_options* options) {
    const gsgi_callbacks* callbacks = &options->callbacks;
    GLint major = 0, minor = 0, profile = 0;
    memset(gl, 0, sizeof *gl);
    GSGI_GL_COMMON(LOAD)
    const char* version = (const char*)gl->GetString(GL_VERSION);
    if (!version) return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT, "context: no OpenGL context is current");
    gl->es = strncmp(version, "OpenGL ES", 9) == 0;
    gl->GetIntegerv(GL_MAJOR_VERSION, &major);
    gl->GetIntegerv(GL_MINOR_VERSION, &minor);
    gl->version = 100 * major + 10 * minor;
    if (gl->version < (gl->es ? 300 : 330))
        return gsgi__fail(callbacks, GSGI_UNSUPPORTED, "context: OpenGL 3.3 or OpenGL ES 3.0 is needed, this is %s",
                          version);
    gl->float_blend = !gl->es || has_extension(gl, "GL_EXT_float_blend");
    if (gl->es) {
        if (!has_extension(gl, "GL_EXT_color_buffer_float"))
            return gsgi__fail(callbacks, GSGI_UNSUPPORTED, "context: GL_EXT_color_buffer_float is needed");
    } else {
        gl->GetIntegerv(GL_CONTEXT_PROFILE_MASK, &profile);
        gl->compatible = (profile & 2) != 0;
    }
    gl->GetIntegerv(GL_MAX_TEXTURE_SIZE, &gl->texture_size_max);
    gl->GetIntegerv(GL_MAX_DRAW_BUFFERS, &gl->draw_buffers);
    gl->GetIntegerv(GL_MAX_COLOR_ATTACHMENTS, &gl->color_attachments);
    if (gl->draw_buffers > GSGI_DRAW_BUFFERS) gl->draw_buffers = GSGI_DRAW_BUFFERS;
    if (gl->color_attachments > GSGI_DRAW_BUFFERS) gl->color_attachments = GSGI_DRAW_BUFFERS;
    return load_optional(gl, options);
}

/* ---- Programs ---- */

/* clang-format off */
static const char* const uniform_names[U_COUNT] = {
    "view_from_world", "world_from_view", "world_from_offset", "axis", "centre", "corner", "depth_ends", "depth_line",
    "eye", "focal", "parallel", "sector_class", "sector_count", "sector_high",
    "sector_low", "size", "z_to_clip"};

/* Samplers of all passes. A sampler's unit is the same in each pass that has it. */
static const struct { const char* name; GLint unit; } samplers[] = {
    {"shape_data", 0}, {"sh_data", 1}, {"gaussians", 0}, {"cells", 1}, {"surface_position", 2}, {"surface_plane", 3},
    {"surface_bend", 4}, {"lists", 5}, {"normal", 0}, {"depth", 1}, {"mapped", 2}, {"sectors", 3}, {"filled_sums", 2},
    {"albedo", 0}, {"indirect", 1}};
/* clang-format on */

static GLuint compile(const gsgi__gl* gl, const gsgi_callbacks* callbacks, const char* pass, GLenum stage,
                      const char* text, const char* defines) {
    const char* header = gl->es ? "#version 300 es\nprecision highp float;\nprecision highp int;\n"
                                  "precision highp sampler2D;\nprecision highp sampler2DShadow;\n"
                                : "#version 330\n";
    const char* parts[] = {header, defines, text};
    char message[900] = "";
    GLint compiled = 0;
    GLuint shader = gl->CreateShader(stage);
    gl->ShaderSource(shader, 3, parts, NULL);
    gl->CompileShader(shader);
    gl->GetShaderiv(shader, GL_COMPILE_STATUS, &compiled);
    if (compiled) return shader;
    gl->GetShaderInfoLog(shader, sizeof message, NULL, message);
    gsgi__log(callbacks, GSGI_ERROR, "%s: %s", pass, message);
    gl->DeleteShader(shader);
    return 0;
}

gsgi_result gsgi__program_create(const gsgi__gl* gl, const gsgi_callbacks* callbacks, const char* pass,
                                 const char* vertex, const char* fragment, const char* defines,
                                 gsgi__program* program) {
    char message[900] = "";
    GLint linked = 0;
    GLuint stages[2] = {compile(gl, callbacks, pass, GL_VERTEX_SHADER, vertex, defines),
                        compile(gl, callbacks, pass, GL_FRAGMENT_SHADER, fragment, defines)};
    if (stages[0] && stages[1]) {
        program->name = gl->CreateProgram();
        for (int i = 0; i < 2; ++i) gl->AttachShader(program->name, stages[i]);
        gl->BindAttribLocation(program->name, 0, "index");
        gl->LinkProgram(program->name);
        gl->GetProgramiv(program->name, GL_LINK_STATUS, &linked);
        if (!linked) {
            gl->GetProgramInfoLog(program->name, sizeof message, NULL, message);
            gsgi__log(callbacks, GSGI_ERROR, "%s: %s", pass, message);
        }
    }
    for (int i = 0; i < 2; ++i)
        if (stages[i]) gl->DeleteShader(stages[i]);
    if (!linked) return GSGI_DRIVER_ERROR;
    for (int i = 0; i < U_COUNT; ++i) program->at[i] = gl->GetUniformLocation(program->name, uniform_names[i]);
    gl->UseProgram(program->name);
    for (size_t i = 0; i < sizeof samplers / sizeof *samplers; ++i)
        gl->Uniform1i(gl->GetUniformLocation(program->name, samplers[i].name), samplers[i].unit);
    return GSGI_OK;
}

void gsgi__set_float(const gsgi__gl* gl, const gsgi__program* program, const char* name, double value) {
    gl->Uniform1f(gl->GetUniformLocation(program->name, name), (float)value);
}

void gsgi__set_matrix(const gsgi__gl* gl, const gsgi__program* program, gsgi__uniform uniform,
                      const gsgi__matrix* value) {
    float columns[16];
    for (int i = 0; i < 16; ++i) columns[i] = (float)value->at[i % 4][i / 4];
    gl->UniformMatrix4fv(program->at[uniform], 1, GL_FALSE, columns);
}
