// SPDX-License-Identifier: MIT
#include "common/gl/context.h"
#include "common/gl/epoxy_table.h"

#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

// From GL/osmesa.h, which is absent where Mesa no longer has OSMesa; the library is opened at run time, never
// linked.
enum {
    OSMESA_FORMAT = 0x22,
    OSMESA_PROFILE = 0x33,
    OSMESA_CORE_PROFILE = 0x34,
    OSMESA_CONTEXT_MAJOR_VERSION = 0x36,
    OSMESA_CONTEXT_MINOR_VERSION = 0x37,
    SIDE = 16, // of the picture that the context insists on; everything is drawn to framebuffers of ours
};

typedef void *create_fn(const int *attributes, void *share);
typedef GLboolean make_current_fn(void *context, void *buffer, GLenum type, GLsizei width, GLsizei height);
typedef void destroy_fn(void *context);
typedef void (*proc)(void);
typedef proc get_proc_fn(const char *name);

// ISO C has no cast from object pointers to function pointers; POSIX promises that their bits are the same.
static bool find(void *library, const char *name, void *function)
{
    void *symbol = dlsym(library, name);
    memcpy(function, &symbol, sizeof symbol);
    return symbol != NULL;
}

// libepoxy asks GLX or EGL for functions and knows no OSMesa, so its pointers are set before it looks for
// anything.  Names that OSMesa does not have keep libepoxy's own resolver.
static void point_epoxy_at(get_proc_fn *get_proc)
{
    for (size_t i = 0; i < epoxy_table_count; i++) {
        proc function = get_proc(epoxy_table[i].name);
        if (function) memcpy(epoxy_table[i].pointer, &function, sizeof function);
    }
}

static void *open_library(void)
{
    static const char *const names[] = {"libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"};
    void *library = NULL;
    for (size_t i = 0; !library && i < sizeof names / sizeof *names; i++)
        library = dlopen(names[i], RTLD_NOW | RTLD_LOCAL);
    return library;
}

static bool open_osmesa(struct gpu *gpu, int width, int height, const char *title,
                        char reason[CONTEXT_REASON])
{
    (void)width, (void)height, (void)title;
    static const int attributes[] = {OSMESA_FORMAT,
                                     GL_RGBA,
                                     OSMESA_PROFILE,
                                     OSMESA_CORE_PROFILE,
                                     OSMESA_CONTEXT_MAJOR_VERSION,
                                     3,
                                     OSMESA_CONTEXT_MINOR_VERSION,
                                     3,
                                     0};
    create_fn *create;
    make_current_fn *make_current;
    destroy_fn *destroy;
    get_proc_fn *get_proc;
    void *library = open_library();
    if (!library || !find(library, "OSMesaCreateContextAttribs", &create) ||
        !find(library, "OSMesaMakeCurrent", &make_current) ||
        !find(library, "OSMesaDestroyContext", &destroy) ||
        !find(library, "OSMesaGetProcAddress", &get_proc)) {
        snprintf(reason, CONTEXT_REASON, library ? "libOSMesa is too old" : "libOSMesa is not installed");
        if (library) dlclose(library);
        return false;
    }
    void *context = create(attributes, NULL);
    void *picture = context ? malloc(SIDE * SIDE * 4) : NULL;
    if (!picture || !make_current(context, picture, GL_UNSIGNED_BYTE, SIDE, SIDE)) {
        snprintf(reason, CONTEXT_REASON, "libOSMesa makes no core context");
        if (context) destroy(context);
        free(picture);
        dlclose(library);
        return false;
    }
    point_epoxy_at(get_proc);
    gpu->library = library;
    gpu->context = context;
    gpu->surface = picture;
    gpu->info.backend = "osmesa";
    return true;
}

static void close_osmesa(struct gpu *gpu)
{
    destroy_fn *destroy;
    if (find(gpu->library, "OSMesaDestroyContext", &destroy)) destroy(gpu->context);
    free(gpu->surface);
    // The library stays: libepoxy's pointers lead into it.
}

const struct context_type context_osmesa = {"osmesa", open_osmesa, close_osmesa};
