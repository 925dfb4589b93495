/* The stages of glsl/ that the passes use, with their includes expanded; cmake/embed_shaders.cmake writes them. */
#ifndef GSGI_SHADERS_H
#define GSGI_SHADERS_H

extern const char gsgi__shader_lib_fullscreen_vert[];
extern const char gsgi__shader_surface_points_frag[];
extern const char gsgi__shader_surface_read_frag[];
extern const char gsgi__shader_surface_smooth_frag[];
extern const char gsgi__shader_surface_resolve_frag[];
extern const char gsgi__shader_surface_add_light_frag[];
extern const char gsgi__shader_surface_gsgi_indirect_glsl[];
extern const char gsgi__shader_over_splat_vert[];
extern const char gsgi__shader_over_splat_frag[];

#endif
