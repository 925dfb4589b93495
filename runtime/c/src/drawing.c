/* What the passes of both operators share: drawing, textures, targets. */
#include "light.h"

#include <string.h>

void gsgi__bind_texture(const gsgi__gl* gl, GLuint unit, GLuint texture) {
    gl->ActiveTexture(GL_TEXTURE0 + unit);
    gl->BindTexture(GL_TEXTURE_2D, texture);
}

void gsgi__use_sampler(const gsgi_context* context) {
    for (GLuint unit = 0; unit < GSGI_UNITS; ++unit) context->gl.BindSampler(unit, context->sampler);
}

void gsgi__draw_triangle(const gsgi_context* context, const gsgi__program* program) {
    context->gl.UseProgram(program->name);
    context->gl.BindVertexArray(context->triangle);
    context->gl.DrawArrays(GL_TRIANGLES, 0, 3);
}

void gsgi__clear_color(const gsgi__gl* gl, GLuint framebuffer) {
    static const GLfloat zero[4] = {0.0f, 0.0f, 0.0f, 0.0f};
    gl->BindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffer);
    gl->ClearBufferfv(GL_COLOR, 0, zero);
}

GLuint gsgi__texture_of(const gsgi__gl* gl, gsgi__format format, int32_t width, int32_t height, const void* texels) {
    GLuint texture;
    gl->GenTextures(1, &texture);
    gsgi__bind_texture(gl, 0, texture);
    gl->TexImage2D(GL_TEXTURE_2D, 0, (GLint)format.internal, width, height, 0, format.channels, format.type, texels);
    gl->TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    gl->TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    return texture;
}

void gsgi__write_rows(const gsgi__gl* gl, GLuint texture, uint32_t rows, const float* texels) {
    gsgi__bind_texture(gl, 0, texture);
    gl->TexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, GSGI_DATA_WIDTH, (GLsizei)rows, GL_RGBA, GL_FLOAT, texels);
}

GLuint gsgi__target_texture(gsgi_light* light, GLenum format, int32_t width, int32_t height) {
    const bool halves = format == GL_RGBA16F;
    const gsgi__format whole = {format, GL_RGBA, halves ? GL_HALF_FLOAT : GL_FLOAT};
    light->targets.bytes += (size_t)width * height * (halves ? 8 : 16);
    return gsgi__texture_of(&light->context->gl, whole, width, height, NULL);
}

GLuint gsgi__target_depth(gsgi_light* light, int32_t width, int32_t height) {
    const gsgi__gl* gl = &light->context->gl;
    GLuint renderbuffer;
    gl->GenRenderbuffers(1, &renderbuffer);
    gl->BindRenderbuffer(GL_RENDERBUFFER, renderbuffer);
    gl->RenderbufferStorage(GL_RENDERBUFFER, GL_DEPTH_COMPONENT24, width, height);
    light->targets.bytes += 4 * (size_t)width * height;
    return renderbuffer;
}

gsgi_result gsgi__target(gsgi_light* light, const GLuint colors[GSGI_TARGETS], GLuint depth, GLuint* framebuffer) {
    const gsgi__gl* gl = &light->context->gl;
    GLenum buffers[GSGI_TARGETS] = {GL_NONE};
    GLsizei count = 1;
    gl->GenFramebuffers(1, framebuffer);
    gl->BindFramebuffer(GL_DRAW_FRAMEBUFFER, *framebuffer);
    for (int i = 0; i < GSGI_TARGETS && colors[i]; ++i) {
        buffers[i] = GL_COLOR_ATTACHMENT0 + (GLenum)i;
        gl->FramebufferTexture2D(GL_DRAW_FRAMEBUFFER, buffers[i], GL_TEXTURE_2D, colors[i], 0);
        count = i + 1;
    }
    if (depth) gl->FramebufferRenderbuffer(GL_DRAW_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, depth);
    gl->DrawBuffers(count, buffers);
    GLenum status = gl->CheckFramebufferStatus(GL_DRAW_FRAMEBUFFER);
    if (status == GL_FRAMEBUFFER_COMPLETE) return GSGI_OK;
    return gsgi__fail(&light->context->callbacks, GSGI_DRIVER_ERROR,
                      "viewport: the driver refuses a target of %d x %d px (0x%x)", light->targets.width,
                      light->targets.height, status);
}

void gsgi__targets_release(gsgi_light* light) {
    const gsgi__gl* gl = &light->context->gl;
    const gsgi__targets* t = &light->targets;
    const GLuint framebuffers[] = {t->points, t->filled_sums, t->resolved};
    const GLuint textures[] = {t->position, t->plane, t->bend, t->filled, t->indirect};
    if (!light->context->lost) {
        gl->DeleteFramebuffers(sizeof framebuffers / sizeof *framebuffers, framebuffers); /* 0 is ignored */
        gl->DeleteTextures(sizeof textures / sizeof *textures, textures);
        gl->DeleteRenderbuffers(1, &t->rest);
    }
    memset(&light->targets, 0, sizeof light->targets);
}
