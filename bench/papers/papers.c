// The subcommand `papers`: options, the tables in order, and where they are written.
// SPDX-License-Identifier: MIT
#include "bench/papers/papers.h"
#include "bench/result_files.h"
#include "common/cli.h"
#include "common/report.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const struct papers_entry {
    const char *id, *paper;
    papers_measure *measure;
} entries[] = {
    {"clipmap-1", "Losasso & Hoppe 2004, Table 1", papers_clipmap_update},
    {"clipmap-2", "Losasso & Hoppe 2004, Table 2", papers_clipmap_error},
    {"clipmap-rate", "Losasso & Hoppe 2004, section 9, rendering rate", papers_clipmap_rate},
    {"clipmap-3", "Losasso & Hoppe 2004, Table 3", papers_clipmap_space},
    {"clipmap-coder", "Losasso & Hoppe 2004, section 9, compression error", papers_clipmap_compression},
    {"clipmap-peers", "Losasso & Hoppe 2004, section 5, beside other coders", papers_coders},
    {"clipmap-filter", "Losasso & Hoppe 2004, section 7, the filter D", papers_clipmap_filter},
    {"clipmap-apart", "Losasso & Hoppe 2004, section 9, errors apart and together", papers_clipmap_apart},
    {"pgm-1", "Livny et al. 2008, Table 1", papers_pgm_rates},
    {"pgm-2", "Livny et al. 2008, Table 2", papers_pgm_steps},
    {"pgm-3", "Livny et al. 2008, Table 3", papers_pgm_extension},
    {"pgm-4", "Livny et al. 2008, Table 4", papers_pgm_distortion},
    {"pgm-5", "Livny et al. 2008, Table 5", papers_pgm_error},
    {"pgm-6", "Livny et al. 2008, Table 6", papers_pgm_angles},
    {"pgm-7", "Livny et al. 2008, Table 7", papers_pgm_updates},
    {"pgm-culled", "Livny et al. 2008, section 6.3, culled samples", papers_pgm_culled},
    {"mars-1", "Geometry clipmapping for Mars, Table 1", papers_mars_compression},
    {"mars-growth", "Geometry clipmapping for Mars, the dropped bit", papers_mars_growth},
    {"mars-3", "Geometry clipmapping for Mars, Table 3", papers_mars_rendering},
    {"sphere-views", "Clasen & Hege 2006, section 5.2, Figures 15 to 17", papers_sphere_views},
    {"sphere-kept", "Clasen & Hege 2006, section 6.1, vertices kept", papers_sphere_kept},
    {"sphere-sampling", "Clasen & Hege 2006, sections 4.2 and 5.2, height textures", papers_sphere_sampling},
    {"geomipmap-sets", "Brodersen 2005, section 5, index sets", papers_geomipmap_sets},
    {"geomipmap-rate", "Brodersen 2005, sections 4 to 6", papers_geomipmap_rate},
    {"geomipmap-work", "Brodersen 2005, section 6, CPU work", papers_geomipmap_work},
    {"geomipmap-motion", "Brodersen 2005, section 4, levels that change", papers_geomipmap_motion},
    {"geomipmap-large", "Brodersen 2005, section 6, a large map", papers_geomipmap_large},
};
enum { ENTRIES = sizeof entries / sizeof entries[0] };

struct papers_options {
    const char *only, *out, *backend;
    int repeats, size[2];
};

const char *papers_data(struct papers_table *table, const char *name, char path[1024])
{
    const char *folder = getenv("RELIEF_DATA");
    if (folder) {
        snprintf(path, 1024, "%s/%s", folder, name);
        if (access(path, R_OK) == 0) return path;
    }
    snprintf(table->skipped, sizeof table->skipped, "%s is not in the folder $RELIEF_DATA", name);
    return NULL;
}

// True when a list "a,b" names the id, or there is none.
static bool is_wanted(const char *list, const char *id)
{
    size_t length = strlen(id);
    for (const char *at = list; at && *at;) {
        size_t word = strcspn(at, ",");
        if (word == length && strncmp(at, id, length) == 0) return true;
        at += word + (at[word] == ',');
    }
    return list == NULL;
}

static bool check_only(const char *list)
{
    for (const char *at = list; at && *at;) {
        size_t word = strcspn(at, ",");
        int e = 0;
        while (e < ENTRIES && !(strlen(entries[e].id) == word && strncmp(at, entries[e].id, word) == 0)) e++;
        if (e == ENTRIES)
            return fail("--only %s: '%.*s' is no table; see bench papers --help", list, (int)word, at);
        at += word + (at[word] == ',');
    }
    return true;
}

// ---- the folder --------------------------------------------------------------------------------

static cJSON *document(const struct papers *papers, const struct papers_table *tables, int count)
{
    cJSON *root = cJSON_CreateObject();
    cJSON_AddNumberToObject(root, "schema", 1);
    result_add_created(root);
    result_add_machine(root, gpu_info(papers->gpu));
    cJSON_AddNumberToObject(root, "repeats", papers->repeats);
    cJSON_AddStringToObject(root, "times", papers->cpu_times ? "cpu" : "wall");
    cJSON *array = cJSON_AddArrayToObject(root, "tables");
    for (int t = 0; t < count; t++) cJSON_AddItemToArray(array, papers_table_json(&tables[t]));
    return root;
}

static const char *clock_text(const struct papers *papers)
{
    return papers->cpu_times ? "CPU time of the GL thread, which rasterises too" : "wall-clock time";
}

static void add_page(const struct papers *papers, const cJSON *root, const struct papers_table *tables,
                     int count, struct text *page)
{
    page_head(page, "the papers, measured again");
    text_add(page, "<header><p class=\"eyebrow\">Relief</p>\n<h1>The papers, measured again</h1>\n"
                   "<p class=\"lead\">Tables of the papers beside what this program measures on this "
                   "machine. Under each stands what differs.</p>\n</header>\n<nav>");
    for (int t = 0; t < count; t++) {
        text_add(page, "<a href=\"#%s\">", tables[t].id);
        text_add_escaped(page, tables[t].paper);
        text_add(page, "</a>");
    }
    text_add(page, "</nav>\n");
    for (int t = 0; t < count; t++) papers_table_html(&tables[t], page);
    text_add(page, "<section id=\"method\"><h2>Method and machine</h2>\n<dl>");
    page_machine(root, page);
    text_add(
        page,
        "<dt>Time</dt><dd>%s. Frames: per frame the minimum over %d repeats, then the median over frames, "
        "settings interleaved. Steps of an update: the median over repeats.</dd></dl></section>\n"
        "</main></body></html>\n",
        clock_text(papers), papers->repeats);
}

static bool write_folder(const struct papers *papers, const struct papers_table *tables, int count,
                         const char *folder)
{
    char path[1024];
    struct text page = {0};
    cJSON *root = document(papers, tables, count);
    char *json = cJSON_Print(root);
    snprintf(path, sizeof path, "%s/papers.json", folder);
    bool good = json ? result_write_text(path, json) : fail("papers: out of memory");
    add_page(papers, root, tables, count, &page);
    snprintf(path, sizeof path, "%s/papers.html", folder);
    good = good && text_write(&page, path);
    if (good) printf("papers: %s\n", path);
    text_finish(&page);
    free(json);
    cJSON_Delete(root);
    return good;
}

// ---- the order of work -------------------------------------------------------------------------

static bool measure_all(struct papers *papers, const char *only, struct papers_table *tables, int *count)
{
    printf("Times are %s; repeats %d.\n\n", clock_text(papers), papers->repeats);
    for (int e = 0; e < ENTRIES; e++) {
        if (!is_wanted(only, entries[e].id)) continue;
        struct papers_table *table = &tables[(*count)++];
        struct text out = {0};
        snprintf(table->id, sizeof table->id, "%s", entries[e].id);
        snprintf(table->paper, sizeof table->paper, "%s", entries[e].paper);
        if (!entries[e].measure(papers, table)) return false;
        papers_table_text(table, &out);
        if (out.out_of_memory) return text_finish(&out), fail("papers: out of memory");
        printf("%s\n", out.data);
        fflush(stdout);
        text_finish(&out);
    }
    return true;
}

static bool work(const struct papers_options *options)
{
    enum gpu_backend backend = GPU_AUTO;
    struct papers papers = {
        .repeats = options->repeats, .width = options->size[0], .height = options->size[1]};
    if (options->out && !result_prepare_folder(options->out)) return false;
    gpu_backend_parse(options->backend, &backend);
    papers.gpu = gpu_create(backend, papers.width, papers.height, "Relief", 0);
    if (!papers.gpu) return false;
    papers.cpu_times = gpu_info(papers.gpu)->software;
    struct papers_table *tables = calloc(ENTRIES, sizeof *tables);
    int count = 0;
    bool good = tables ? measure_all(&papers, options->only, tables, &count) : fail("papers: out of memory");
    good = good && (!options->out || write_folder(&papers, tables, count, options->out));
    free(tables);
    scene_destroy(papers.scene);
    gpu_destroy(papers.gpu);
    return good;
}

static void print_help(const struct cli_option *options)
{
    printf(
        "usage: bench papers [options]\nMeasures tables of the papers again, beside the printed figures.\n");
    cli_print_options(options);
    printf("tables:\n");
    for (int e = 0; e < ENTRIES; e++) printf("  %-14s %s\n", entries[e].id, entries[e].paper);
}

int papers_main(int argc, char **argv)
{
    struct papers_options o = {.backend = "auto", .repeats = 5, .size = {640, 480}};
    bool help = false;
    const struct cli_option options[] = {
        {"only", "LIST", "tables to measure, by the names below (default: all)", CLI_TEXT, &o.only, 0, 0,
         NULL},
        {"out", "DIR", "folder that papers.json and papers.html are written to", CLI_TEXT, &o.out, 0, 0,
         NULL},
        {"repeats", "N", "timed flights of each setting", CLI_INT, &o.repeats, 1, 1000, NULL},
        {"backend", "NAME", "auto, glfw, egl or osmesa", CLI_TEXT, &o.backend, 0, 0, "auto|glfw|egl|osmesa"},
        {"size", "WxH", "picture in pixels (default: the papers' 640x480)", CLI_SIZE, o.size, 1, 16384, NULL},
        {"help", NULL, "this list", CLI_FLAG, &help, 0, 0, NULL},
        {0},
    };
    const char *words[1];
    int word_count = 1;
    if (!cli_parse(argc - 1, argv + 1, options, words, &word_count)) return EXIT_COMMAND_LINE;
    if (help) return print_help(options), EXIT_GOOD;
    if (word_count > 0)
        return fail("papers: '%s' is not an option; see bench papers --help", words[0]), EXIT_COMMAND_LINE;
    if (!check_only(o.only)) return EXIT_COMMAND_LINE;
    return work(&o) ? EXIT_GOOD : EXIT_WORLD;
}
