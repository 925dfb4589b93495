/* A renderer in C with its own G-buffer, to which the library adds baked light: the Cornell box, to a PPM picture.
 *
 *     cmake -S samples/08_c_host -B build/c_host && cmake --build build/c_host
 *     build/c_host/host build/samples/cornell.gsgi frame.ppm [es]
 *
 * It opens OpenGL 3.3 core, or with `es` OpenGL ES 3.0, without a display. */
#define GL_GLEXT_PROTOTYPES
#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <GL/glcorearb.h>
#include <gsgi.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 320, HEIGHT = 320, VERTICES = 6 * 15 };

static const char* const vertex_shader =
    "uniform mat4 view, projection; in vec3 position, normal, color; out vec3 n, c;\n"
    "void main() { n = normal; c = color; gl_Position = projection * view * vec4(position, 1.0); }\n";
static const char* const fragment_shader =
    "in vec3 n, c; layout(location = 0) out vec4 radiance; layout(location = 1) out vec4 albedo;\n"
    "layout(location = 2) out vec4 normals;\n"
    "void main() { radiance = vec4(0.0); albedo = vec4(c, 1.0); normals = vec4(0.5 + 0.5 * normalize(n), 1.0); }\n";

/* The Cornell box, m: corners of each wall, seen from inside, then the two blocks by their bases and heights. */
static const float walls[5][4][3] = {
    {{-.2748f, 0, 0}, {.278f, 0, 0}, {.278f, 0, -.5592f}, {-.2716f, 0, -.5592f}},
    {{-.278f, .5488f, 0}, {-.278f, .5488f, -.5592f}, {.278f, .5488f, -.5592f}, {.278f, .5488f, 0}},
    {{-.2716f, 0, -.5592f}, {.278f, 0, -.5592f}, {.278f, .5488f, -.5592f}, {-.278f, .5488f, -.5592f}},
    {{.278f, 0, -.5592f}, {.278f, 0, 0}, {.278f, .5488f, 0}, {.278f, .5488f, -.5592f}},
    {{-.2748f, 0, 0}, {-.2716f, 0, -.5592f}, {-.278f, .5488f, -.5592f}, {-.278f, .5488f, 0}}};
static const float colors[3][3] = {{.73f, .73f, .73f}, {.12f, .45f, .15f}, {.65f, .05f, .05f}};
static const float blocks[2][9] = {/* x, z of four corners, height */
                                   {.148f, -.065f, .196f, -.225f, .038f, -.272f, -.012f, -.114f, .165f},
                                   {-.145f, -.247f, .013f, -.296f, -.036f, -.456f, -.194f, -.406f, .330f}};

static void* fail(const char* what) {
    fprintf(stderr, "host: %s\n", what);
    exit(1);
}

static float* add_quad(float* to, const float q[4][3], const float* color) {
    static const int order[6] = {0, 1, 2, 0, 2, 3};
    float a[3], b[3], n[3];
    for (int k = 0; k < 3; ++k) a[k] = q[1][k] - q[0][k], b[k] = q[3][k] - q[0][k];
    for (int k = 0; k < 3; ++k) n[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
    for (int i = 0; i < 6; ++i, to += 9) {
        memcpy(to, q[order[i]], 3 * sizeof *to);
        memcpy(to + 3, n, sizeof n);
        memcpy(to + 6, color, 3 * sizeof *to);
    }
    return to;
}

static void draw_box(void) {
    float vertices[VERTICES * 9], *to = vertices;
    for (int w = 0; w < 5; ++w) to = add_quad(to, walls[w], colors[w < 3 ? 0 : w - 2]);
    for (int b = 0; b < 2; ++b) {
        const float *p = blocks[b], h = p[8];
        const float top[4][3] = {{p[0], h, p[1]}, {p[2], h, p[3]}, {p[4], h, p[5]}, {p[6], h, p[7]}};
        to = add_quad(to, top, colors[0]);
        for (int i = 0; i < 4; ++i) {
            const float *s = p + 2 * i, *e = p + 2 * ((i + 1) % 4);
            const float side[4][3] = {{s[0], 0, s[1]}, {e[0], 0, e[1]}, {e[0], h, e[1]}, {s[0], h, s[1]}};
            to = add_quad(to, side, colors[0]);
        }
    }
    GLuint buffer;
    glGenBuffers(1, &buffer);
    glBindBuffer(GL_ARRAY_BUFFER, buffer);
    glBufferData(GL_ARRAY_BUFFER, sizeof vertices, vertices, GL_STATIC_DRAW);
    for (GLuint i = 0; i < 3; ++i) {
        glEnableVertexAttribArray(i);
        glVertexAttribPointer(i, 3, GL_FLOAT, GL_FALSE, 9 * sizeof(float), (const void*)(3 * i * sizeof(float)));
    }
    glDrawArrays(GL_TRIANGLES, 0, VERTICES);
}

static void open_opengl(int es) {
    const EGLint attributes[] = {EGL_CONTEXT_MAJOR_VERSION, 3, EGL_CONTEXT_MINOR_VERSION, es ? 0 : 3, EGL_NONE};
    PFNEGLGETPLATFORMDISPLAYEXTPROC get =
        (PFNEGLGETPLATFORMDISPLAYEXTPROC)eglGetProcAddress("eglGetPlatformDisplayEXT");
    EGLDisplay display = get ? get(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, NULL) : NULL;
    if (!display || !eglInitialize(display, NULL, NULL) || !eglBindAPI(es ? EGL_OPENGL_ES_API : EGL_OPENGL_API))
        fail("no EGL without a display");
    EGLContext context = eglCreateContext(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, attributes);
    if (!context || !eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context)) fail("no OpenGL context");
}

static GLuint shader(GLenum stage, const char* header, const char* text) {
    const char* parts[] = {header, text};
    GLuint made = glCreateShader(stage);
    glShaderSource(made, 2, parts, NULL);
    glCompileShader(made);
    return made;
}

static gsgi_function load(const char* name, void* user) {
    (void)user;
    return eglGetProcAddress(name);
}

static void print(gsgi_severity severity, const char* message, void* user) {
    (void)severity, (void)user;
    fprintf(stderr, "gsgi: %s\n", message);
}

int main(int argc, char** argv) {
    FILE* file = argc < 3 ? fail("usage: host ROOM.gsgi FRAME.ppm [es]") : fopen(argv[1], "rb");
    const int es = argc > 3 && strcmp(argv[3], "es") == 0;
    static char bytes[1 << 24];
    const size_t size = file ? fread(bytes, 1, sizeof bytes, file) : 0;
    open_opengl(es);

    gsgi_bake* bake;
    gsgi_context* context;
    gsgi_light* light;
    gsgi_open_options open = {.struct_size = sizeof open, .callbacks.log = print};
    gsgi_context_options gl = {.struct_size = sizeof gl, .callbacks.log = print, .get_proc_address = load};
    gsgi_light_options encoding = {.struct_size = sizeof encoding, .normal = GSGI_NORMAL_UNSIGNED};
    if (gsgi_bake_open(bytes, size, &open, &bake) || gsgi_context_create(&gl, &context) ||
        gsgi_light_create(context, bake, &encoding, &light))
        return 1;
    gsgi_bake_close(bake);

    const GLenum formats[4] = {GL_RGBA16F, GL_RGBA8, GL_RGB10_A2, GL_DEPTH_COMPONENT24};
    const GLenum attachments[4] = {GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1, GL_COLOR_ATTACHMENT2,
                                   GL_DEPTH_ATTACHMENT};
    GLuint textures[4], gbuffer, frame, vertices, program = glCreateProgram();
    glGenTextures(4, textures);
    glGenFramebuffers(1, &gbuffer);
    glBindFramebuffer(GL_FRAMEBUFFER, gbuffer);
    for (int i = 0; i < 4; ++i) {
        glBindTexture(GL_TEXTURE_2D, textures[i]);
        glTexStorage2D(GL_TEXTURE_2D, 1, formats[i], WIDTH, HEIGHT);
        glFramebufferTexture2D(GL_FRAMEBUFFER, attachments[i], GL_TEXTURE_2D, textures[i], 0);
    }
    glDrawBuffers(3, attachments);
    const char* header = es ? "#version 300 es\nprecision highp float;\n" : "#version 330\n";
    glAttachShader(program, shader(GL_VERTEX_SHADER, header, vertex_shader));
    glAttachShader(program, shader(GL_FRAGMENT_SHADER, header, fragment_shader));
    glLinkProgram(program);
    glUseProgram(program);

    const float f = 1.0f / tanf(0.686f / 2.0f), near = 0.01f;
    gsgi_view view = {.struct_size = sizeof view,
                      .view_from_world = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -0.273f, -0.8f, 1},
                      .clip_from_view = {f * HEIGHT / WIDTH, 0, 0, 0, 0, f, 0, 0, 0, 0, -1, -1, 0, 0, -2 * near, 0},
                      .viewport = {0, 0, WIDTH, HEIGHT}};
    glUniformMatrix4fv(glGetUniformLocation(program, "view"), 1, GL_FALSE, view.view_from_world);
    glUniformMatrix4fv(glGetUniformLocation(program, "projection"), 1, GL_FALSE, view.clip_from_view);
    glGenVertexArrays(1, &vertices);
    glBindVertexArray(vertices);
    glViewport(0, 0, WIDTH, HEIGHT);
    glEnable(GL_DEPTH_TEST);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    draw_box();

    glGenFramebuffers(1, &frame); /* the radiance alone: albedo is read while light is added */
    glBindFramebuffer(GL_FRAMEBUFFER, frame);
    glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, textures[0], 0);
    if (gsgi_light_cull(light, &view) || gsgi_light_draw(light, textures[3], textures[2], NULL) ||
        gsgi_light_add(light, frame, textures[1]))
        return 1;

    static float pixels[HEIGHT][WIDTH][4];
    glReadPixels(0, 0, WIDTH, HEIGHT, GL_RGBA, GL_FLOAT, pixels);
    FILE* picture = fopen(argv[2], "wb");
    if (!picture) fail("cannot write the picture");
    fprintf(picture, "P6\n%d %d\n255\n", WIDTH, HEIGHT);
    for (int y = HEIGHT; y-- > 0;)
        for (int x = 0; x < WIDTH; ++x)
            for (int k = 0; k < 3; ++k)
                fputc((int)(255.0f * powf(fminf(pixels[y][x][k], 1.0f), 1 / 2.2f) + 0.5f), picture);
    gsgi_light_destroy(light);
    gsgi_context_destroy(context);
    return fclose(picture) != 0;
}
