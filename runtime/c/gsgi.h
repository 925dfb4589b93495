/*
 * gsgi: baked indirect light in any OpenGL 3.3 or OpenGL ES 3.0 renderer. C99, no dependencies.
 *
 *     gsgi_bake_open(file, size, NULL, &bake);                 once per .gsgi file, from memory
 *     gsgi_context_create(&context_options, &context);         once per OpenGL context
 *     gsgi_light_create(context, bake, &light_options, &light);
 *     gsgi_bake_close(bake);
 *
 *     gsgi_light_cull(light, &view);                           each frame and camera
 *     gsgi_light_draw(light, depth, normal, NULL);
 *     gsgi_light_add(light, framebuffer, albedo);              radiance += albedo * B
 *
 * What is added is B, the demodulated indirect light of the scene: linear Rec.709 radiance for an albedo of 1. The
 * renderer goes on drawing primary light: emission, and light straight from punctual lights.
 *
 * Space is glTF's: right-handed, +Y up, metres; the camera looks down -Z. Matrices are for column vectors and lie
 * column by column, as OpenGL takes them.
 *
 * Structs that functions take begin with struct_size. Zero-initialise them and set struct_size to their size: zeros are
 * the defaults, and a program keeps working with later versions of the library, whose structs only grow at their ends.
 *
 * Errors. Functions that can fail return a gsgi_result, and leave what they were to change as it was. The log callback
 * gets one line that names the argument or the place in the file. Wrong handles are not looked for; NULL is harmless
 * where a function destroys.
 *
 * Threads. The library has no global state. A bake changes in gsgi_bake_weigh alone, so any number of threads may read
 * it at other times. A world belongs to one thread at a time, but for gsgi_world_open_sector. A context and its lights
 * belong to one thread at a time, with that OpenGL context current, but for gsgi_light_cull.
 */
#ifndef GSGI_H
#define GSGI_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define GSGI_VERSION_MAJOR 0
#define GSGI_VERSION_MINOR 1
#define GSGI_VERSION_PATCH 0
#define GSGI_VERSION (GSGI_VERSION_MAJOR * 10000 + GSGI_VERSION_MINOR * 100 + GSGI_VERSION_PATCH)

/* GSGI_SHARED is defined by the CMake target of the shared library. */
#if defined(_WIN32) && defined(GSGI_SHARED)
#ifdef GSGI_BUILD
#define GSGI_API __declspec(dllexport)
#else
#define GSGI_API __declspec(dllimport)
#endif
#elif defined(__GNUC__)
#define GSGI_API __attribute__((visibility("default")))
#else
#define GSGI_API
#endif

typedef struct gsgi_bake gsgi_bake;       /* a decoded .gsgi file */
typedef struct gsgi_context gsgi_context; /* an OpenGL context of the host */
typedef struct gsgi_light gsgi_light;     /* a bake in a context */

typedef enum gsgi_result {
    GSGI_OK = 0,
    GSGI_INVALID_ARGUMENT, /* the log names it */
    GSGI_INVALID_FILE,     /* no .gsgi file of this library's version, or a damaged one; the log names byte and field */
    GSGI_OUT_OF_MEMORY,    /* the allocator returned NULL, or OpenGL had no memory */
    GSGI_UNSUPPORTED,      /* the driver lacks what the log names, or the file's operator cannot do this */
    GSGI_DRIVER_ERROR,     /* the driver refused a shader or a framebuffer; the log holds its message */
    GSGI_NOTHING_CULLED,   /* draw needs a cull before, add needs a draw */
    GSGI_CONTEXT_LOST      /* after gsgi_context_forget */
} gsgi_result;

typedef enum gsgi_severity { GSGI_ERROR = 0, GSGI_WARNING } gsgi_severity;

/* Where memory comes from and messages go. NULL: malloc, free, no messages. An arena has `allocate` alone. */
typedef struct gsgi_callbacks {
    void* (*allocate)(size_t size, void* user);                           /* aligned as malloc aligns */
    void (*release)(void* memory, void* user);                            /* `memory` is not NULL */
    void (*log)(gsgi_severity severity, const char* message, void* user); /* one line, without a line feed */
    void* user;
} gsgi_callbacks;

/* Version of the library that is linked: GSGI_VERSION of its header. */
GSGI_API int gsgi_version(void);

/* Name of a result, such as "GSGI_INVALID_FILE". Never NULL. */
GSGI_API const char* gsgi_result_string(gsgi_result result);

/* ---- Files ---------------------------------------------------------------------------------------------------- */

typedef struct gsgi_open_options {
    size_t struct_size;
    gsgi_callbacks callbacks;
    int32_t sampling; /* not 0: build the grids that make gsgi_bake_sample fast */
    int32_t lists;    /* not 0: make the tables of a `surface` light now, in this thread, so that gsgi_light_create has
                         but to upload them; they stay with the bake, and count in its bake_bytes */
} gsgi_open_options;

/* Effects of the scene that the file's light holds, or was made with; sums of these in gsgi_info.effects. */
enum {
    GSGI_EFFECT_PUNCTUAL = 1,
    GSGI_EFFECT_EMISSIVE = 2,
    GSGI_EFFECT_ALPHA_MASK = 4,
    GSGI_EFFECT_DENOISED = 8,
    GSGI_EFFECT_ENVIRONMENT = 16,
    GSGI_EFFECT_DOUBLE_SIDED = 32,
    GSGI_EFFECT_NORMAL_MAP = 64,
    GSGI_EFFECT_UNLIT = 128,
    GSGI_EFFECT_METAL = 256, /* B is to be multiplied by the base colour; without it by base colour * (1 - metallic) */
    GSGI_EFFECT_CLEAR_PANE = 512 /* shadow maps leave clear panes out: what lamps send through them is not in B */
};

typedef enum gsgi_operator {
    GSGI_OVER = 0,   /* Gaussians blended along the ray of each pixel */
    GSGI_SURFACE = 1 /* Gaussians averaged at surface points */
} gsgi_operator;

typedef enum gsgi_level { GSGI_FINE = 0, GSGI_COARSE = 1 } gsgi_level;

/* The header of a file, as runtime/file/FORMAT.md defines it, and what the file takes. */
typedef struct gsgi_info {
    size_t struct_size;
    gsgi_operator blend; /* the file's operator */
    uint32_t effects;
    uint32_t bounces;
    uint32_t sharpness; /* surface */
    uint64_t scene;     /* fingerprint of the scene's triangles; 0: unknown */
    float tone_scale;
    float near_plane, dilation, alpha_min, alpha_max; /* over */
    float cutoff, weight_floor, radius;               /* surface; radius: standard deviations at which weights end */
    uint32_t gaussian_count[2];                       /* by gsgi_level */
    uint32_t sh_degree[2];
    int32_t sloped[2];    /* whether the light changes linearly over a Gaussian */
    double bounds_low[3]; /* of the centres of all Gaussians, world space, m; 0 without any */
    double bounds_high[3];
    size_t bake_bytes;    /* memory that the bake holds */
    size_t light_bytes;   /* memory on the GPU that a light of it holds for Gaussians. `surface`: 48 bytes each, and 16
                             for each SH coefficient; lists by place come on top (gsgi_stats.gaussian_bytes has all).
                             `over`: 48 each, 16 for each four numbers of SH (or part of four), 4 for its index */
    uint32_t group_count; /* light groups; 0 where the lights were not baked apart */
    int32_t relief;       /* whether the light of the fine level follows normal maps */
} gsgi_info;

/* The Gaussians of a level as texels: RGBA32F, 2048 wide, row by row. `shape` and `sh` are the data textures that
 * glsl/lib/gaussian.glsl reads. A renderer without OpenGL uploads those for `over`, and for `surface` the tables of
 * gsgi_lookup_info, and runs the passes that glsl/README.md lists. They live as long as the bake. Positions are
 * relative to `origin`, m, which is 0 unless the scene lies far from the world's. */
typedef struct gsgi_texels {
    size_t struct_size;
    const float* shape;                       /* 3 texels per Gaussian: position, opacity; rotation xyzw; scale, 0 */
    const float* sh;                          /* (3 (sh_degree + 1)^2 + 3) / 4 texels per Gaussian */
    const float* slope;                       /* 1 texel per Gaussian; NULL where the level is not sloped */
    uint32_t shape_rows, sh_rows, slope_rows; /* 0 in a level without Gaussians */
    double origin[3];
    const float* relief; /* of the fine level, 3 texels per Gaussian; NULL where the file has none */
    uint32_t relief_rows;
} gsgi_texels;

/* Decode the `size` bytes of a .gsgi file. `data` may be freed afterwards. `options` may be NULL.
 *
 * Safe for untrusted files: what the specification says a reader must refuse is GSGI_INVALID_FILE, nothing is allocated
 * before all lengths are checked, and no file makes it allocate more than 100 times its size and 256 KB: usual ones
 * 5 times (with sampling 310 bytes per Gaussian and 260 KB more). */
GSGI_API gsgi_result gsgi_bake_open(const void* data, size_t size, const gsgi_open_options* options, gsgi_bake** bake);

/* Fill `info`, whose struct_size is set. */
GSGI_API gsgi_result gsgi_bake_info(const gsgi_bake* bake, gsgi_info* info);

/* Fill `texels`, whose struct_size is set, for a level. */
GSGI_API gsgi_result gsgi_bake_texels(const gsgi_bake* bake, gsgi_level level, gsgi_texels* texels);

/* B at `count` surface points. `surface` files only; others are GSGI_UNSUPPORTED. It is the light that gsgi_light_draw
 * puts into a pixel that shows the point.
 *
 * positions: 3 * count, world space, m. normals: 3 * count, world space, of any length. light: 3 * count, written; 0
 * where no Gaussian reaches, where a number is not finite, and where a normal is 0. */
GSGI_API gsgi_result gsgi_bake_sample(const gsgi_bake* bake, size_t count, const float* positions, const float* normals,
                                      float* light);

/* The same, with B that follows normal maps, where the file says how (gsgi_info.relief). mapped: 3 * count, world
 * space, the normals as normal maps bend them, of any length. Where one is 0 or not finite, and with NULL for `mapped`,
 * nothing is bent. */
GSGI_API gsgi_result gsgi_bake_sample_mapped(const gsgi_bake* bake, size_t count, const float* positions,
                                             const float* normals, const float* mapped, float* light);

/* The same for what was not in the scene when it was baked, such as moving objects, particles and probes: the light of
 * free space alone. Close to a baked surface gsgi_bake_sample would give the light of that surface. It is faster, too.
 */
GSGI_API gsgi_result gsgi_bake_sample_free(const gsgi_bake* bake, size_t count, const float* positions,
                                           const float* normals, float* light);

/* Free the bake. Lights that were made of it stay. */
GSGI_API void gsgi_bake_close(gsgi_bake* bake);

/* Light groups: sets of the scene's lights whose light was baked apart (`gsgi bake --group lamps=lamp*`), and can be
 * switched, dimmed and recoloured in any frame:
 *
 *     float weights[] = {1, 1, 1, 0.2f, 0.2f, 0.2f};       one group after the other: "base", "lamps"
 *     gsgi_bake_weigh(bake, 2, weights);                   when weights change
 *     gsgi_light_recolour(light, bake);
 *     gsgi_lookup_recolour(lookup, bake);                  and gsgi_lookup_update for its texture
 *
 * To draw then takes as long as without groups. The host dims its own direct light by the same factors. */

/* Name of the group `index`, in UTF-8, in the order of the file; NULL from gsgi_info.group_count on. "base" are the
 * lights that are in no other group. It lives as long as the bake. */
GSGI_API const char* gsgi_bake_group_name(const gsgi_bake* bake, uint32_t index);

/* Multiply the light of each group by its weight: 3 * group_count numbers from 0 to 1e15, linear Rec.709; NULL stands
 * for ones, with which a bake is opened. From then on gsgi_bake_texels, gsgi_bake_sample and all that is made of the
 * bake have that light; its texels stay where they are. `group_count` is that of gsgi_info. It takes a sum over the
 * groups, and allocates nothing. Nothing else may use the bake meanwhile. */
GSGI_API gsgi_result gsgi_bake_weigh(gsgi_bake* bake, uint32_t group_count, const float* weights);

/* ---- Light in shaders of the host: forward renderers, blended and moving surfaces, vertices, particles ---------- */

typedef struct gsgi_lookup gsgi_lookup;

/* What the GLSL function `vec3 gsgi_indirect(vec3 position, vec3 normal)` needs: B, linear radiance for albedo 1, at a
 * point in world space. With `vec3 mapped` behind, the normal as a normal map bends it, B follows that map, where the
 * file says how (gsgi_info.relief). Tables are texels of textures 2048 wide, row by row, read by texelFetch alone. They
 * are those of Python's gsgi.IndirectLookup, bit for bit on x86-64, and live as long as the look-up. */
typedef struct gsgi_lookup_info {
    size_t struct_size;
    const char* source;     /* GLSL without #version, for `#version 330` and `#version 300 es`; the latter with
                               `precision highp float`, `int`, `sampler2D` and `usampler2D` */
    const float* gaussians; /* RGBA32F, the sampler gsgi_gaussians */
    const uint32_t* cells;  /* R32UI, the sampler gsgi_cells */
    const void* lists;      /* R16UI or R32UI, the sampler gsgi_lists */
    uint32_t gaussian_rows, cell_rows, list_rows;
    uint32_t list_bits; /* 16, or 32 where these are too few: for more than 65,536 Gaussians */
    size_t bytes;       /* of the three textures */
} gsgi_lookup_info;

/* Make the tables of a bake, in a fraction of a second. `surface` files only; others are GSGI_UNSUPPORTED, and so is
 * one of more than 16 million texels. While it works it takes some 100 bytes for each pair of a Gaussian and a cell
 * that it reaches. The bake may be closed afterwards.
 *
 * The tables take 16 bytes for each of 3 texels and of the SH coefficients of a Gaussian, for 3 more with relief, and
 * lists, of default bakes some 150 bytes per Gaussian: more, where many lie at the same place. */
GSGI_API gsgi_result gsgi_lookup_open(const gsgi_bake* bake, gsgi_lookup** lookup);

/* Fill `info`, whose struct_size is set. */
GSGI_API gsgi_result gsgi_lookup_read(const gsgi_lookup* lookup, gsgi_lookup_info* info);

/* Give the table `gaussians` the light that the bake, the one of which the look-up was made, has now, after
 * gsgi_bake_weigh. */
GSGI_API gsgi_result gsgi_lookup_recolour(gsgi_lookup* lookup, const gsgi_bake* bake);

GSGI_API void gsgi_lookup_close(gsgi_lookup* lookup);

/* ---- Worlds: light in sectors, one .gsgi file each, and a manifest that lists them ------------------------------ */

/* A world tells which sectors are to be in memory around an eye, and fades their light in and out. It opens no file and
 * has no thread: the host reads what is asked for, in a job if it likes.
 *
 *     gsgi_world_open(manifest, size, &world_options, &world);        once, from level.gsgi.json in memory
 *     gsgi_light_create_world(context, world, &light_options, &light);
 *
 *     gsgi_world_update(world, eye, seconds, &load);                  each frame
 *     if (load >= 0) start_job(load);
 *     gsgi_light_follow(light, world);
 *     gsgi_light_cull(light, &view);                                  and draw and add, as of a single bake
 *
 *     job:   data = all of the file gsgi_sector.file, in the folder of the manifest
 *            gsgi_world_open_sector(world, load, data, size, &open_options, &bake)    in any thread
 *     then:  gsgi_world_add(world, load, bake)                        between frames, in the thread of updates
 *
 * The numbers are those of Python's gsgi.World: which sectors, their weights, and the light. */
typedef struct gsgi_world gsgi_world;

typedef struct gsgi_world_options {
    size_t struct_size;
    gsgi_callbacks callbacks;
    uint64_t budget; /* bytes of Gaussians in memory, as the manifest counts them; 0: 256 MiB */
    float fade;      /* s, in which light comes and goes; 0: 1.5 */
} gsgi_world_options;

typedef struct gsgi_world_info {
    size_t struct_size;
    uint32_t sector_count, resident_count; /* the latter: in memory */
    uint64_t scene;                        /* fingerprint of the scene's triangles */
    uint32_t effects;                      /* as of gsgi_info */
    int32_t changing;                      /* whether the last update has left something to read or to fade */
    double margin;                         /* m; on both sides of a border light turns into that of the other sector */
    uint64_t budget, memory;               /* bytes; the latter: of the Gaussians in memory, never above the budget */
} gsgi_world_info;

typedef struct gsgi_sector {
    size_t struct_size;
    const char* file; /* relative to the folder of the manifest, inside of it, UTF-8; lives as long as the world */
    uint64_t bytes;   /* of the file */
    uint64_t memory;  /* bytes of its Gaussians */
    double low[3];    /* corners of its box, world space, m */
    double high[3];
    const gsgi_bake* bake; /* until the next update; NULL: not in memory */
    float weight;          /* factor on its light, 0 to 1 */
} gsgi_sector;

/* Read the `size` bytes of a manifest, which may be freed afterwards. `options` may be NULL. What docs/worlds.md says a
 * reader refuses is GSGI_INVALID_FILE, a budget below the largest sector GSGI_INVALID_ARGUMENT. Safe for untrusted
 * files: a sector, of which there are at most 4,096, takes 600 bytes. */
GSGI_API gsgi_result gsgi_world_open(const void* manifest, size_t size, const gsgi_world_options* options,
                                     gsgi_world** world);

/* Fill `info`, and `sector` for one of 0 to sector_count - 1; their struct_size is set. */
GSGI_API gsgi_result gsgi_world_read_info(const gsgi_world* world, gsgi_world_info* info);
GSGI_API gsgi_result gsgi_world_read_sector(const gsgi_world* world, uint32_t number, gsgi_sector* sector);

/* Let `seconds` pass with an eye at a place, world space, m. Sectors whose light has gone are freed. `load` gets the
 * number of the sector whose file is to be read next, or -1: there is none, or gsgi_world_add has not answered yet.
 * Light changes so little per call that no step shows; INFINITY as `seconds` lets it change at once, for tools and
 * where the camera jumps: read what is asked for until nothing is. */
GSGI_API gsgi_result gsgi_world_update(gsgi_world* world, const float eye[3], double seconds, int32_t* load);

/* Decode the bytes of a sector's file as gsgi_bake_open does. GSGI_INVALID_FILE for any other file than the one that
 * the manifest describes by size and SHA-256. It also makes the tables by which lights read the sector, as
 * gsgi_lookup_open does, with its errors: the bake has them until it is closed, and they count in its bake_bytes, but
 * not in the world's budget. It reads of the world what never changes: it may run in any thread while others use the
 * world, and calls the callbacks of its own `options`. */
GSGI_API gsgi_result gsgi_world_open_sector(const gsgi_world* world, uint32_t number, const void* data, size_t size,
                                            const gsgi_open_options* options, gsgi_bake** bake);

/* Answer what update asked for, with a bake of gsgi_world_open_sector: the world has it from now on and closes it. NULL
 * says that the file could not be read: the sector is not asked for again, and the others go on. After an error the
 * bake is still the host's, and the answer open; GSGI_INVALID_FILE: it blends otherwise than the sectors before. */
GSGI_API gsgi_result gsgi_world_add(gsgi_world* world, uint32_t number, gsgi_bake* bake);

/* B at `count` surface points, as gsgi_bake_sample gives it, of the sectors in memory. Open them with `sampling`. */
GSGI_API gsgi_result gsgi_world_sample(const gsgi_world* world, size_t count, const float* positions,
                                       const float* normals, float* light);

/* The same as gsgi_bake_sample_free gives it. */
GSGI_API gsgi_result gsgi_world_sample_free(const gsgi_world* world, size_t count, const float* positions,
                                            const float* normals, float* light);

/* Free the world and the bakes in it. Lights that were made of it stay as they are. */
GSGI_API void gsgi_world_close(gsgi_world* world);

/* ---- OpenGL --------------------------------------------------------------------------------------------------- */

/* Address of the OpenGL function `name`, such as "glBindTexture", or NULL. eglGetProcAddress, glfwGetProcAddress and
 * SDL_GL_GetProcAddress do, behind a function of these parameters. wglGetProcAddress does not know the functions of
 * OpenGL 1.1: look into opengl32.dll for those. */
typedef void (*gsgi_function)(void);
typedef gsgi_function (*gsgi_get_proc_address)(const char* name, void* user);

/* What becomes of the OpenGL state in every function below that calls OpenGL. */
typedef enum gsgi_state {
    /* All state that the library sets, or that would change what it draws, is read before and restored after. */
    GSGI_STATE_RESTORE = 0,
    /* Nothing is read. Afterwards the state that the library sets has OpenGL's initial values: no program, vertex
     * array, framebuffer, renderbuffer and array or unpack buffer; no texture and sampler in units 0 to 5, unit 0
     * active; all switches off but dithering and multisampling, which are not touched; depth test LESS, all masks on,
     * blending ONE, ZERO; clip control and pixel store as a new context has them. Only the viewport stays as the
     * library set it. For hosts that set all state in each pass, or that can tell their state cache to forget. */
    GSGI_STATE_DEFAULTS
} gsgi_state;

typedef struct gsgi_context_options {
    size_t struct_size;
    gsgi_callbacks callbacks;
    gsgi_get_proc_address get_proc_address; /* needed */
    void* get_proc_address_user;
    gsgi_state state;
} gsgi_context_options;

/* Load the functions of the OpenGL context that is current. It needs OpenGL 3.3, core or compatibility, or OpenGL ES
 * 3.0 with EXT_color_buffer_float, for lights of `over` also EXT_float_blend; GSGI_UNSUPPORTED names what lacks.
 *
 * Call nothing of this library inside of queries, transform feedback or conditional rendering. Extensions of vendors
 * and, before OpenGL ES 3.2, blending by draw buffer are not looked at. GL_FRAMEBUFFER_SRGB is left as it is: enable
 * it before gsgi_light_add to a target of an sRGB format. */
GSGI_API gsgi_result gsgi_context_create(const gsgi_context_options* options, gsgi_context** context);

/* Free the context. Destroy its lights before. */
GSGI_API void gsgi_context_destroy(gsgi_context* context);

/* Say that the OpenGL context was lost or is gone already. From now on nothing calls OpenGL: lights and context are
 * still to be destroyed, which frees their memory, and all else is GSGI_CONTEXT_LOST. */
GSGI_API void gsgi_context_forget(gsgi_context* context);

/* Make the three textures of a look-up: gsgi_gaussians, gsgi_cells, gsgi_lists. They are the host's, to bind to three
 * units, to name in the samplers of its programs, and to delete. Float textures need no extension for this, so that of
 * a context of OpenGL ES 3.0 that gsgi_context_create refuses the host can make them itself from gsgi_lookup_info. */
GSGI_API gsgi_result gsgi_lookup_upload(gsgi_context* context, const gsgi_lookup* lookup, uint32_t textures[3]);

/* Overwrite the texture gsgi_gaussians that gsgi_lookup_upload made, after gsgi_lookup_recolour. */
GSGI_API gsgi_result gsgi_lookup_update(gsgi_context* context, const gsgi_lookup* lookup, uint32_t gaussians);

/* Encodings of the host's textures. */
typedef enum gsgi_depth {
    GSGI_DEPTH_WINDOW = 0,  /* a depth buffer of a projection with -w <= z <= w, 1: no surface; OpenGL's usual one */
    GSGI_DEPTH_ZERO_TO_ONE, /* one with 0 <= z <= w (glClipControl), 1: no surface */
    GSGI_DEPTH_REVERSED,    /* one with 0 <= z <= w and near at 1; 0: no surface */
    GSGI_DEPTH_LINEAR       /* metres along the view axis in floats, 0: no surface */
} gsgi_depth;

/* The normal points towards the camera and is the one before any normal map. */
typedef enum gsgi_normal {
    GSGI_NORMAL_SIGNED = 0,         /* xyz of any length */
    GSGI_NORMAL_UNSIGNED,           /* xyz moved from -1 ... 1 to 0 ... 1 */
    GSGI_NORMAL_OCTAHEDRAL,         /* two numbers, -1 ... 1 */
    GSGI_NORMAL_OCTAHEDRAL_UNSIGNED /* the same moved to 0 ... 1 */
} gsgi_normal;

typedef enum gsgi_space { GSGI_SPACE_WORLD = 0, GSGI_SPACE_VIEW } gsgi_space;

typedef enum gsgi_albedo {
    GSGI_ALBEDO_LINEAR = 0, /* as the texture is sampled: linear numbers, or a texture of an sRGB format */
    GSGI_ALBEDO_SRGB        /* sRGB values in a texture whose format does not say so */
} gsgi_albedo;

/* Which row of the textures is the first one in memory. */
typedef enum gsgi_rows {
    GSGI_ROWS_BOTTOM_UP = 0, /* the lowest of the image, as OpenGL draws */
    GSGI_ROWS_TOP_DOWN       /* the highest, as under glClipControl(GL_UPPER_LEFT, ...) */
} gsgi_rows;

typedef struct gsgi_light_options {
    size_t struct_size;
    gsgi_depth depth;
    gsgi_normal normal;
    gsgi_space normal_space;
    gsgi_albedo albedo;
    gsgi_rows rows;
    int32_t splat_scale;  /* `surface`: pixels of the frame per reading, along each axis, 1 to 4; 0: 2 */
    float box_low[3];     /* `surface`: nothing outside of this box is lit, for one file per room; world space, m. */
    float box_high[3];    /* Both 0: no box. */
    float depth_range[2]; /* of a depth buffer: the arguments of the glDepthRange it was drawn under; both 0: 0 and 1.
                             What lies outside shows no surface. */
    int32_t relief;       /* not 0: B follows normal maps, where the file says how (gsgi_info.relief), in
                             gsgi_light_draw_mapped. It takes 48 bytes more per Gaussian of the fine level; sectors of
                             a world take them in any case. */
} gsgi_light_options;

/* Upload a bake and compile its passes. For `surface` it first makes tables, as gsgi_lookup_open does, with its errors,
 * unless the bake was opened with `lists`; the light of a bake with light groups keeps the texels of its Gaussians.
 * `options` may be NULL. The bake may be closed afterwards. */
GSGI_API gsgi_result gsgi_light_create(gsgi_context* context, const gsgi_bake* bake, const gsgi_light_options* options,
                                       gsgi_light** light);

/* Give the light the colours that the bake, the one of which it was made, has now, after gsgi_bake_weigh: from the next
 * draw on. It uploads all of the Gaussians but their lists; of a bake without groups nothing. */
GSGI_API gsgi_result gsgi_light_recolour(gsgi_light* light, const gsgi_bake* bake);

/* Compile the passes that read several sectors at once. `options` may be NULL. The light has no sectors until
 * gsgi_light_follow. */
GSGI_API gsgi_result gsgi_light_create_world(gsgi_context* context, const gsgi_world* world,
                                             const gsgi_light_options* options, gsgi_light** light);

/* Take over which sectors of the world, the one of which the light was made, are in memory, and their weights: upload
 * those that came, and free those that went. The first of each kind (gsgi_info.sh_degree, relief) compiles a
 * program. Call it each frame after gsgi_world_update and gsgi_world_add; a sector that came shows from the next
 * cull on. The world may be changed or closed afterwards. */
GSGI_API gsgi_result gsgi_light_follow(gsgi_light* light, const gsgi_world* world);

/* Free the light, with its memory on the GPU. The host's textures are kept. */
GSGI_API void gsgi_light_destroy(gsgi_light* light);

/* A camera, and the part of the host's textures that shows its view. */
typedef struct gsgi_view {
    size_t struct_size;
    float view_from_world[16]; /* a rotation and a translation; it may mirror, and view space may look down either z */
    float clip_from_view[16];  /* a projection, which may lie off the axis or mirror; far may be infinite. For `over` a
                                  perspective one. An orthographic one of linear depth has near at the smallest z. */
    int32_t viewport[4];       /* px: x, y of the corner where the rows begin, width, height */
} gsgi_view;

/* Take a camera, and find what it may see: for `over` Gaussians, which are sorted, of a world the sectors. Calls no
 * OpenGL, so that it may run in a job, while nothing else uses the light. The draws that follow are of this view. */
GSGI_API gsgi_result gsgi_light_cull(gsgi_light* light, const gsgi_view* view);

/* Draw B for the view of the last cull, from the names of the host's depth and normal textures, which are 2D, single
 * sample and of one size (`over` reads neither). `indirect`, if not NULL, gets the name of the library's texture:
 * RGBA16F (RGBA32F for `over`), as large as the viewport, its rows in the order of the host's; valid until the next
 * draw, reset or destroy. Its alpha is 1 with `surface`, 1 - transmittance with `over`, and
 * says nothing with a world.
 *
 * Where OpenGL can tell the textures' formats (3.3, ES 3.1), those that cannot be what the light's options say are
 * GSGI_INVALID_ARGUMENT. They are checked when another texture or viewport is given. */
GSGI_API gsgi_result gsgi_light_draw(gsgi_light* light, uint32_t depth, uint32_t normal, uint32_t* indirect);

/* The same, with B that follows normal maps, for a light with the option `relief`: `mapped` is one more texture of the
 * size and encoding of `normal`, with the normals as normal maps bend them, which may be those that light the frame.
 * Where it is a zero vector, and with 0 for `mapped`, nothing is bent. */
GSGI_API gsgi_result gsgi_light_draw_mapped(gsgi_light* light, uint32_t depth, uint32_t normal, uint32_t mapped,
                                            uint32_t* indirect);

/* Add albedo * B of the last draw to GL_COLOR_ATTACHMENT0 of `framebuffer` (to the back buffer of framebuffer 0), in
 * the viewport of that draw. It holds linear radiance. Alpha and other attachments do not change. `albedo` is a 2D
 * texture of the size of the draw's, and none of the framebuffer's attachments. A framebuffer that does not exist, is
 * not complete or holds integers is GSGI_INVALID_ARGUMENT; like textures, it is checked when another one is given. */
GSGI_API gsgi_result gsgi_light_add(gsgi_light* light, uint32_t framebuffer, uint32_t albedo);

typedef struct gsgi_stats {
    size_t struct_size;
    uint32_t drawn[2];     /* Gaussians of the last cull, by gsgi_level. `over`: those that the camera may see;
                              `surface`: all of the bake, of a world those of the sectors in view */
    size_t gaussian_bytes; /* on the GPU; `surface`: with their lists */
    size_t target_bytes;   /* on the GPU, for the size of the last draw. `over`: 16 bytes per pixel of the viewport.
                              `surface`: 8, and 32 per reading; from splat_scale 2 on 4 more, and 16 more per reading;
                              8 more per reading with relief */
} gsgi_stats;

/* Fill `stats`, whose struct_size is set. */
GSGI_API gsgi_result gsgi_light_stats(const gsgi_light* light, gsgi_stats* stats);

/* Free the targets, and forget the last cull and draw: for a light that is not drawn for a while. The next draw makes
 * its targets anew. */
GSGI_API gsgi_result gsgi_light_reset(gsgi_light* light);

#ifdef __cplusplus
}
#endif

#endif
