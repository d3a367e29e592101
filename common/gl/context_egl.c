// SPDX-License-Identifier: MIT
#include "common/gl/context.h"

#include <dlfcn.h>
#include <epoxy/egl.h>
#include <stdio.h>
#include <string.h>

enum { MAX_DEVICES = 16 };

// Makes a context on a display that needs no surface.  False leaves the display terminated.
static bool open_display(struct gpu *gpu, EGLDisplay display, const char *name)
{
    static const EGLint attributes[] = {EGL_CONTEXT_MAJOR_VERSION,
                                        3,
                                        EGL_CONTEXT_MINOR_VERSION,
                                        3,
                                        EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                        EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                        EGL_NONE};
    if (display == EGL_NO_DISPLAY || !eglInitialize(display, NULL, NULL)) return false;
    if (epoxy_egl_version(display) >= 15 && epoxy_has_egl_extension(display, "EGL_KHR_surfaceless_context") &&
        epoxy_has_egl_extension(display, "EGL_KHR_no_config_context") && eglBindAPI(EGL_OPENGL_API)) {
        EGLContext context = eglCreateContext(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, attributes);
        if (context != EGL_NO_CONTEXT && eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context)) {
            gpu->display = display;
            gpu->context = context;
            gpu->info.backend = name;
            return true;
        }
        if (context != EGL_NO_CONTEXT) eglDestroyContext(display, context);
    }
    eglTerminate(display);
    return false;
}

static bool device_is_software(EGLDeviceEXT device)
{
    const char *extensions = eglQueryDeviceStringEXT(device, EGL_EXTENSIONS);
    return extensions && strstr(extensions, "EGL_MESA_device_software");
}

static bool open_devices(struct gpu *gpu, bool software)
{
    EGLDeviceEXT devices[MAX_DEVICES];
    EGLint count = 0;
    if (!epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_EXT_platform_device")) return false;
    if (!eglQueryDevicesEXT(MAX_DEVICES, devices, &count)) return false;
    for (EGLint i = 0; i < count; i++) {
        if (device_is_software(devices[i]) != software) continue;
        if (open_display(gpu, eglGetPlatformDisplayEXT(EGL_PLATFORM_DEVICE_EXT, devices[i], NULL),
                         "egl-device"))
            return true;
    }
    return false;
}

static bool open_surfaceless(struct gpu *gpu)
{
    if (!epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_MESA_platform_surfaceless")) return false;
    return open_display(gpu,
                        eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, NULL),
                        "egl-surfaceless");
}

static bool open_any(struct gpu *gpu)
{
    return open_devices(gpu, false) || open_surfaceless(gpu) || open_devices(gpu, true);
}

static bool open_any_device(struct gpu *gpu)
{
    return open_devices(gpu, false) || open_devices(gpu, true);
}

static bool open_library(struct gpu *gpu, bool (*open)(struct gpu *gpu), char reason[CONTEXT_REASON])
{
    void *library = dlopen("libEGL.so.1", RTLD_LAZY | RTLD_LOCAL); // epoxy aborts where it is missing
    if (!library) {
        snprintf(reason, CONTEXT_REASON, "libEGL.so.1 is not installed");
        return false;
    }
    gpu->library = library;
    if (epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_EXT_platform_base") && open(gpu)) return true;
    snprintf(reason, CONTEXT_REASON, "no device and no surfaceless display gives a core context");
    dlclose(library);
    gpu->library = NULL;
    return false;
}

static bool open_egl(struct gpu *gpu, int width, int height, const char *title, char reason[CONTEXT_REASON])
{
    (void)width, (void)height, (void)title;
    return open_library(gpu, open_any, reason);
}

static bool open_egl_device(struct gpu *gpu, int width, int height, const char *title,
                            char reason[CONTEXT_REASON])
{
    (void)width, (void)height, (void)title;
    return open_library(gpu, open_any_device, reason);
}

static void close_egl(struct gpu *gpu)
{
    eglMakeCurrent(gpu->display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    eglDestroyContext(gpu->display, gpu->context);
    eglTerminate(gpu->display);
    eglReleaseThread();
    dlclose(gpu->library);
}

const struct context_type context_egl = {"egl", open_egl, close_egl};
const struct context_type context_egl_device = {"egl", open_egl_device, close_egl};
