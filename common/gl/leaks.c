// Only under the address sanitizer: lets its leak check tell the driver's small leaks from ours.
// SPDX-License-Identifier: MIT
#define _GNU_SOURCE
#include "common/gl/context.h"

#ifdef __SANITIZE_ADDRESS__

#include <dlfcn.h>
#include <link.h>
#include <stdio.h>
#include <string.h>

const char *__lsan_default_suppressions(void); // the sanitizer calls these
const char *__lsan_default_options(void);

// Mesa 22.3 loses 112 bytes at the first draw, and 368 more in an OSMesa context.
const char *__lsan_default_suppressions(void)
{
    return "leak:_dri.so\nleak:libgallium\nleak:libOSMesa\nleak:libnvidia\n";
}

// A program without leaks says nothing.
const char *__lsan_default_options(void)
{
    return "print_suppressions=0";
}

static int find_driver(struct dl_phdr_info *info, size_t size, void *path)
{
    (void)size;
    if (!strstr(info->dlpi_name, "_dri.so") && !strstr(info->dlpi_name, "libgallium")) return 0;
    snprintf(path, 1024, "%s", info->dlpi_name);
    return 1;
}

// The driver unloads itself before leaks are looked for, and then nobody knows whose they are.
void gpu_keep_driver_loaded(void)
{
    char path[1024];
    if (dl_iterate_phdr(find_driver, path)) dlopen(path, RTLD_LAZY | RTLD_NOLOAD | RTLD_NODELETE);
}

#else

void gpu_keep_driver_loaded(void) {}

#endif
