/* OpenGL as the library uses it: its own few types, numbers and functions, so that no header of a system is needed. */
#ifndef GSGI_GL_H
#define GSGI_GL_H

#include "internal.h"

typedef unsigned int GLenum, GLuint, GLbitfield;
typedef int GLint, GLsizei;
typedef unsigned char GLboolean, GLubyte;
typedef float GLfloat;
typedef double GLdouble;
typedef char GLchar;
typedef ptrdiff_t GLsizeiptr, GLintptr;

#if defined(_WIN32)
#define GSGI_GLAPI __stdcall
#else
#define GSGI_GLAPI
#endif

/* clang-format off */
enum {
    GL_FALSE = 0, GL_TRUE = 1, GL_NONE = 0, GL_ZERO = 0, GL_ONE = 1, GL_NO_ERROR = 0,
    GL_TRIANGLES = 0x0004, GL_TRIANGLE_STRIP = 0x0005,
    GL_LESS = 0x0201, GL_ALWAYS = 0x0207, GL_ONE_MINUS_SRC_ALPHA = 0x0303,
    GL_FRONT = 0x0404, GL_BACK = 0x0405, GL_FRONT_AND_BACK = 0x0408, GL_OUT_OF_MEMORY = 0x0505,
    GL_POLYGON_MODE = 0x0B40, GL_POLYGON_SMOOTH = 0x0B41, GL_POLYGON_STIPPLE = 0x0B42, GL_CULL_FACE = 0x0B44,
    GL_DEPTH_RANGE = 0x0B70, GL_DEPTH_TEST = 0x0B71, GL_DEPTH_WRITEMASK = 0x0B72, GL_DEPTH_FUNC = 0x0B74,
    GL_STENCIL_TEST = 0x0B90, GL_VIEWPORT = 0x0BA2, GL_ALPHA_TEST = 0x0BC0, GL_BLEND = 0x0BE2,
    GL_COLOR_LOGIC_OP = 0x0BF2, GL_SCISSOR_TEST = 0x0C11, GL_COLOR_WRITEMASK = 0x0C23,
    GL_UNPACK_SWAP_BYTES = 0x0CF0, GL_UNPACK_LSB_FIRST = 0x0CF1, GL_UNPACK_ROW_LENGTH = 0x0CF2,
    GL_UNPACK_SKIP_ROWS = 0x0CF3, GL_UNPACK_SKIP_PIXELS = 0x0CF4, GL_UNPACK_ALIGNMENT = 0x0CF5,
    GL_MAX_TEXTURE_SIZE = 0x0D33, GL_MAX_DRAW_BUFFERS = 0x8824,
    GL_MAX_COLOR_ATTACHMENTS = 0x8CDF, GL_TEXTURE_2D = 0x0DE1, GL_TEXTURE_WIDTH = 0x1000, GL_TEXTURE_HEIGHT = 0x1001,
    GL_TEXTURE_INTERNAL_FORMAT = 0x1003, GL_INT = 0x1404, GL_UNSIGNED_INT = 0x1405, GL_FLOAT = 0x1406,
    GL_HALF_FLOAT = 0x140B, GL_UNSIGNED_SHORT = 0x1403, GL_RED_INTEGER = 0x8D94, GL_R16UI = 0x8234, GL_R32UI = 0x8236,
    GL_COLOR = 0x1800, GL_TEXTURE = 0x1702, GL_DEPTH_COMPONENT = 0x1902, GL_RGBA = 0x1908,
    GL_FILL = 0x1B02, GL_VERSION = 0x1F02, GL_EXTENSIONS = 0x1F03, GL_NEAREST = 0x2600,
    GL_TEXTURE_MAG_FILTER = 0x2800, GL_TEXTURE_MIN_FILTER = 0x2801, GL_CLIP_DISTANCE0 = 0x3000, GL_FUNC_ADD = 0x8006,
    GL_BLEND_EQUATION_RGB = 0x8009, GL_POLYGON_OFFSET_FILL = 0x8037, GL_TEXTURE_RED_SIZE = 0x805C,
    GL_TEXTURE_BINDING_2D = 0x8069, GL_UNPACK_SKIP_IMAGES = 0x806D, GL_UNPACK_IMAGE_HEIGHT = 0x806E,
    GL_SAMPLE_ALPHA_TO_COVERAGE = 0x809E, GL_SAMPLE_COVERAGE = 0x80A0, GL_BLEND_DST_RGB = 0x80C8,
    GL_BLEND_SRC_RGB = 0x80C9, GL_BLEND_DST_ALPHA = 0x80CA, GL_BLEND_SRC_ALPHA = 0x80CB,
    GL_TEXTURE_BASE_LEVEL = 0x813C, GL_DEPTH_COMPONENT24 = 0x81A6, GL_MAJOR_VERSION = 0x821B,
    GL_MINOR_VERSION = 0x821C, GL_NUM_EXTENSIONS = 0x821D, GL_TEXTURE0 = 0x84C0, GL_ACTIVE_TEXTURE = 0x84E0,
    GL_VERTEX_ARRAY_BINDING = 0x85B5, GL_DEPTH_CLAMP = 0x864F, GL_RGBA32F = 0x8814,
    GL_RGBA16F = 0x881A, GL_DRAW_BUFFER0 = 0x8825, GL_BLEND_EQUATION_ALPHA = 0x883D, GL_TEXTURE_DEPTH_SIZE = 0x884A,
    GL_TEXTURE_COMPARE_MODE = 0x884C, GL_ARRAY_BUFFER = 0x8892, GL_ARRAY_BUFFER_BINDING = 0x8894,
    GL_STREAM_DRAW = 0x88E0, GL_PIXEL_UNPACK_BUFFER = 0x88EC, GL_PIXEL_UNPACK_BUFFER_BINDING = 0x88EF,
    GL_CLAMP_FRAGMENT_COLOR = 0x891B, GL_SAMPLER_BINDING = 0x8919, GL_FRAGMENT_SHADER = 0x8B30,
    GL_VERTEX_SHADER = 0x8B31, GL_COMPILE_STATUS = 0x8B81, GL_LINK_STATUS = 0x8B82, GL_CURRENT_PROGRAM = 0x8B8D,
    GL_TEXTURE_RED_TYPE = 0x8C10, GL_UNSIGNED_NORMALIZED = 0x8C17, GL_SRGB = 0x8C40, GL_SRGB8_ALPHA8 = 0x8C43,
    GL_RASTERIZER_DISCARD = 0x8C89, GL_LOWER_LEFT = 0x8CA1, GL_DRAW_FRAMEBUFFER_BINDING = 0x8CA6,
    GL_RENDERBUFFER_BINDING = 0x8CA7, GL_DRAW_FRAMEBUFFER = 0x8CA9,
    GL_FRAMEBUFFER_ATTACHMENT_COMPONENT_TYPE = 0x8211, GL_FRAMEBUFFER_ATTACHMENT_OBJECT_TYPE = 0x8CD0,
    GL_FRAMEBUFFER_ATTACHMENT_OBJECT_NAME = 0x8CD1,
    GL_FRAMEBUFFER_COMPLETE = 0x8CD5, GL_COLOR_ATTACHMENT0 = 0x8CE0, GL_DEPTH_ATTACHMENT = 0x8D00,
    GL_RENDERBUFFER = 0x8D41, GL_SAMPLE_MASK = 0x8E51,
    GL_SIGNED_NORMALIZED = 0x8F9C, GL_PRIMITIVE_RESTART = 0x8F9D, GL_DEPTH_STENCIL_TEXTURE_MODE = 0x90EA,
    GL_CONTEXT_PROFILE_MASK = 0x9126, GL_CLIP_ORIGIN = 0x935C, GL_CLIP_DEPTH_MODE = 0x935D,
    GL_NEGATIVE_ONE_TO_ONE = 0x935E
};
/* clang-format on */

/* X(result, name, parameters): functions of OpenGL 3.3 and OpenGL ES 3.0 alike. */
#define GSGI_GL_COMMON(X) \
    X(void, ActiveTexture, (GLenum)) \
    X(void, AttachShader, (GLuint, GLuint)) \
    X(void, BindAttribLocation, (GLuint, GLuint, const GLchar*)) \
    X(void, BindBuffer, (GLenum, GLuint)) \
    X(void, BindFramebuffer, (GLenum, GLuint)) \
    X(void, BindRenderbuffer, (GLenum, GLuint)) \
    X(void, BindSampler, (GLuint, GLuint)) \
    X(void, BindTexture, (GLenum, GLuint)) \
    X(void, BindVertexArray, (GLuint)) \
    X(void, BlendEquationSeparate, (GLenum, GLenum)) \
    X(void, BlendFuncSeparate, (GLenum, GLenum, GLenum, GLenum)) \
    X(void, BufferData, (GLenum, GLsizeiptr, const void*, GLenum)) \
    X(void, BufferSubData, (GLenum, GLintptr, GLsizeiptr, const void*)) \
    X(GLenum, CheckFramebufferStatus, (GLenum)) \
    X(void, ClearBufferfv, (GLenum, GLint, const GLfloat*)) \
    X(void, ColorMask, (GLboolean, GLboolean, GLboolean, GLboolean)) \
    X(void, CompileShader, (GLuint)) \
    X(GLuint, CreateProgram, (void)) \
    X(GLuint, CreateShader, (GLenum)) \
    X(void, DeleteBuffers, (GLsizei, const GLuint*)) \
    X(void, DeleteFramebuffers, (GLsizei, const GLuint*)) \
    X(void, DeleteProgram, (GLuint)) \
    X(void, DeleteRenderbuffers, (GLsizei, const GLuint*)) \
    X(void, DeleteSamplers, (GLsizei, const GLuint*)) \
    X(void, DeleteShader, (GLuint)) \
    X(void, DeleteTextures, (GLsizei, const GLuint*)) \
    X(void, DeleteVertexArrays, (GLsizei, const GLuint*)) \
    X(void, DepthFunc, (GLenum)) \
    X(void, DepthMask, (GLboolean)) \
    X(void, Disable, (GLenum)) \
    X(void, DrawArrays, (GLenum, GLint, GLsizei)) \
    X(void, DrawArraysInstanced, (GLenum, GLint, GLsizei, GLsizei)) \
    X(void, DrawBuffers, (GLsizei, const GLenum*)) \
    X(void, Enable, (GLenum)) \
    X(void, EnableVertexAttribArray, (GLuint)) \
    X(void, FramebufferRenderbuffer, (GLenum, GLenum, GLenum, GLuint)) \
    X(void, FramebufferTexture2D, (GLenum, GLenum, GLenum, GLuint, GLint)) \
    X(void, GenBuffers, (GLsizei, GLuint*)) \
    X(void, GenFramebuffers, (GLsizei, GLuint*)) \
    X(void, GenRenderbuffers, (GLsizei, GLuint*)) \
    X(void, GenSamplers, (GLsizei, GLuint*)) \
    X(void, GenTextures, (GLsizei, GLuint*)) \
    X(void, GenVertexArrays, (GLsizei, GLuint*)) \
    X(void, GetBooleanv, (GLenum, GLboolean*)) \
    X(GLenum, GetError, (void)) \
    X(void, GetFloatv, (GLenum, GLfloat*)) \
    X(void, GetFramebufferAttachmentParameteriv, (GLenum, GLenum, GLenum, GLint*)) \
    X(void, GetIntegerv, (GLenum, GLint*)) \
    X(void, GetProgramInfoLog, (GLuint, GLsizei, GLsizei*, GLchar*)) \
    X(void, GetProgramiv, (GLuint, GLenum, GLint*)) \
    X(void, GetShaderInfoLog, (GLuint, GLsizei, GLsizei*, GLchar*)) \
    X(void, GetShaderiv, (GLuint, GLenum, GLint*)) \
    X(const GLubyte*, GetString, (GLenum)) \
    X(const GLubyte*, GetStringi, (GLenum, GLuint)) \
    X(void, GetTexParameteriv, (GLenum, GLenum, GLint*)) \
    X(GLint, GetUniformLocation, (GLuint, const GLchar*)) \
    X(GLboolean, IsEnabled, (GLenum)) \
    X(GLboolean, IsFramebuffer, (GLuint)) \
    X(GLboolean, IsProgram, (GLuint)) \
    X(void, LinkProgram, (GLuint)) \
    X(void, PixelStorei, (GLenum, GLint)) \
    X(void, RenderbufferStorage, (GLenum, GLenum, GLsizei, GLsizei)) \
    X(void, SamplerParameteri, (GLuint, GLenum, GLint)) \
    X(void, ShaderSource, (GLuint, GLsizei, const GLchar* const*, const GLint*)) \
    X(void, TexImage2D, (GLenum, GLint, GLint, GLsizei, GLsizei, GLint, GLenum, GLenum, const void*)) \
    X(void, TexParameteri, (GLenum, GLenum, GLint)) \
    X(void, TexSubImage2D, (GLenum, GLint, GLint, GLint, GLsizei, GLsizei, GLenum, GLenum, const void*)) \
    X(void, Uniform1f, (GLint, GLfloat)) \
    X(void, Uniform1i, (GLint, GLint)) \
    X(void, Uniform2f, (GLint, GLfloat, GLfloat)) \
    X(void, Uniform3f, (GLint, GLfloat, GLfloat, GLfloat)) \
    X(void, UniformMatrix4fv, (GLint, GLsizei, GLboolean, const GLfloat*)) \
    X(void, UseProgram, (GLuint)) \
    X(void, VertexAttribDivisor, (GLuint, GLuint)) \
    X(void, VertexAttribIPointer, (GLuint, GLint, GLenum, GLsizei, const void*)) \
    X(void, Viewport, (GLint, GLint, GLsizei, GLsizei))

/* Functions of only some versions; each is NULL or called behind a flag of gsgi__gl. */
#define GSGI_GL_DESKTOP(X) \
    X(void, ClampColor, (GLenum, GLenum)) \
    X(void, DepthRange, (GLdouble, GLdouble)) \
    X(void, GetDoublev, (GLenum, GLdouble*)) \
    X(void, PolygonMode, (GLenum, GLenum))
#define GSGI_GL_ES(X) X(void, DepthRangef, (GLfloat, GLfloat))
#define GSGI_GL_INDEXED(X) \
    X(void, ColorMaski, (GLuint, GLboolean, GLboolean, GLboolean, GLboolean)) \
    X(void, Disablei, (GLenum, GLuint)) \
    X(void, Enablei, (GLenum, GLuint)) \
    X(void, GetBooleani_v, (GLenum, GLuint, GLboolean*)) \
    X(GLboolean, IsEnabledi, (GLenum, GLuint))
#define GSGI_GL_INDEXED_BLENDING(X) \
    X(void, BlendEquationSeparatei, (GLuint, GLenum, GLenum)) \
    X(void, BlendFuncSeparatei, (GLuint, GLenum, GLenum, GLenum, GLenum)) \
    X(void, GetIntegeri_v, (GLenum, GLuint, GLint*))
#define GSGI_GL_VIEWPORTS(X) \
    X(void, DepthRangeIndexed, (GLuint, GLdouble, GLdouble)) \
    X(void, ViewportIndexedf, (GLuint, GLfloat, GLfloat, GLfloat, GLfloat))
#define GSGI_GL_CLIP_CONTROL(X) X(void, ClipControl, (GLenum, GLenum))
#define GSGI_GL_TEXTURE_LEVELS(X) X(void, GetTexLevelParameteriv, (GLenum, GLint, GLenum, GLint*))

/* clang-format off */
#define GSGI_GL_ALL(X) \
    GSGI_GL_COMMON(X) GSGI_GL_DESKTOP(X) GSGI_GL_ES(X) GSGI_GL_INDEXED(X) GSGI_GL_INDEXED_BLENDING(X) \
    GSGI_GL_VIEWPORTS(X) GSGI_GL_CLIP_CONTROL(X) GSGI_GL_TEXTURE_LEVELS(X)
/* clang-format on */

#define GSGI_DRAW_BUFFERS 16 /* of a host's framebuffer that are looked at */

typedef struct gsgi__gl {
#define GSGI_GL_MEMBER(result, name, parameters) result(GSGI_GLAPI* name) parameters;
    GSGI_GL_ALL(GSGI_GL_MEMBER)
#undef GSGI_GL_MEMBER
    int version; /* such as 330 */
    bool es, compatible;
    bool indexed;          /* switches and masks by draw buffer */
    bool indexed_blending; /* blend functions by draw buffer */
    bool float_blend;      /* whether targets of whole floats can be blended */
    bool viewports, clip_control, texture_levels, stencil_textures;
    GLint texture_size_max, draw_buffers, color_attachments; /* the latter two at most GSGI_DRAW_BUFFERS */
} gsgi__gl;

/* Load what the current context has. */
gsgi_result gsgi__gl_load(gsgi__gl* gl, const gsgi_context_options* options);

/* ---- Programs ---- */

typedef enum gsgi__uniform {
    U_VIEW_FROM_WORLD,
    U_WORLD_FROM_VIEW,
    U_WORLD_FROM_OFFSET,
    U_AXIS,
    U_CENTRE,
    U_CORNER,
    U_DEPTH_ENDS,
    U_DEPTH_LINE,
    U_EYE,
    U_FOCAL,
    U_PARALLEL,
    U_SECTOR_CLASS,
    U_SECTOR_COUNT,
    U_SECTOR_HIGH,
    U_SECTOR_LOW,
    U_SIZE,
    U_Z_TO_CLIP,
    U_COUNT
} gsgi__uniform;

typedef struct gsgi__program {
    GLuint name;
    GLint at[U_COUNT];
} gsgi__program;

/* Compile a pass. `pass` names it in messages; `defines` is GLSL, lines of #define. The program is in use afterwards.
 */
gsgi_result gsgi__program_create(const gsgi__gl* gl, const gsgi_callbacks* callbacks, const char* pass,
                                 const char* vertex, const char* fragment, const char* defines, gsgi__program* program);

void gsgi__set_float(const gsgi__gl* gl, const gsgi__program* program, const char* name, double value);
void gsgi__set_matrix(const gsgi__gl* gl, const gsgi__program* program, gsgi__uniform uniform,
                      const gsgi__matrix* value);

/* ---- State ---- */

#define GSGI_UNITS 6   /* texture units that the passes use */
#define GSGI_TARGETS 3 /* draw buffers that they write */
#define GSGI_SWITCHES_MAX 32

/* What a host has set. */
typedef struct gsgi__state {
    bool switches[GSGI_SWITCHES_MAX], scissor, blend[GSGI_TARGETS];
    GLboolean color_mask[GSGI_TARGETS][4], depth_mask;
    GLint blend_function[4], blend_equation[2], depth_function, polygon_mode[2], clamp_fragment_color;
    GLint framebuffer, renderbuffer, vertex_array, array_buffer, unpack_buffer, program, active_texture;
    GLint textures[GSGI_UNITS], samplers[GSGI_UNITS], unpack[8], clip_origin, clip_depth;
    GLfloat viewport[4];
    GLdouble depth_range[2];
} gsgi__state;

/* Read or assume the host's state, and set what the passes need; set it back. */
void gsgi__state_begin(const gsgi__gl* gl, gsgi_state mode, gsgi__state* state);
void gsgi__state_end(const gsgi__gl* gl, gsgi_state mode, const gsgi__state* state);

/* State that the passes change. Those of blending and of the viewport leave other draw buffers and viewports alone.
 */
void gsgi__blend(const gsgi__gl* gl, bool on, GLenum source, GLenum destination);
void gsgi__viewport(const gsgi__gl* gl, GLint x, GLint y, GLsizei width, GLsizei height);

#endif
