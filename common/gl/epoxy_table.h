// Every function pointer of libepoxy with its OpenGL name.  The Makefile makes the table from <epoxy/gl.h>.
// libepoxy finds functions through GLX or EGL alone; a context of another kind (OSMesa) fills the pointers
// itself. SPDX-License-Identifier: MIT
#ifndef COMMON_GL_EPOXY_TABLE_H
#define COMMON_GL_EPOXY_TABLE_H

#include <stddef.h>

struct epoxy_entry {
    const char *name; // "glDrawArrays"
    void *pointer;    // address of the function pointer epoxy_glDrawArrays
};
extern const struct epoxy_entry epoxy_table[];
extern const size_t epoxy_table_count;

#endif
