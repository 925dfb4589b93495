/* Contexts: the host's OpenGL, and its errors. */
#include "light.h"

#include <string.h>

gsgi_result gsgi_context_create(const gsgi_context_options* given, gsgi_context** out) {
    gsgi_context_options options;
    gsgi__gl gl;
    gsgi_result result = gsgi__read_options(given, &options, sizeof options);
    if (result) return result;
    const gsgi_callbacks* callbacks = &options.callbacks;
    if (!out || !options.get_proc_address)
        return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT, "context, get_proc_address: must not be NULL");
    if (options.state != GSGI_STATE_RESTORE && options.state != GSGI_STATE_DEFAULTS)
        return gsgi__fail(callbacks, GSGI_INVALID_ARGUMENT, "state: %d is none", (int)options.state);
    if ((result = gsgi__gl_load(&gl, &options))) return result;

    gsgi_context* context = gsgi__allocate(callbacks, sizeof *context);
    if (!context) return gsgi__fail(callbacks, GSGI_OUT_OF_MEMORY, "context: no memory");
    memset(context, 0, sizeof *context);
    context->callbacks = *callbacks;
    context->state = options.state;
    context->gl = gl;
    gl.GenVertexArrays(1, &context->triangle);
    gl.GenSamplers(1, &context->sampler);
    gl.SamplerParameteri(context->sampler, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    gl.SamplerParameteri(context->sampler, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    gl.SamplerParameteri(context->sampler, GL_TEXTURE_COMPARE_MODE, GL_NONE);
    *out = context;
    return GSGI_OK;
}

void gsgi_context_destroy(gsgi_context* context) {
    if (!context) return;
    const gsgi_callbacks callbacks = context->callbacks;
    if (!context->lost) {
        context->gl.DeleteVertexArrays(1, &context->triangle);
        context->gl.DeleteSamplers(1, &context->sampler);
    }
    gsgi__release(&callbacks, context);
}

void gsgi_context_forget(gsgi_context* context) {
    if (context) context->lost = true;
}

gsgi_result gsgi__check_context(const gsgi_context* context) {
    if (!context->lost) return GSGI_OK;
    return gsgi__fail(&context->callbacks, GSGI_CONTEXT_LOST, "context: it was forgotten");
}

/* Errors that the host left unread would be taken for ours. */
void gsgi__drain_errors(const gsgi_context* context) {
    for (int i = 0; i < 16; ++i) {
        GLenum error = context->gl.GetError();
        if (error == GL_NO_ERROR) return;
        gsgi__log(&context->callbacks, GSGI_WARNING, "context: an OpenGL error of the host was unread: 0x%x", error);
    }
}

/* Whether OpenGL had the memory for what was just made. */
gsgi_result gsgi__check_memory(const gsgi_context* context) {
    bool enough = true;
    for (int i = 0; i < 16; ++i) {
        GLenum error = context->gl.GetError();
        if (error == GL_NO_ERROR) break;
        if (error == GL_OUT_OF_MEMORY) enough = false;
    }
    return enough ? GSGI_OK : gsgi__fail(&context->callbacks, GSGI_OUT_OF_MEMORY, "context: OpenGL has no memory");
}
