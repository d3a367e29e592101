// SPDX-License-Identifier: MIT
#include "common/renderer.h"
#include "common/report.h"
#include "common/terrain/terrain.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void renderer_default_knobs(const struct renderer_type *type, double knobs[RENDERER_MAX_KNOBS])
{
    for (int i = 0; i < RENDERER_MAX_KNOBS; i++) knobs[i] = 0;
    for (int i = 0; type->knobs[i].name; i++) knobs[i] = type->knobs[i].fallback;
}

const char *renderer_unsupported(const struct renderer_type *type, const struct terrain *terrain)
{
    return terrain_info(terrain)->datum == TERRAIN_SPHERE && !type->spheres ? "sphere" : NULL;
}

int renderer_knob_index(const struct renderer_type *type, const char *name)
{
    for (int i = 0; type->knobs[i].name; i++)
        if (strcmp(type->knobs[i].name, name) == 0) return i;
    return -1;
}

// Start and length of word `index` of "a|b|c"; NULL beyond the last.
static const char *choice_word(const char *choices, int index, size_t *length)
{
    for (; *choices; choices++) {
        *length = strcspn(choices, "|");
        if (index-- == 0) return choices;
        choices += *length;
        if (!*choices) break;
    }
    return NULL;
}

static bool parse_choice(const struct renderer_knob *knob, const char *text, double *value)
{
    size_t length;
    const char *word;
    for (int i = 0; (word = choice_word(knob->choices, i, &length)); i++)
        if (strlen(text) == length && strncmp(text, word, length) == 0) {
            *value = i;
            return true;
        }
    return fail("--%s %s: accepted are %s", knob->name, text, knob->choices);
}

static bool parse_number(const struct renderer_knob *knob, const char *text, double *value)
{
    char *end;
    double number = strtod(text, &end);
    if (end == text || *end || !(number >= knob->min && number <= knob->max))
        return fail("--%s %s: accepted is a number from %g to %g", knob->name, text, knob->min, knob->max);
    *value = number;
    return true;
}

bool renderer_parse_knob(const struct renderer_type *type, const char *name, const char *text,
                         double knobs[RENDERER_MAX_KNOBS])
{
    int i = renderer_knob_index(type, name);
    if (i < 0) return fail("--%s: %s has no such option; --help lists them", name, type->name);
    const struct renderer_knob *knob = &type->knobs[i];
    return knob->choices ? parse_choice(knob, text, &knobs[i]) : parse_number(knob, text, &knobs[i]);
}

void renderer_format_knob(const struct renderer_knob *knob, double value, char text[64])
{
    size_t length;
    const char *word = knob->choices ? choice_word(knob->choices, (int)value, &length) : NULL;
    if (word)
        snprintf(text, 64, "%.*s", (int)length, word);
    else
        snprintf(text, 64, "%.10g", value);
}
