// SPDX-License-Identifier: MIT
#include "bench/report/parts.h"
#include "common/report.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define DASH "\u2013"

static bool text_reserve(struct text *text, size_t extra)
{
    if (text->out_of_memory) return false;
    size_t needed = text->length + extra + 1;
    if (needed <= text->capacity) return true;
    size_t capacity = text->capacity ? text->capacity : 4096;
    while (capacity < needed) capacity *= 2;
    char *data = realloc(text->data, capacity);
    if (!data) {
        text->out_of_memory = true;
        return false;
    }
    text->data = data;
    text->capacity = capacity;
    return true;
}

void text_add_bytes(struct text *text, const char *bytes, size_t count)
{
    if (!text_reserve(text, count)) return;
    memcpy(text->data + text->length, bytes, count);
    text->length += count;
    text->data[text->length] = 0;
}

void text_add(struct text *text, const char *format, ...)
{
    va_list arguments, again;
    va_start(arguments, format);
    va_copy(again, arguments);
    int count = vsnprintf(NULL, 0, format, arguments);
    if (count >= 0 && text_reserve(text, (size_t)count)) {
        vsnprintf(text->data + text->length, (size_t)count + 1, format, again);
        text->length += (size_t)count;
    }
    va_end(again);
    va_end(arguments);
}

void text_finish(struct text *text)
{
    free(text->data);
    *text = (struct text){0};
}

size_t utf8_length(const char *character)
{
    const unsigned char *c = (const unsigned char *)character;
    size_t length = c[0] < 0x80   ? 1
                    : c[0] < 0xc2 ? 0
                    : c[0] < 0xe0 ? 2
                    : c[0] < 0xf0 ? 3
                    : c[0] < 0xf5 ? 4
                                  : 0;
    for (size_t i = 1; i < length; i++)
        if ((c[i] & 0xc0) != 0x80) return 0;
    if ((c[0] == 0xe0 && c[1] < 0xa0) || (c[0] == 0xed && c[1] > 0x9f)) return 0;
    if ((c[0] == 0xf0 && c[1] < 0x90) || (c[0] == 0xf4 && c[1] > 0x8f)) return 0;
    return length;
}

void text_add_escaped(struct text *text, const char *raw)
{
    if (!raw) raw = DASH;
    for (const unsigned char *c = (const unsigned char *)raw; *c;) {
        size_t length = utf8_length((const char *)c);
        if (*c == '&')
            text_add(text, "&amp;");
        else if (*c == '<')
            text_add(text, "&lt;");
        else if (*c == '>')
            text_add(text, "&gt;");
        else if (*c == '"')
            text_add(text, "&quot;");
        else if (*c == '\'')
            text_add(text, "&#39;");
        else if (*c < 0x20 || *c == 0x7f)
            text_add(text, " ");
        else if (length == 0)
            text_add(text, "\ufffd");
        else
            text_add_bytes(text, (const char *)c, length);
        c += length ? length : 1;
    }
}

static const double MOST_DIGITS = 1e15; // counts from there on are told by three digits and a power

const char *count_text(double value, char out[NUMBER_TEXT])
{
    if (!isfinite(value)) return strcpy(out, DASH);
    if (fabs(value) >= MOST_DIGITS) return number_text(value, out);
    char digits[32];
    int count = snprintf(digits, sizeof digits, "%.0f", fabs(value));
    char *end = out;
    if (value < 0 && strcmp(digits, "0") != 0) end += sprintf(end, "\u2212");
    for (int i = 0; i < count; i++) {
        if (i > 0 && (count - i) % 3 == 0) end += sprintf(end, "\u202f");
        *end++ = digits[i];
    }
    *end = 0;
    return out;
}

static char *superscript(char *end, int value)
{
    static const char *const digits[10] = {"\u2070", "\u00b9", "\u00b2", "\u00b3", "\u2074",
                                           "\u2075", "\u2076", "\u2077", "\u2078", "\u2079"};
    char plain[16];
    snprintf(plain, sizeof plain, "%d", abs(value));
    if (value < 0) end += sprintf(end, "\u207b");
    for (char *c = plain; *c; c++) end += sprintf(end, "%s", digits[*c - '0']);
    return end;
}

const char *number_text(double value, char out[NUMBER_TEXT])
{
    if (!isfinite(value)) return strcpy(out, DASH);
    if (value == floor(value) && fabs(value) < MOST_DIGITS) return count_text(value, out);
    char scientific[32]; // rounds first, so that 9.999 reads 10.0 and not 10.00
    snprintf(scientific, sizeof scientific, "%.2e", fabs(value));
    int exponent = atoi(strchr(scientific, 'e') + 1);
    if (exponent >= 3 && exponent < 15) return count_text(value, out);
    const char *sign = value < 0 ? "\u2212" : "";
    if (exponent >= -3 && exponent < 3) {
        snprintf(out, NUMBER_TEXT, "%s%.*f", sign, 2 - exponent, fabs(value));
        return out;
    }
    superscript(out + sprintf(out, "%s%.4s\u00d710", sign, scientific), exponent);
    return out;
}

const char *short_text(double value, char out[NUMBER_TEXT])
{
    number_text(value, out);
    char *dot = strchr(out, '.'), *end = out + strlen(out);
    if (!dot || end[-1] < '0' || end[-1] > '9') return out;
    while (end[-1] == '0') *--end = 0;
    if (end[-1] == '.') *--end = 0;
    return out;
}

const char *bytes_text(double value, char out[NUMBER_TEXT])
{
    static const char *const units[] = {"B", "KiB", "MiB", "GiB", "TiB"};
    if (!isfinite(value)) return strcpy(out, DASH);
    int unit = 0;
    while (value >= 1024 && unit < 4) {
        value /= 1024;
        unit++;
    }
    char number[NUMBER_TEXT];
    if (unit == 0)
        count_text(value, number);
    else
        number_text(value, number);
    snprintf(out, NUMBER_TEXT, "%.30s\u00a0%s", number, units[unit]);
    return out;
}

char *file_read(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    if (!file) return NULL;
    struct text content = {0};
    char block[65536];
    for (size_t count; (count = fread(block, 1, sizeof block, file)) > 0;)
        text_add_bytes(&content, block, count);
    int error = ferror(file) ? errno : 0;
    fclose(file);
    text_add_bytes(&content, "", 0);
    if (error || content.out_of_memory) {
        text_finish(&content);
        errno = error ? error : ENOMEM;
        return NULL;
    }
    *size = content.length;
    return content.data;
}

bool text_write(const struct text *text, const char *path)
{
    char temporary[4200];
    if (text->out_of_memory) return fail("%s: not enough memory to write it", path);
    if ((size_t)snprintf(temporary, sizeof temporary, "%s.tmp", path) >= sizeof temporary)
        return fail("%s: the name is too long", path);
    FILE *file = fopen(temporary, "wb");
    if (!file) return fail("%s: cannot be written (%s); expected a folder that can", path, strerror(errno));
    bool good = fwrite(text->data, 1, text->length, file) == text->length;
    int error = errno;
    if (fclose(file) != 0 && good) {
        good = false;
        error = errno;
    }
    if (good && rename(temporary, path) != 0) {
        good = false;
        error = errno;
    }
    if (!good) {
        unlink(temporary);
        return fail("%s: cannot be written (%s)", path, strerror(error));
    }
    return true;
}
