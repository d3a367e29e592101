// SPDX-License-Identifier: MIT
#include "bench/machine.h"
#include "common/parallel.h"

#include <stdio.h>
#include <string.h>
#include <sys/utsname.h>
#include <time.h>
#include <unistd.h>

static double clock_ms(clockid_t clock)
{
    struct timespec now;
    clock_gettime(clock, &now);
    return (double)now.tv_sec * 1e3 + (double)now.tv_nsec * 1e-6;
}

double clock_thread_ms(void)
{
    return clock_ms(CLOCK_THREAD_CPUTIME_ID);
}

double clock_process_ms(void)
{
    return clock_ms(CLOCK_PROCESS_CPUTIME_ID);
}

double clock_wall_ms(void)
{
    return clock_ms(CLOCK_MONOTONIC);
}

// Value of the first line `key : value` of a file of such lines.
static void read_field(const char *file, const char *key, char *out, size_t size)
{
    char line[512];
    snprintf(out, size, "unknown");
    FILE *stream = fopen(file, "r");
    if (!stream) return;
    while (fgets(line, sizeof line, stream)) {
        char *colon = strchr(line, ':');
        if (!colon || strncmp(line, key, strlen(key)) != 0) continue;
        snprintf(out, size, "%s", colon + 1 + strspn(colon + 1, " \t"));
        out[strcspn(out, "\n")] = 0;
        break;
    }
    fclose(stream);
}

void machine_describe(struct machine *machine)
{
    struct utsname name;
    char distribution[128] = "";
    read_field("/proc/cpuinfo", "model name", machine->cpu, sizeof machine->cpu);
    machine->cores = parallel_processors();
    double bytes = (double)sysconf(_SC_PHYS_PAGES) * (double)sysconf(_SC_PAGESIZE);
    snprintf(machine->memory_gib, sizeof machine->memory_gib, "%.1f", bytes / 0x1p30);
    FILE *stream = fopen("/etc/debian_version", "r");
    if (stream) {
        if (fgets(distribution, sizeof distribution, stream)) distribution[strcspn(distribution, "\n")] = 0;
        fclose(stream);
    }
    if (uname(&name) != 0) memset(&name, 0, sizeof name);
    snprintf(machine->system, sizeof machine->system, "%.40s %.60s %.30s%s%.60s", name.sysname, name.release,
             name.machine, distribution[0] ? ", Debian " : "", distribution);
}
