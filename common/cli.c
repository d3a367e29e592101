// SPDX-License-Identifier: MIT
#include "common/cli.h"

#include "common/report.h"

#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static bool ranged(const struct cli_option *option)
{
    return option->min < option->max;
}

// What an option accepts, in the words of an error line.
static void describe(const struct cli_option *option, char *text, size_t size)
{
    char range[64] = "";
    if (ranged(option)) snprintf(range, sizeof range, " %.10g..%.10g", option->min, option->max);
    switch (option->kind) {
    case CLI_FLAG:
        snprintf(text, size, "no value");
        break;
    case CLI_TEXT:
        snprintf(text, size, "%s", option->choices ? option->choices : option->metavar);
        break;
    case CLI_INT:
        snprintf(text, size, "a whole number%s", range);
        break;
    case CLI_NUMBER:
        snprintf(text, size, "a number%s", range);
        break;
    case CLI_SIZE:
        snprintf(text, size, "WIDTHxHEIGHT%s%s", *range ? ", each" : "", range);
        break;
    }
}

static bool refuse(const struct cli_option *option, const char *text, const char *what)
{
    char accepted[256];
    describe(option, accepted, sizeof accepted);
    return fail("--%s: %s is not %s; accepted is %s", option->name, *text ? text : "\"\"", what, accepted);
}

static bool in_range(const struct cli_option *option, double value)
{
    return !ranged(option) || (value >= option->min && value <= option->max);
}

static bool parse_int(const char *text, const char **end, long *value)
{
    char *stop;
    errno = 0;
    *value = strtol(text, &stop, 10);
    *end = stop;
    return stop != text && errno == 0 && *value >= INT_MIN && *value <= INT_MAX;
}

static bool is_choice(const char *choices, const char *text)
{
    size_t length = strlen(text);
    for (const char *word = choices; word; word = strchr(word, '|') ? strchr(word, '|') + 1 : NULL)
        if (length && !strchr(text, '|') && strncmp(word, text, length) == 0 &&
            (word[length] == '|' || word[length] == '\0'))
            return true;
    return false;
}

static bool set_int(const struct cli_option *option, const char *text)
{
    const char *end;
    long value;
    if (!parse_int(text, &end, &value) || *end || !in_range(option, (double)value))
        return refuse(option, text, "such a number");
    *(int *)option->value = (int)value;
    return true;
}

static bool set_number(const struct cli_option *option, const char *text)
{
    char *end;
    double value = strtod(text, &end);
    if (end == text || *end || !isfinite(value) || !in_range(option, value))
        return refuse(option, text, "such a number");
    *(double *)option->value = value;
    return true;
}

static bool set_size(const struct cli_option *option, const char *text)
{
    const char *end;
    long width, height;
    bool good = text[0] >= '0' && text[0] <= '9' && parse_int(text, &end, &width) && *end == 'x' &&
                end[1] >= '0' && end[1] <= '9' && parse_int(end + 1, &end, &height) && !*end &&
                in_range(option, (double)width) && in_range(option, (double)height);
    if (!good) return refuse(option, text, "a size");
    ((int *)option->value)[0] = (int)width;
    ((int *)option->value)[1] = (int)height;
    return true;
}

static bool set_value(const struct cli_option *option, const char *text)
{
    switch (option->kind) {
    case CLI_INT:
        return set_int(option, text);
    case CLI_NUMBER:
        return set_number(option, text);
    case CLI_SIZE:
        return set_size(option, text);
    default:
        break;
    }
    if (option->choices && !is_choice(option->choices, text)) return refuse(option, text, "one of its words");
    *(const char **)option->value = text;
    return true;
}

static const struct cli_option *find(const struct cli_option *options, const char *name, size_t length)
{
    for (; options->name; options++)
        if (strlen(options->name) == length && strncmp(options->name, name, length) == 0) return options;
    return NULL;
}

// Takes the option at argv[*at] and moves *at to the last word that belongs to it.
static bool take_option(int argc, char **argv, int *at, const struct cli_option *options)
{
    const char *word = argv[*at], *name = word + 2, *equals = strchr(word, '=');
    bool dashes = word[1] == '-';
    size_t length = dashes ? (equals ? (size_t)(equals - name) : strlen(name)) : 0;
    const struct cli_option *option = dashes ? find(options, name, length) : NULL;
    if (!option)
        return fail("%.*s: no such option; --help lists those accepted",
                    (int)(equals ? equals - word : INT_MAX), word);
    if (option->kind == CLI_FLAG) {
        if (equals) return fail("--%s: takes no value", option->name);
        return *(bool *)option->value = true;
    }
    if (equals) return set_value(option, equals + 1);
    if (*at + 1 >= argc || strncmp(argv[*at + 1], "--", 2) == 0) {
        char accepted[256];
        describe(option, accepted, sizeof accepted);
        return fail("--%s: its value is missing; accepted is %s", option->name, accepted);
    }
    return set_value(option, argv[++*at]);
}

bool cli_parse(int argc, char **argv, const struct cli_option *options, const char **words, int *word_count)
{
    int room = word_count ? *word_count : 0, found = 0;
    bool only_words = false;
    for (int at = 1; at < argc; at++) {
        if (!only_words && strcmp(argv[at], "--") == 0) {
            only_words = true;
        } else if (!only_words && argv[at][0] == '-' && argv[at][1]) {
            if (!take_option(argc, argv, &at, options)) return false;
        } else if (found < room) {
            words[found++] = argv[at];
        } else {
            return fail("%s: a word too many (%d accepted); --help tells what is accepted", argv[at], room);
        }
    }
    if (word_count) *word_count = found;
    return true;
}

void cli_print_options(const struct cli_option *options)
{
    for (; options->name; options++) {
        char left[128];
        snprintf(left, sizeof left, "--%s%s%s", options->name, options->metavar ? " " : "",
                 options->metavar ? options->metavar : "");
        printf("  %-28s %s", left, options->help);
        if (options->choices) printf(" (%s)", options->choices);
        printf("\n");
    }
}
