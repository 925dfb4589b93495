/* A context, a light in it, and the passes of both operators. */
#ifndef GSGI_LIGHT_H
#define GSGI_LIGHT_H

#include "gl.h"

#define GSGI_KINDS 18 /* of look-ups: by the SH degrees of both levels, and relief */

struct gsgi_context {
    gsgi_callbacks callbacks;
    gsgi_state state;
    bool lost;
    gsgi__gl gl;
    GLuint sampler;  /* reads single texels, whatever the textures say */
    GLuint triangle; /* vertex array without attributes */
};

/* What a light has of one bake. */
typedef struct gsgi__part {
    const gsgi__program* program; /* of the light: the pass that draws or reads it */
    size_t bytes;                 /* on the GPU */
    bool in_view;
    uint32_t drawn[2]; /* Gaussians by level, where it is in view: `surface` reads any of them */
    /* `over`: */
    gsgi__culled culled;
    GLuint shape, sh, index, strips; /* data textures, instance buffer, vertex array */
    /* `surface`: */
    GLuint tables[3];    /* textures of its look-up */
    gsgi_lookup* lookup; /* what gsgi_light_recolour needs of it; NULL: there are no light groups, or the bake has it */
    /* of a sector of a world: */
    uint32_t serial, class;
    float low[3], high[3], weight; /* its box for glsl/surface/sector.glsl, from the light's origin */
    float ball[4];                 /* centre and radius of a ball around all that it lights */
} gsgi__part;

/* Targets for one size of the view. Those of `surface` are as large as the readings but for `indirect`. */
typedef struct gsgi__targets {
    int32_t width, height;           /* px, of the view; 0: none yet */
    int32_t read_width, read_height; /* px */
    size_t bytes;
    GLuint position, plane, bend, filled, indirect;
    GLuint rest; /* a renderbuffer of depth, as large as the view: 0 where surface/smooth has all light */
    GLuint points, filled_sums, resolved; /* framebuffers */
} gsgi__targets;

/* Names that passed the checks for this viewport; others are looked at. 0: none did. */
typedef struct gsgi__checked {
    GLuint depth, normal, mapped, framebuffer, albedo;
} gsgi__checked;

struct gsgi_light {
    gsgi_context* context;
    gsgi_light_options options;
    gsgi_info info;
    bool relief; /* whether B follows normal maps */
    double origin[3];
    uint32_t crc; /* of the file */
    gsgi__part** parts;
    uint32_t part_count;
    bool sectors; /* whether the parts are those of a world */
    double margin;
    float* rows;  /* of `table`: for each part, lowest corner and weight, highest corner and class */
    GLuint table; /* what glsl/surface/points.frag reads of sectors */
    gsgi__camera camera;
    bool has_view, has_drawn;
    gsgi__program programs[GSGI_KINDS];           /* of parts: `surface` has one for each kind of look-up */
    uint32_t kinds[GSGI_KINDS][3], program_count; /* kinds: counts of the look-up */
    gsgi__program points, smooth, resolve, add_light;
    gsgi__targets targets;
    gsgi__checked checked;
    int32_t viewport[4]; /* of the last cull */
};

/* ---- context.c ---- */

gsgi_result gsgi__check_context(const gsgi_context* context);
/* Errors that the host left unread would be taken for ours. */
void gsgi__drain_errors(const gsgi_context* context);
/* Whether OpenGL had the memory for what was just made. */
gsgi_result gsgi__check_memory(const gsgi_context* context);

/* ---- drawing.c ---- */

/* Formats that differ in what a texel is in memory: sized, of channels, of a channel. */
typedef struct gsgi__format {
    GLenum internal, channels, type;
} gsgi__format;

/* A texture that is read texel by texel. Changes unit 0. */
GLuint gsgi__texture_of(const gsgi__gl* gl, gsgi__format format, int32_t width, int32_t height, const void* texels);
/* Overwrite the first `rows` of a data texture of Gaussians. Changes unit 0. */
void gsgi__write_rows(const gsgi__gl* gl, GLuint texture, uint32_t rows, const float* texels);
void gsgi__bind_texture(const gsgi__gl* gl, GLuint unit, GLuint texture);
void gsgi__use_sampler(const gsgi_context* context);
/* A pass over all pixels of the framebuffer and viewport that are set. */
void gsgi__draw_triangle(const gsgi_context* context, const gsgi__program* program);
/* Texture of a target, or 0; its bytes are added to those of the light's targets. */
GLuint gsgi__target_texture(gsgi_light* light, GLenum format, int32_t width, int32_t height);
GLuint gsgi__target_depth(gsgi_light* light, int32_t width, int32_t height); /* a renderbuffer */
/* Framebuffer with these attachments; those that are 0 are left out. Fails if the driver does not take it. */
gsgi_result gsgi__target(gsgi_light* light, const GLuint colors[GSGI_TARGETS], GLuint depth, GLuint* framebuffer);
void gsgi__targets_release(gsgi_light* light);
void gsgi__clear_color(const gsgi__gl* gl, GLuint framebuffer);

/* ---- parts.c ---- */

/* Upload a bake; the part is the caller's. */
gsgi_result gsgi__part_create(gsgi_light* light, const gsgi_bake* bake, gsgi__part** part);
void gsgi__part_destroy(const gsgi_context* context, gsgi__part* part);
void gsgi__cull_parts(gsgi_light* light);

/* ---- lookup_textures.c ---- */

/* Make the textures of a look-up, which are the caller's. Changes unit 0. */
gsgi_result gsgi__lookup_textures(const gsgi_context* context, const gsgi_lookup* lookup, GLuint textures[3]);

/* ---- surface.c, over.c ---- */

/* The program that reads a look-up, made when it is first asked for. */
gsgi_result gsgi__surface_program(gsgi_light* light, const gsgi_lookup* lookup, const gsgi__program** program);
gsgi_result gsgi__over_program(gsgi_light* light, const gsgi__program** program);

/* The passes; the targets for the size of the view; a frame. */
gsgi_result gsgi__surface_create(gsgi_light* light);
gsgi_result gsgi__surface_create_targets(gsgi_light* light);
void gsgi__surface_draw(const gsgi_light* light, GLuint depth, GLuint normal, GLuint mapped);
gsgi_result gsgi__over_create_targets(gsgi_light* light);
void gsgi__over_draw(const gsgi_light* light);

/* ---- host_textures.c ---- */

/* Refuse textures that cannot be what the light's options say; `mapped` may be 0. Changes unit 0. */
gsgi_result gsgi__check_surfaces(gsgi_light* light, GLuint depth, GLuint normal, GLuint mapped);
gsgi_result gsgi__check_addition(gsgi_light* light, GLuint framebuffer, GLuint albedo);

/* Parameters of a host's texture that passes need otherwise. */
typedef struct gsgi__readable {
    GLuint texture;
    GLint base_level, stencil_mode;
} gsgi__readable;

/* Let shaders read level 0 of a host's texture, and the depth of one that has stencil too; undo that. Both change unit
 * 0. */
gsgi__readable gsgi__make_readable(const gsgi__gl* gl, GLuint texture);
void gsgi__unmake_readable(const gsgi__gl* gl, const gsgi__readable* readable);

#endif
