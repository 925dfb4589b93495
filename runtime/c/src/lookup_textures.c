/* The textures of a look-up. */
#include "light.h"
#include "lookup.h"

#include <string.h>

gsgi_result gsgi__lookup_textures(const gsgi_context* context, const gsgi_lookup* lookup, GLuint textures[3]) {
    const gsgi__gl* gl = &context->gl;
    const gsgi_lookup_info* info = &lookup->info;
    const bool narrow = info->list_bits == 16;
    const uint32_t most = (uint32_t)gl->texture_size_max;
    if (info->gaussian_rows > most || info->cell_rows > most || info->list_rows > most)
        return gsgi__fail(&context->callbacks, GSGI_UNSUPPORTED,
                          "bake: its look-up has more texels than this driver's textures hold");
    const gsgi__format formats[3] = {
        {GL_RGBA32F, GL_RGBA, GL_FLOAT},
        {GL_R32UI, GL_RED_INTEGER, GL_UNSIGNED_INT},
        {narrow ? GL_R16UI : GL_R32UI, GL_RED_INTEGER, narrow ? GL_UNSIGNED_SHORT : GL_UNSIGNED_INT}};
    const void* const texels[3] = {lookup->gaussians, lookup->cells, lookup->lists};
    const uint32_t rows[3] = {info->gaussian_rows, info->cell_rows, info->list_rows};
    for (int t = 0; t < 3; ++t)
        textures[t] = gsgi__texture_of(gl, formats[t], GSGI_DATA_WIDTH, (int32_t)rows[t], texels[t]);
    return GSGI_OK;
}

gsgi_result gsgi_lookup_upload(gsgi_context* context, const gsgi_lookup* lookup, uint32_t textures[3]) {
    gsgi__state host;
    gsgi_result result = context ? gsgi__check_context(context) : GSGI_INVALID_ARGUMENT;
    if (result) return result;
    if (!lookup || !textures)
        return gsgi__fail(&context->callbacks, GSGI_INVALID_ARGUMENT, "lookup, textures: must not be NULL");
    const gsgi__gl* gl = &context->gl;
    GLuint made[3] = {0, 0, 0};
    gsgi__drain_errors(context);
    gsgi__state_begin(gl, context->state, &host);
    result = gsgi__lookup_textures(context, lookup, made);
    if (!result && (result = gsgi__check_memory(context))) gl->DeleteTextures(3, made);
    if (!result) memcpy(textures, made, sizeof made);
    gsgi__state_end(gl, context->state, &host);
    return result;
}

gsgi_result gsgi_lookup_update(gsgi_context* context, const gsgi_lookup* lookup, uint32_t gaussians) {
    gsgi__state host;
    gsgi_result result = context ? gsgi__check_context(context) : GSGI_INVALID_ARGUMENT;
    if (result) return result;
    if (!lookup || !gaussians)
        return gsgi__fail(&context->callbacks, GSGI_INVALID_ARGUMENT, "lookup, gaussians: must not be NULL or 0");
    gsgi__state_begin(&context->gl, context->state, &host);
    gsgi__write_rows(&context->gl, gaussians, lookup->info.gaussian_rows, lookup->gaussians);
    gsgi__state_end(&context->gl, context->state, &host);
    return GSGI_OK;
}
