// What each renderer drew, with its error as a heat map under it, inside the page.
// SPDX-License-Identifier: MIT
#include "bench/error/error.h"
#include "bench/report/parts.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

static void add_base64(struct text *page, const unsigned char *bytes, size_t count)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    for (size_t i = 0; i < count; i += 3) {
        uint32_t block = (uint32_t)bytes[i] << 16;
        if (i + 1 < count) block |= (uint32_t)bytes[i + 1] << 8;
        if (i + 2 < count) block |= bytes[i + 2];
        char out[4] = {digits[block >> 18], digits[block >> 12 & 63],
                       i + 1 < count ? digits[block >> 6 & 63] : '=',
                       i + 2 < count ? digits[block & 63] : '='};
        text_add_bytes(page, out, 4);
    }
}

static uint32_t big_endian(const unsigned char *bytes)
{
    return (uint32_t)bytes[0] << 24 | (uint32_t)bytes[1] << 16 | (uint32_t)bytes[2] << 8 | bytes[3];
}

static void add_picture(const struct report *report, const char *file, const char *what, struct text *page)
{
    static const unsigned char signature[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
    char path[4096];
    size_t size = 0;
    char *content = report_path(report, file, path, sizeof path) ? file_read(path, &size) : NULL;
    const unsigned char *bytes = (const unsigned char *)content;
    if (bytes && size >= 33 && memcmp(bytes, signature, 8) == 0) {
        text_add(page, "<img alt=\"%s\" width=\"%u\" height=\"%u\" src=\"data:image/png;base64,", what,
                 big_endian(bytes + 16), big_endian(bytes + 20));
        add_base64(page, bytes, size);
        text_add(page, "\">");
    } else
        text_add(page, "<p class=\"absent\">No picture: %s.</p>", what);
    free(content);
}

static void add_moment(const struct report *report, const cJSON *picture, struct text *page)
{
    char frame[NUMBER_TEXT], error[NUMBER_TEXT];
    text_add(page, "<figure>");
    add_picture(report, json_text(picture, "picture"), "as drawn", page);
    add_picture(report, json_text(picture, "error"), "its error as a heat map", page);
    text_add(page, "<figcaption><b>");
    text_add_escaped(page, json_text(picture, "moment"));
    text_add(page, "</b>, frame %s, error p99.9 %s\u00a0px</figcaption></figure>\n",
             count_text(json_number(picture, "frame"), frame),
             number_text(json_number(picture, "error_px_p999"), error));
}

static bool has_pictures(const struct report_run *run)
{
    const cJSON *pictures = json_at(run->json, "pictures");
    return cJSON_IsArray(pictures) && cJSON_GetArraySize(pictures) > 0;
}

// The setting shown elsewhere when it has pictures, else any that has.
static const struct report_run *pictured_run(const struct report *report, int renderer)
{
    const struct report_run *shown = report->renderers[renderer].shown;
    if (shown && has_pictures(shown)) return shown;
    for (int i = 0; i < report->run_count; i++)
        if (report->runs[i].renderer == renderer && has_pictures(&report->runs[i])) return &report->runs[i];
    return NULL;
}

// The legend asks the heat map itself for its colours, so that the two cannot part.
static void add_kind_colour(enum pixel_kind kind, const char *name, struct text *page)
{
    float nothing = NAN;
    uint8_t kinds = (uint8_t)kind, rgb[3] = {0};
    struct frame_error pixel = {
        .width = 1, .height = 1, .error_px = &nothing, .plane_px = &nothing, .kind = &kinds};
    frame_error_picture(&pixel, rgb);
    text_add(page, "<span class=\"swatch\"><i style=\"background:#%02x%02x%02x\"></i>%s</span>", rgb[0],
             rgb[1], rgb[2], name);
}

static void add_legend(struct text *page)
{
    enum { STOPS = 25 };
    text_add(page, "<div class=\"legend\"><div class=\"scale\"><i style=\"background:linear-gradient(90deg");
    for (int i = 0; i < STOPS; i++) {
        uint8_t rgb[3];
        frame_error_colour(pow(10, -2 + 3.0 * i / (STOPS - 1)), rgb);
        text_add(page, ",#%02x%02x%02x", rgb[0], rgb[1], rgb[2]);
    }
    text_add(page, ")\"></i><span>0.01</span><span>0.1</span><span>1</span><span>10\u00a0px</span></div>");
    add_kind_colour(PIXEL_SKY, "sky", page);
    add_kind_colour(PIXEL_MISS, "miss", page);
    add_kind_colour(PIXEL_SPILL, "spill", page);
    add_kind_colour(PIXEL_HOLE, "hole", page);
    add_kind_colour(PIXEL_GROUND, "ground that could not be measured", page);
    text_add(page, "</div>\n");
}

static void add_pictured(const struct report *report, int renderer, struct text *page)
{
    const struct report_run *run = pictured_run(report, renderer);
    if (!run) return;
    text_add(page, "<h3><span class=\"who\" style=\"--c:%s\">", report->renderers[renderer].colour);
    text_add_escaped(page, run->name);
    text_add(page, "</span></h3><div class=\"moments\">");
    for (const cJSON *picture = json_first(json_at(run->json, "pictures")); picture; picture = picture->next)
        add_moment(report, picture, page);
    text_add(page, "</div>\n");
}

void report_pictures(const struct report *report, struct text *page)
{
    struct text methods = {0}, baselines = {0};
    for (int i = 0; i < report->renderer_count; i++) {
        enum report_role role = report->renderers[i].role;
        if (role != ROLE_EMPTY) add_pictured(report, i, role == ROLE_METHOD ? &methods : &baselines);
    }
    page->out_of_memory |= methods.out_of_memory || baselines.out_of_memory;
    if (methods.length || baselines.length)
        add_legend(page);
    else
        text_add(page, "<p>No pictures were taken.</p>");
    if (methods.length) text_add_bytes(page, methods.data, methods.length);
    if (baselines.length) {
        text_add(page, "<details><summary>The baselines\u2019 pictures</summary>");
        text_add_bytes(page, baselines.data, baselines.length);
        text_add(page, "</details>\n");
    }
    text_finish(&methods);
    text_finish(&baselines);
}
