// SPDX-License-Identifier: MIT
#include "bench/report/plot.h"
#include "common/report.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

enum { GNUPLOT_MISSING = 127 };

// Runs `gnuplot NAME.gp > NAME.svg.tmp` in the folder and gives its exit code.
static int run_gnuplot(const char *folder, const char *script, const char *output)
{
    pid_t child = fork();
    if (child == 0) {
        int out = chdir(folder) == 0 ? open(output, O_CREAT | O_TRUNC | O_WRONLY, 0666) : -1;
        int nothing = open("/dev/null", O_RDWR);
        if (out < 0 || nothing < 0 || dup2(out, 1) < 0 || dup2(nothing, 0) < 0 || dup2(nothing, 2) < 0)
            _exit(126);
        execlp("gnuplot", "gnuplot", script, (char *)NULL);
        _exit(errno == ENOENT ? GNUPLOT_MISSING : 126);
    }
    int status;
    if (child < 0 || waitpid(child, &status, 0) != child) return 126;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 126;
}

// Copies a figure for use inside HTML: no XML declaration and namespaces, its size left to the page, and its
// ids with the figure's name in front, since one page holds many figures and ids must not clash.
static void embed_svg(struct text *out, const char *svg, const char *name, const char *title)
{
    static const char *const links[] = {" id='", " id=\"", "url(#"};
    const char *root = strstr(svg, "<svg"), *view = root ? strstr(root, "viewBox=\"") : NULL;
    const char *body = root ? strchr(root, '>') : NULL;
    if (!view || !body || view > body) return;
    text_add(out, "<svg role=\"img\" aria-label=\"%s\" viewBox=\"%.*s\">", title,
             (int)strcspn(view + 9, "\""), view + 9);
    for (const char *c = body + 1; *c;) {
        const char *skip = strncmp(c, "<title>", 7) == 0  ? "</title>"
                           : strncmp(c, "<desc>", 6) == 0 ? "</desc>"
                                                          : NULL;
        const char *end = skip ? strstr(c, skip) : NULL;
        if (end) {
            c = end + strlen(skip);
            continue;
        }
        if (strncmp(c, "xlink:href='#", 13) == 0) {
            text_add(out, "href='#%s_", name);
            c += 13;
            continue;
        }
        size_t length = 0;
        for (int i = 0; i < 3 && length == 0; i++)
            if (strncmp(c, links[i], strlen(links[i])) == 0) length = strlen(links[i]);
        text_add_bytes(out, c, length ? length : 1);
        if (length) text_add(out, "%s_", name);
        c += length ? length : 1;
    }
}

bool plot_draw(const char *folder, const char *name, const char *title, const struct text *script,
               const struct text *data, struct text *svg, bool *gnuplot_found)
{
    char path[4200], temporary[4200], script_name[64], output[64];
    snprintf(script_name, sizeof script_name, "%s.gp", name);
    snprintf(output, sizeof output, "%s.svg.tmp", name);
    plot_remove(folder, name);
    snprintf(path, sizeof path, "%s/%s.dat", folder, name);
    if (!text_write(data, path)) return false;
    snprintf(path, sizeof path, "%s/%s.gp", folder, name);
    if (!text_write(script, path)) return false;
    if (!*gnuplot_found) return true;
    snprintf(path, sizeof path, "%s/%s.svg", folder, name);
    snprintf(temporary, sizeof temporary, "%s/%s", folder, output);
    int code = run_gnuplot(folder, script_name, output);
    size_t size;
    char *drawn = code == 0 ? file_read(temporary, &size) : NULL;
    bool whole = drawn && strstr(drawn, "</svg>") && rename(temporary, path) == 0;
    if (whole)
        embed_svg(svg, drawn, name, title);
    else
        unlink(temporary);
    free(drawn);
    *gnuplot_found = code != GNUPLOT_MISSING;
    if (!*gnuplot_found)
        note("gnuplot is not installed: the report has no figures, their scripts are in %s", folder);
    else if (!whole)
        note("%s/%s: gnuplot could not draw it", folder, script_name);
    return true;
}

void plot_remove(const char *folder, const char *name)
{
    static const char *const endings[] = {"dat", "gp", "svg"};
    char path[4200];
    for (int i = 0; i < 3; i++) {
        snprintf(path, sizeof path, "%s/%s.%s", folder, name, endings[i]);
        unlink(path);
    }
}
