// A scene's own path comes as key frames, as rows of poses, or is made to suit the terrain.
//
// A file of poses has one camera a line, `u v z yaw`, lines that start with # left out.  All lengths are
// shares of the map's width: u eastwards from the west edge, v southwards from the north edge (down the rows
// of the picture), z above height zero.  yaw in radians: ahead on the ground is (cos yaw, sin yaw) in (u, v),
// so the world's yaw is -yaw.
// SPDX-License-Identifier: MIT
#include "common/scene/scene.h"

#include "common/embedded.h"
#include "common/image.h"
#include "common/report.h"

#include <cJSON.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { DEFAULT_FRAMES = 96, FRAMES_MAX = 100000, SIDE_MAX = 16384, KEYS_MAX = 100000, TEXT_MAX = 1 << 26 };
#define DEFAULT_SCENE "bench/scenes/default.json"
#define DEGREE (M_PI / 180)

// ---- files -----------------------------------------------------------------

// The whole file with a NUL after it; NULL after one line.
static char *read_text(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    if (!file) return fail("%s: %s", path, strerror(errno)), NULL;
    char *text = NULL;
    size_t room = 0, got = 0, more = 1;
    while (more && got < TEXT_MAX) {
        if (got + 1 >= room) {
            char *grown = realloc(text, room = room ? 2 * room : 1 << 16);
            if (!grown) break;
            text = grown;
        }
        got += more = fread(text + got, 1, room - got - 1, file);
    }
    bool good = text && !ferror(file) && feof(file);
    fclose(file);
    if (!good) {
        free(text);
        return fail("%s: cannot be read as a text file", path), NULL;
    }
    text[got] = '\0';
    *size = got;
    return text;
}

static const char *base_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

// Finds a file that a scene names: beside the scene, in data/, in $RELIEF_DATA.
static bool find_file(const char *scene_file, const char *what, const char *name, char path[1024])
{
    const char *data = getenv("RELIEF_DATA");
    char beside[512];
    snprintf(beside, sizeof beside, "%.*s", (int)(base_name(scene_file) - scene_file), scene_file);
    if (name[0] == '/') {
        snprintf(path, 1024, "%s", name);
        return access(path, R_OK) == 0 || fail("%s: %s %s: %s", scene_file, what, name, strerror(errno));
    }
    snprintf(path, 1024, "%s%s", beside, name);
    if (access(path, R_OK) == 0) return true;
    snprintf(path, 1024, "data/%s", name);
    if (access(path, R_OK) == 0) return true;
    snprintf(path, 1024, "%s/%s", data ? data : "", name);
    if (data && access(path, R_OK) == 0) return true;
    return fail("%s: %s %s was not found beside the scene (%s), in data/ or in $RELIEF_DATA (%s)", scene_file,
                what, name, *beside ? beside : "./", data ? data : "not set");
}

// ---- strict JSON -----------------------------------------------------------

// Where the reader is, for the error line: which file and which object.
struct place {
    const char *file, *object;
};

static bool is_word(const char *words, const char *text)
{
    size_t length = strlen(text);
    for (const char *word = words; word; word = strchr(word, '|') ? strchr(word, '|') + 1 : NULL)
        if (length && !strchr(text, '|') && strncmp(word, text, length) == 0 &&
            (word[length] == '|' || word[length] == '\0'))
            return true;
    return false;
}

static bool check_object(struct place at, const cJSON *object, const char *accepted)
{
    if (!cJSON_IsObject(object))
        return fail("%s: %s is not an object; accepted is one with the keys %s", at.file, at.object,
                    accepted);
    for (const cJSON *item = object->child; item; item = item->next) {
        if (!is_word(accepted, item->string))
            return fail("%s: %s has an unknown key \"%s\"; accepted are %s", at.file, at.object, item->string,
                        accepted);
        if (cJSON_GetObjectItemCaseSensitive(object, item->string) != item)
            return fail("%s: %s has the key \"%s\" twice; accepted is once", at.file, at.object,
                        item->string);
    }
    return true;
}

// The readers below leave *value alone when the key is absent.
static bool read_number(struct place at, const cJSON *object, const char *key, double min, double max,
                        double *value)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, key);
    if (!item) return true;
    if (!cJSON_IsNumber(item) || !(item->valuedouble >= min && item->valuedouble <= max))
        return fail("%s: \"%s\" of %s is not right; accepted is a number %.10g..%.10g", at.file, key,
                    at.object, min, max);
    *value = item->valuedouble;
    return true;
}

static bool read_int(struct place at, const cJSON *object, const char *key, int min, int max, int *value)
{
    double number = *value;
    if (!read_number(at, object, key, min, max, &number)) return false;
    if (number != floor(number))
        return fail("%s: \"%s\" of %s is not right; accepted is a whole number %d..%d", at.file, key,
                    at.object, min, max);
    *value = (int)number;
    return true;
}

static bool read_bool(struct place at, const cJSON *object, const char *key, bool *value)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, key);
    if (!item) return true;
    if (!cJSON_IsBool(item))
        return fail("%s: \"%s\" of %s is not right; accepted is true or false", at.file, key, at.object);
    *value = cJSON_IsTrue(item);
    return true;
}

// *value stays the text's own storage.  `words`: NULL for any text that is not empty.
static bool read_text_value(struct place at, const cJSON *object, const char *key, const char *words,
                            const char **value)
{
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, key);
    if (!item) return true;
    const char *text = cJSON_GetStringValue(item);
    if (!text || !*text || (words && !is_word(words, text)))
        return fail("%s: \"%s\" of %s is not right; accepted is %s", at.file, key, at.object,
                    words ? words : "a text in quotes");
    *value = text;
    return true;
}

static cJSON *parse(const char *file, const char *text, size_t size)
{
    const char *end = NULL;
    cJSON *json = cJSON_ParseWithLengthOpts(text, size + 1, &end, true);
    if (json) return json;
    int line = 1;
    for (const char *c = text; end && c < end && c < text + size; c++) line += *c == '\n';
    return fail("%s: line %d is not JSON; accepted is one JSON object", file, line), NULL;
}

// ---- terrain ---------------------------------------------------------------

static bool read_terrain_options(struct place at, const cJSON *json, int most_finer,
                                 struct terrain_options *options)
{
    const char *filter = "linear", *noise = "hash";
    double seed = 0, cache_mib = 0, frame_samples = 0;
    if (!read_int(at, json, "synthesize_levels", 0, most_finer, &options->synthesize_levels) ||
        !read_number(at, json, "seed", 0, 0x1p53, &seed) ||
        !read_text_value(at, json, "filter", "linear|halfband|tent|decimate|optimal", &filter) ||
        !read_text_value(at, json, "noise", "hash|table", &noise) ||
        !read_number(at, json, "cache_mib", 0.001, 1 << 20, &cache_mib) ||
        !read_number(at, json, "frame_samples", -1, 1 << 30, &frame_samples) ||
        !read_int(at, json, "latency_frames", 1, 1000, &options->latency_frames))
        return false;
    if (seed != floor(seed))
        return fail("%s: \"seed\" of %s is not right; accepted is a whole number", at.file, at.object);
    options->seed = (uint64_t)seed;
    options->frame_samples = (int64_t)frame_samples;
    options->cache_bytes = (uint64_t)(cache_mib * (1 << 20));
    options->filter = *filter == 'h'   ? TERRAIN_FILTER_HALFBAND
                      : *filter == 'o' ? TERRAIN_FILTER_OPTIMAL
                      : *filter == 't' ? TERRAIN_FILTER_TENT
                      : *filter == 'd' ? TERRAIN_FILTER_DECIMATE
                                       : TERRAIN_FILTER_LINEAR;
    options->noise = *noise == 't' ? TERRAIN_NOISE_TABLE : TERRAIN_NOISE_HASH;
    return true;
}

static bool load_terrain(struct scene *scene, const char *file, const cJSON *json, double cache_mib)
{
    struct place at = {file, "terrain"};
    struct terrain_options options = {0};
    const char *name = cJSON_GetStringValue(json), *builtin = NULL;
    if (!json) return fail("%s: terrain is missing; accepted is a file name or an object", file);
    if (!name) {
        if (!check_object(
                at, json,
                "file|builtin|synthesize_levels|seed|filter|noise|cache_mib|frame_samples|latency_frames") ||
            !read_text_value(at, json, "file", NULL, &name) ||
            !read_text_value(at, json, "builtin", "jacksboro", &builtin) ||
            !read_terrain_options(at, json, builtin ? 8 : 18, &options))
            return false;
        if (!name == !builtin) return fail("%s: terrain needs one of \"file\" and \"builtin\"", file);
    }
    char path[1024];
    if (name && !find_file(file, "terrain", name, path)) return false;
    snprintf(scene->terrain_name, sizeof scene->terrain_name, "%s", name ? base_name(name) : builtin);
    if (cache_mib > 0) options.cache_bytes = (uint64_t)(cache_mib * (1 << 20));
    scene->terrain = name ? terrain_load(path, &options) : terrain_builtin(&options);
    return scene->terrain != NULL;
}

// ---- path ------------------------------------------------------------------

static bool has_keys(const char *file, const char *object, const cJSON *json, const char *const needed[3],
                     const char *unit)
{
    for (int i = 0; i < 3; i++)
        if (!cJSON_GetObjectItemCaseSensitive(json, needed[i]))
            return fail("%s: \"%s\" of %s is missing; %s, %s and %s are needed, in %s", file, needed[i],
                        object, needed[0], needed[1], needed[2], unit);
    return true;
}

// Where a key frame is: x and y in metres, or longitude and latitude in degrees on a sphere.
static bool read_key_place(struct place at, const cJSON *json, const struct terrain_info *info,
                           struct path_key *key)
{
    static const char *const METRES[] = {"x", "y", "height"}, *const DEGREES[] = {"longitude", "latitude",
                                                                                  "height"};
    if (info->datum == TERRAIN_PLANE)
        return has_keys(at.file, at.object, json, METRES, "metres") &&
               read_number(at, json, "x", -1e12, 1e12, &key->x_m) &&
               read_number(at, json, "y", -1e12, 1e12, &key->y_m);
    double longitude = 0, latitude = 0;
    if (!has_keys(at.file, at.object, json, DEGREES, "degrees and metres") ||
        !read_number(at, json, "longitude", -3600, 3600, &longitude) ||
        !read_number(at, json, "latitude", -90, 90, &latitude))
        return false;
    key->x_m = longitude * DEGREE * info->radius_m;
    key->y_m = latitude * DEGREE * info->radius_m;
    return true;
}

static bool read_key(const char *file, const cJSON *json, int index, const struct terrain_info *info,
                     struct path_key *key)
{
    char object[64];
    snprintf(object, sizeof object, "key frame %d of path", index);
    struct place at = {file, object};
    double yaw = 0, pitch = 0, roll = 0;
    bool sphere = info->datum == TERRAIN_SPHERE;
    if (!check_object(at, json,
                      sphere ? "longitude|latitude|height|above_ground|yaw|pitch|roll"
                             : "x|y|height|above_ground|yaw|pitch|roll") ||
        !read_key_place(at, json, info, key) || !read_number(at, json, "height", -1e9, 1e9, &key->height_m) ||
        !read_bool(at, json, "above_ground", &key->above_ground) ||
        !read_number(at, json, "yaw", -36000, 36000, &yaw) ||
        !read_number(at, json, "pitch", -90, 90, &pitch) ||
        !read_number(at, json, "roll", -36000, 36000, &roll))
        return false;
    key->yaw = yaw * DEGREE;
    key->pitch = pitch * DEGREE;
    key->roll = roll * DEGREE;
    return true;
}

static bool load_keys(struct scene *scene, const char *file, const cJSON *json)
{
    struct place at = {file, "path"};
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(json, "keys");
    int frames = DEFAULT_FRAMES, count = cJSON_GetArraySize(list);
    double clearance_m = 2;
    if (!check_object(at, json, "keys|clearance|frames") ||
        !read_number(at, json, "clearance", 0, 1e9, &clearance_m) ||
        !read_int(at, json, "frames", 1, FRAMES_MAX, &frames))
        return false;
    if (!cJSON_IsArray(list) || count == 0)
        return fail("%s: path has no key frames; accepted is a list of at least one {x, y, height}", file);
    if (count > KEYS_MAX) return fail("%s: path has %d key frames; accepted are %d", file, count, KEYS_MAX);
    struct path_key *keys = calloc((size_t)count, sizeof *keys);
    if (!keys) return fail("%s: out of memory", file);
    bool good = true;
    int index = 0;
    for (const cJSON *key = list->child; key && good; key = key->next, index++)
        good = read_key(file, key, index + 1, terrain_info(scene->terrain), &keys[index]);
    if (good)
        scene->path = path_from_keys(scene->terrain, keys, count, frames, clearance_m, scene->fov_vertical);
    free(keys);
    return scene->path != NULL;
}

// Parses one row; false when it is not four finite numbers.
static bool read_pose(const char *line, double row[4])
{
    for (int i = 0; i < 4; i++) {
        char *end;
        row[i] = strtod(line, &end);
        if (end == line || !(fabs(row[i]) <= 1e9)) return false;
        line = end;
    }
    return line[strspn(line, " \t\r")] == '\0';
}

static struct camera camera_from_pose(const struct scene *scene, const double row[4], double pitch)
{
    const double *outline = terrain_info(scene->terrain)->outline_m;
    double width = outline[2] - outline[0];
    return (struct camera){
        .eye_m = {outline[0] + row[0] * width, outline[3] - row[1] * width, row[2] * width},
        .yaw = -row[3],
        .pitch = pitch,
        .fov_vertical = scene->fov_vertical};
}

// Splits the text at its line ends and keeps every `every`-th row.
static bool read_poses(struct scene *scene, const char *path, char *text, int every, double pitch)
{
    size_t lines = 1, kept = 0, rows = 0, number = 0;
    for (const char *c = text; *c; c++) lines += *c == '\n';
    struct camera *cameras = calloc(lines, sizeof *cameras);
    if (!cameras) return fail("%s: out of memory", path);
    bool good = true;
    for (char *line = text, *next; line && good; line = next) {
        next = strchr(line, '\n');
        if (next) *next++ = '\0';
        number++;
        const char *start = line + strspn(line, " \t\r");
        double row[4];
        if (*start == '\0' || *start == '#') continue;
        if (!read_pose(start, row))
            good = fail("%s: line %zu is not a pose; accepted are four numbers u v z yaw", path, number);
        else if (rows++ % (size_t)every == 0)
            cameras[kept++] = camera_from_pose(scene, row, pitch);
    }
    if (good && kept == 0) good = fail("%s: path has no key frames; accepted are rows u v z yaw", path);
    if (good && kept > FRAMES_MAX)
        good = fail("%s: %zu rows are kept; accepted are %d", path, kept, FRAMES_MAX);
    if (good) scene->path = path_from_cameras(cameras, (int)kept);
    free(cameras);
    return scene->path != NULL;
}

static bool load_poses(struct scene *scene, const char *file, const cJSON *json)
{
    struct place at = {file, "path"};
    const char *name = NULL;
    double pitch = 0;
    int every = 1;
    char path[1024];
    if (terrain_info(scene->terrain)->datum == TERRAIN_SPHERE)
        return fail(
            "%s: path is a file of poses, which are of a plane; accepted on a sphere are \"keys\" and "
            "\"auto\"",
            file);
    if (!check_object(at, json, "poses|every|pitch") || !read_text_value(at, json, "poses", NULL, &name) ||
        !read_int(at, json, "every", 1, FRAMES_MAX, &every) ||
        !read_number(at, json, "pitch", -90, 90, &pitch) || !find_file(file, "path", name, path))
        return false;
    size_t size;
    char *text = read_text(path, &size);
    bool good = text && read_poses(scene, path, text, every, pitch * DEGREE);
    free(text);
    return good;
}

static bool load_path(struct scene *scene, const char *file, const cJSON *json)
{
    int frames = DEFAULT_FRAMES;
    bool made = true;
    const char *word = cJSON_GetStringValue(json);
    if (word && strcmp(word, "auto") != 0)
        return fail("%s: path \"%s\" is not known; accepted is \"auto\" or an object", file, word);
    if (json && !word) {
        struct place at = {file, "path"};
        if (!check_object(at, json, "keys|clearance|frames|poses|every|pitch|auto")) return false;
        if (cJSON_HasObjectItem(json, "keys")) return load_keys(scene, file, json);
        if (cJSON_HasObjectItem(json, "poses")) return load_poses(scene, file, json);
        if (!cJSON_HasObjectItem(json, "auto"))
            return fail("%s: path has no key frames; accepted is one of \"keys\", \"poses\" and \"auto\"",
                        file);
        if (!check_object(at, json, "auto|frames") || !read_bool(at, json, "auto", &made) ||
            !read_int(at, json, "frames", 1, FRAMES_MAX, &frames))
            return false;
        if (!made) return fail("%s: \"auto\" of path is false; accepted is true", file);
    }
    scene->path = path_for_terrain(scene->terrain, frames, scene->fov_vertical);
    return scene->path != NULL;
}

// ---- the scene -------------------------------------------------------------

// Names become folders, so they are plain.
static bool read_name(struct scene *scene, const char *file, const cJSON *json)
{
    const char *name = cJSON_GetStringValue(json);
    const char *plain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_.";
    size_t length = name ? strlen(name) : 0;
    if (length == 0 || length >= sizeof scene->name || *name == '.' || strspn(name, plain) != length)
        return fail("%s: name is missing or not right; accepted are 1..%zu letters, digits, - _ .", file,
                    sizeof scene->name - 1);
    memcpy(scene->name, name, length + 1);
    return true;
}

static void name_after_file(struct scene *scene, const char *terrain_file)
{
    const char *base = base_name(terrain_file), *dot = strrchr(base, '.');
    size_t length = dot && dot > base ? (size_t)(dot - base) : strlen(base);
    snprintf(scene->name, sizeof scene->name, "%.*s", (int)length, base);
    for (char *c = scene->name; *c; c++)
        if (!strchr("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_", *c)) *c = '-';
}

static bool read_view(struct scene *scene, const char *file, const cJSON *json)
{
    struct place at = {file, "view"};
    double fov_vertical = 60;
    scene->width = 640;
    scene->height = 480;
    bool good = !json || (check_object(at, json, "width|height|fov_vertical|near") &&
                          read_int(at, json, "width", 1, SIDE_MAX, &scene->width) &&
                          read_int(at, json, "height", 1, SIDE_MAX, &scene->height) &&
                          read_number(at, json, "fov_vertical", 1, 170, &fov_vertical) &&
                          read_number(at, json, "near", 1e-6, 1e9, &scene->near_m));
    scene->fov_vertical = fov_vertical * DEGREE;
    return good;
}

static bool read_colour(struct scene_colour *colour)
{
    if (!image_read_rgba8(colour->path, &colour->width, &colour->height, &colour->pixels)) return false;
    sha256_hex(colour->pixels, (size_t)colour->width * (size_t)colour->height * 4, colour->sha256);
    return true;
}

static bool load_colour(struct scene *scene, const char *file, const char *name)
{
    struct scene_colour *colour = calloc(1, sizeof *colour);
    if (!colour) return fail("%s: out of memory", file);
    scene->effects.colour = colour;
    snprintf(colour->name, sizeof colour->name, "%s", base_name(name));
    return find_file(file, "colour", name, colour->path) && read_colour(colour);
}

bool scene_colour_hold(struct scene_colour *colour)
{
    struct scene_colour again = *colour;
    if (!colour->pixels && !read_colour(&again)) return false;
    if (strcmp(again.sha256, colour->sha256) != 0 || again.width != colour->width) {
        free(again.pixels);
        return fail("%s: is another image than when the scene was read", colour->path);
    }
    colour->pixels = again.pixels;
    colour->holders++;
    return true;
}

void scene_colour_release(struct scene_colour *colour)
{
    if (!colour || --colour->holders > 0 || !*colour->path) return;
    free(colour->pixels);
    colour->pixels = NULL;
}

// What the words mean is for those to say who know the renderers.
static bool read_renderers(struct scene *scene, const char *file, const cJSON *json)
{
    struct place at = {file, "the scene"};
    const char *words = "";
    if (!read_text_value(at, json, "renderers", NULL, &words)) return false;
    if (strlen(words) >= sizeof scene->renderers)
        return fail("%s: \"renderers\" has %zu characters; accepted are %zu", file, strlen(words),
                    sizeof scene->renderers - 1);
    memcpy(scene->renderers, words, strlen(words) + 1);
    return true;
}

// A colour image suits the scene's own terrain: it is left out when another is flown.
static bool read_effects(struct scene *scene, const char *file, const cJSON *json, bool own_terrain)
{
    struct place at = {file, "effects"};
    const char *shading = "common", *colour = NULL;
    if (json && (!check_object(at, json, "shading|colour") ||
                 !read_text_value(at, json, "shading", "common|own", &shading) ||
                 !read_text_value(at, json, "colour", NULL, &colour)))
        return false;
    scene->effects.shading = *shading == 'o' ? SCENE_SHADING_OWN : SCENE_SHADING_COMMON;
    return !colour || !own_terrain || load_colour(scene, file, colour);
}

static bool build(struct scene *scene, const char *file, const cJSON *json,
                  const struct scene_request *request)
{
    const char *terrain_file = request->terrain_file;
    struct place at = {file, "the scene"};
    if (!check_object(at, json, "name|terrain|path|view|renderers|effects") ||
        !read_name(scene, file, cJSON_GetObjectItemCaseSensitive(json, "name")) ||
        !read_view(scene, file, cJSON_GetObjectItemCaseSensitive(json, "view")) ||
        !read_renderers(scene, file, json) ||
        !read_effects(scene, file, cJSON_GetObjectItemCaseSensitive(json, "effects"), !terrain_file))
        return false;
    if (!terrain_file)
        return load_terrain(scene, file, cJSON_GetObjectItemCaseSensitive(json, "terrain"),
                            request->cache_mib) &&
               load_path(scene, file, cJSON_GetObjectItemCaseSensitive(json, "path"));
    scene->near_m = 0; // it suited the terrain that is not used
    name_after_file(scene, terrain_file);
    snprintf(scene->terrain_name, sizeof scene->terrain_name, "%s", base_name(terrain_file));
    struct terrain_options options = {.cache_bytes = (uint64_t)(request->cache_mib * (1 << 20))};
    scene->terrain = terrain_load(terrain_file, &options);
    return scene->terrain && load_path(scene, file, NULL);
}

static struct scene *scene_from_text(const char *file, const char *text, size_t size,
                                     const struct scene_request *request)
{
    struct scene *scene = calloc(1, sizeof *scene);
    if (!scene) return fail("%s: out of memory", file), NULL;
    sha256_hex(text, size, scene->sha256);
    cJSON *json = parse(file, text, size);
    bool good = json && build(scene, file, json, request);
    cJSON_Delete(json);
    if (good) return scene;
    scene_destroy(scene);
    return NULL;
}

static struct scene *scene_from_program(const struct scene_request *request)
{
    const struct embedded_file *carried = embedded_find(DEFAULT_SCENE);
    if (!carried) return fail("%s: this program carries no default scene", DEFAULT_SCENE), NULL;
    size_t size = (size_t)(carried->end - carried->data);
    char *text = calloc(size + 1, 1);
    if (!text) return fail("%s: out of memory", DEFAULT_SCENE), NULL;
    memcpy(text, carried->data, size);
    struct scene *scene = scene_from_text(DEFAULT_SCENE, text, size, request);
    free(text);
    return scene;
}

struct scene *scene_open(const struct scene_request *request)
{
    const char *scene_file = request->scene_file;
    struct scene *scene = NULL;
    if (scene_file) {
        size_t size;
        char *text = read_text(scene_file, &size);
        if (text) scene = scene_from_text(scene_file, text, size, request);
        free(text);
    } else {
        scene = scene_from_program(request);
    }
    if (scene && request->width > 0) scene->width = request->width;
    if (scene && request->height > 0) scene->height = request->height;
    return scene;
}

struct scene *scene_load(const char *scene_file, const char *terrain_file, int width, int height)
{
    return scene_open(&(struct scene_request){scene_file, terrain_file, width, height, 0});
}

void scene_destroy(struct scene *scene)
{
    if (!scene) return;
    path_destroy(scene->path);
    terrain_destroy(scene->terrain);
    if (scene->effects.colour) free(scene->effects.colour->pixels);
    free(scene->effects.colour);
    free(scene);
}

struct scene_effects scene_effects_common(const struct scene_effects *effects)
{
    struct scene_effects common = *effects;
    common.shading = SCENE_SHADING_COMMON;
    return common;
}

const char *scene_shading_word(enum scene_shading shading)
{
    return shading == SCENE_SHADING_OWN ? "own" : "common";
}

void scene_view(const struct scene *scene, int frame, int frames, struct view *view)
{
    struct camera camera = path_camera(scene->path, frame, frames);
    view_init(view, scene->terrain, &camera, scene->width, scene->height, scene->near_m);
}
