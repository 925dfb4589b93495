/* Versions, results, memory, messages, and structs that grow. */
#include "internal.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int gsgi_version(void) { return GSGI_VERSION; }

const char* gsgi_result_string(gsgi_result result) {
    switch (result) {
        case GSGI_OK:
            return "GSGI_OK";
        case GSGI_INVALID_ARGUMENT:
            return "GSGI_INVALID_ARGUMENT";
        case GSGI_INVALID_FILE:
            return "GSGI_INVALID_FILE";
        case GSGI_OUT_OF_MEMORY:
            return "GSGI_OUT_OF_MEMORY";
        case GSGI_UNSUPPORTED:
            return "GSGI_UNSUPPORTED";
        case GSGI_DRIVER_ERROR:
            return "GSGI_DRIVER_ERROR";
        case GSGI_NOTHING_CULLED:
            return "GSGI_NOTHING_CULLED";
        case GSGI_CONTEXT_LOST:
            return "GSGI_CONTEXT_LOST";
    }
    return "unknown gsgi_result";
}

void* gsgi__allocate(const gsgi_callbacks* callbacks, size_t size) {
    return callbacks->allocate ? callbacks->allocate(size, callbacks->user) : malloc(size);
}

void gsgi__release(const gsgi_callbacks* callbacks, void* memory) {
    if (!memory) return;
    if (callbacks->release)
        callbacks->release(memory, callbacks->user);
    else if (!callbacks->allocate)
        free(memory);
}

static void log_list(const gsgi_callbacks* callbacks, gsgi_severity severity, const char* format, va_list arguments) {
    char message[1024];
    if (!callbacks->log) return;
    vsnprintf(message, sizeof message, format, arguments);
    callbacks->log(severity, message, callbacks->user);
}

void gsgi__log(const gsgi_callbacks* callbacks, gsgi_severity severity, const char* format, ...) {
    va_list arguments;
    va_start(arguments, format);
    log_list(callbacks, severity, format, arguments);
    va_end(arguments);
}

gsgi_result gsgi__fail(const gsgi_callbacks* callbacks, gsgi_result result, const char* format, ...) {
    va_list arguments;
    va_start(arguments, format);
    log_list(callbacks, GSGI_ERROR, format, arguments);
    va_end(arguments);
    return result;
}

gsgi_result gsgi__read_options(const void* given, void* own, size_t own_size) {
    size_t size = own_size;
    memset(own, 0, own_size);
    if (given) {
        memcpy(&size, given, sizeof size);
        if (size < sizeof size) return GSGI_INVALID_ARGUMENT;
        /* Options that this version does not know are refused, unless they are the defaults. */
        for (size_t i = own_size; i < size; ++i)
            if (((const unsigned char*)given)[i]) return GSGI_UNSUPPORTED;
        memcpy(own, given, size < own_size ? size : own_size);
    }
    memcpy(own, &own_size, sizeof own_size);
    return GSGI_OK;
}

gsgi_result gsgi__write_struct(const void* own, size_t own_size, void* given) {
    size_t size;
    if (!given) return GSGI_INVALID_ARGUMENT;
    memcpy(&size, given, sizeof size);
    if (size < sizeof size) return GSGI_INVALID_ARGUMENT;
    memset((unsigned char*)given + sizeof size, 0, size - sizeof size);
    memcpy((unsigned char*)given + sizeof size, (const unsigned char*)own + sizeof size,
           (size < own_size ? size : own_size) - sizeof size);
    return GSGI_OK;
}
