/* Checks of what a host hands over: what cannot be read rightly is an error, not plausible wrong light. */
#include "light.h"

#define DEPTH_BITS_MIN 16

typedef enum kind { KIND_INTEGER, KIND_FLOAT, KIND_UNSIGNED, KIND_SIGNED, KIND_DEPTH } kind;

/* Level 0 of a 2D texture. `bits`: of the first channel. */
typedef struct format {
    kind kind;
    GLint width, height, channels, bits;
    bool srgb;
} format;

static gsgi_result refuse(const gsgi_light* light, const char* name, const char* why) {
    return gsgi__fail(&light->context->callbacks, GSGI_INVALID_ARGUMENT, "%s: %s", name, why);
}

static GLint level_parameter(const gsgi__gl* gl, GLenum name) {
    GLint value = 0;
    gl->GetTexLevelParameteriv(GL_TEXTURE_2D, 0, name, &value);
    return value;
}

static format format_of_bound(const gsgi__gl* gl) {
    format f = {KIND_INTEGER, level_parameter(gl, GL_TEXTURE_WIDTH), level_parameter(gl, GL_TEXTURE_HEIGHT), 0, 0,
                false};
    for (GLenum channel = 0; channel < 4; ++channel)
        if (level_parameter(gl, GL_TEXTURE_RED_SIZE + channel) > 0) ++f.channels;
    f.bits = level_parameter(gl, GL_TEXTURE_RED_SIZE);
    GLint depth_bits = level_parameter(gl, GL_TEXTURE_DEPTH_SIZE);
    if (f.bits == 0 && depth_bits > 0) {
        f.kind = KIND_DEPTH;
        f.channels = 1;
        f.bits = depth_bits;
        return f;
    }
    GLint type = level_parameter(gl, GL_TEXTURE_RED_TYPE), internal = level_parameter(gl, GL_TEXTURE_INTERNAL_FORMAT);
    f.kind = type == GL_FLOAT                 ? KIND_FLOAT
             : type == GL_UNSIGNED_NORMALIZED ? KIND_UNSIGNED
             : type == GL_SIGNED_NORMALIZED   ? KIND_SIGNED
                                              : KIND_INTEGER;
    f.srgb = internal >= GL_SRGB && internal <= GL_SRGB8_ALPHA8;
    return f;
}

/* Format of the texture `name`; `argument` is the argument's name. */
static gsgi_result read_format(gsgi_light* light, const char* argument, GLuint name, format* found) {
    const gsgi__gl* gl = &light->context->gl;
    GLint bound = 0;
    gsgi__bind_texture(gl, 0, name);
    gl->GetIntegerv(GL_TEXTURE_BINDING_2D, &bound);
    if (name == 0 || (GLuint)bound != name) {
        gl->GetError(); /* the driver's, about the binding */
        return gsgi__fail(&light->context->callbacks, GSGI_INVALID_ARGUMENT,
                          "%s: OpenGL's texture %u is no 2D texture with one sample per pixel", argument, name);
    }
    *found = format_of_bound(gl);
    return GSGI_OK;
}

static gsgi_result check_depth(const gsgi_light* light, const format* depth) {
    if (depth->kind == KIND_INTEGER)
        return refuse(light, "depth", "integer texels; needed is a depth buffer, float or normalised");
    if (light->options.depth == GSGI_DEPTH_LINEAR && depth->kind != KIND_FLOAT)
        return refuse(light, "depth", "GSGI_DEPTH_LINEAR needs metres in floats: use another one for a depth buffer");
    if (depth->bits < DEPTH_BITS_MIN)
        return refuse(light, "depth", "16 bits or more are needed: is it another texture?");
    return GSGI_OK;
}

static gsgi_result check_normal(const gsgi_light* light, const char* name, const format* normal) {
    const gsgi_normal encoding = light->options.normal;
    if (normal->kind == KIND_DEPTH) return refuse(light, name, "a depth buffer: are depth and normal swapped?");
    if (normal->kind == KIND_INTEGER || normal->channels < (encoding >= GSGI_NORMAL_OCTAHEDRAL ? 2 : 3))
        return refuse(light, name, "needed are three channels (octahedral: two), float or normalised");
    if (normal->srgb) return refuse(light, name, "the format is sRGB, which bends normals: use a linear format");
    if (normal->kind == KIND_UNSIGNED && (encoding == GSGI_NORMAL_SIGNED || encoding == GSGI_NORMAL_OCTAHEDRAL))
        return refuse(light, name,
                      "the format has no negative numbers: use GSGI_NORMAL_UNSIGNED or GSGI_NORMAL_OCTAHEDRAL_UNSIGNED "
                      "for what is moved to 0 ... 1, or a float texture");
    return GSGI_OK;
}

gsgi_result gsgi__check_surfaces(gsgi_light* light, GLuint depth_name, GLuint normal_name, GLuint mapped_name) {
    const gsgi__camera* c = &light->camera;
    gsgi__checked* checked = &light->checked;
    format depth, normal, mapped;
    gsgi_result result;
    if (depth_name && depth_name == checked->depth && normal_name && normal_name == checked->normal &&
        mapped_name == checked->mapped)
        return GSGI_OK;
    if (!light->context->gl.texture_levels) {
        if (depth_name && normal_name) return GSGI_OK;
        return refuse(light, depth_name ? "normal" : "depth", "0 is no texture");
    }
    if ((result = read_format(light, "depth", depth_name, &depth)) ||
        (result = read_format(light, "normal", normal_name, &normal)) || (result = check_depth(light, &depth)) ||
        (result = check_normal(light, "normal", &normal)))
        return result;
    if (mapped_name && ((result = read_format(light, "mapped", mapped_name, &mapped)) ||
                        (result = check_normal(light, "mapped", &mapped))))
        return result;
    if (depth.width != normal.width || depth.height != normal.height)
        return refuse(light, "normal", "its size is not that of depth");
    if (mapped_name && (mapped.width != normal.width || mapped.height != normal.height))
        return refuse(light, "mapped", "its size is not that of normal");
    if (c->width > depth.width - c->x || c->height > depth.height - c->y)
        return refuse(light, "viewport", "it does not lie within the textures");
    checked->depth = depth_name;
    checked->normal = normal_name;
    checked->mapped = mapped_name;
    return GSGI_OK;
}

/* Whether the texture is a colour attachment of the framebuffer that is bound for drawing. */
static bool is_attached(const gsgi__gl* gl, GLuint texture) {
    for (int i = 0; i < gl->color_attachments; ++i) {
        const GLenum attachment = GL_COLOR_ATTACHMENT0 + (GLenum)i;
        GLint type = 0, name = 0;
        gl->GetFramebufferAttachmentParameteriv(GL_DRAW_FRAMEBUFFER, attachment, GL_FRAMEBUFFER_ATTACHMENT_OBJECT_TYPE,
                                                &type);
        if (type != GL_TEXTURE) continue;
        gl->GetFramebufferAttachmentParameteriv(GL_DRAW_FRAMEBUFFER, attachment, GL_FRAMEBUFFER_ATTACHMENT_OBJECT_NAME,
                                                &name);
        if ((GLuint)name == texture) return true;
    }
    return false;
}

/* Whether light can be added to the framebuffer, which is left bound for drawing. */
static gsgi_result check_target(const gsgi_light* light, GLuint framebuffer) {
    const gsgi__gl* gl = &light->context->gl;
    const GLenum at = GL_COLOR_ATTACHMENT0;
    GLint object = 0, type = 0;
    if (!gl->IsFramebuffer(framebuffer))
        return refuse(light, "framebuffer", "OpenGL has none of that name, or none that was ever bound");
    gl->BindFramebuffer(GL_DRAW_FRAMEBUFFER, framebuffer);
    if (gl->CheckFramebufferStatus(GL_DRAW_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE)
        return refuse(light, "framebuffer", "it is not complete: has it attachments?");
    gl->GetFramebufferAttachmentParameteriv(GL_DRAW_FRAMEBUFFER, at, GL_FRAMEBUFFER_ATTACHMENT_OBJECT_TYPE, &object);
    if (!object) return refuse(light, "framebuffer", "it has nothing at GL_COLOR_ATTACHMENT0");
    gl->GetFramebufferAttachmentParameteriv(GL_DRAW_FRAMEBUFFER, at, GL_FRAMEBUFFER_ATTACHMENT_COMPONENT_TYPE, &type);
    if (type == GL_INT || type == GL_UNSIGNED_INT)
        return refuse(light, "framebuffer", "it holds integers; needed is linear radiance");
    return GSGI_OK;
}

gsgi_result gsgi__check_addition(gsgi_light* light, GLuint framebuffer, GLuint albedo_name) {
    const gsgi__camera* c = &light->camera;
    gsgi__checked* checked = &light->checked;
    format albedo;
    gsgi_result result;
    if (albedo_name && albedo_name == checked->albedo && framebuffer == checked->framebuffer) return GSGI_OK;
    if (albedo_name == 0) return refuse(light, "albedo", "0 is no texture");
    if (framebuffer && (result = check_target(light, framebuffer))) return result;
    if (light->context->gl.texture_levels) {
        if ((result = read_format(light, "albedo", albedo_name, &albedo))) return result;
        if (albedo.kind == KIND_DEPTH || albedo.kind == KIND_INTEGER || albedo.channels < 3)
            return refuse(light, "albedo", "needed are three channels, float or normalised");
        if (light->options.albedo == GSGI_ALBEDO_SRGB && albedo.srgb)
            return refuse(light, "albedo", "the format is sRGB already, and decodes itself: use GSGI_ALBEDO_LINEAR");
        if (c->width > albedo.width - c->x || c->height > albedo.height - c->y)
            return refuse(light, "albedo", "the viewport does not lie within it");
    }
    if (framebuffer && is_attached(&light->context->gl, albedo_name))
        return refuse(light, "framebuffer",
                      "albedo is one of its attachments, and cannot be read while it is drawn to: "
                      "make a framebuffer of the radiance alone");
    checked->framebuffer = framebuffer;
    checked->albedo = albedo_name;
    return GSGI_OK;
}

gsgi__readable gsgi__make_readable(const gsgi__gl* gl, GLuint texture) {
    gsgi__readable readable = {texture, 0, GL_DEPTH_COMPONENT};
    gsgi__bind_texture(gl, 0, texture);
    gl->GetTexParameteriv(GL_TEXTURE_2D, GL_TEXTURE_BASE_LEVEL, &readable.base_level);
    if (readable.base_level != 0) gl->TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_BASE_LEVEL, 0);
    if (!gl->stencil_textures) return readable;
    gl->GetTexParameteriv(GL_TEXTURE_2D, GL_DEPTH_STENCIL_TEXTURE_MODE, &readable.stencil_mode);
    if (readable.stencil_mode != GL_DEPTH_COMPONENT)
        gl->TexParameteri(GL_TEXTURE_2D, GL_DEPTH_STENCIL_TEXTURE_MODE, GL_DEPTH_COMPONENT);
    return readable;
}

void gsgi__unmake_readable(const gsgi__gl* gl, const gsgi__readable* readable) {
    gsgi__bind_texture(gl, 0, readable->texture);
    if (readable->base_level != 0) gl->TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_BASE_LEVEL, readable->base_level);
    if (readable->stencil_mode != GL_DEPTH_COMPONENT)
        gl->TexParameteri(GL_TEXTURE_2D, GL_DEPTH_STENCIL_TEXTURE_MODE, readable->stencil_mode);
}
