// A scene: which terrain, which path, which view, and the effects it calls for; nothing else is simulated.
// A scene is JSON with strict keys:
//
//   { "name": "puget",
//     "terrain": "puget_1k_160m.png"            a file; sought beside the scene, in data/, in $RELIEF_DATA
//              | { "file": "x.png" | "builtin": "jacksboro",
//                  "synthesize_levels": 3, "seed": 1, "filter": "linear|halfband|tent|decimate|optimal",
//                  "noise": "hash|table",
//                  "cache_mib": 64,             of a .relief file, which stays on disk: ceiling of what is
//                                               kept decoded, MiB
//                  "frame_samples": 524288,     ... samples that arrive a frame at most; -1: they are
//                                               waited for
//                  "latency_frames": 2 },       ... frames from asking to arrival
//     "path":  "auto"                           made to suit the terrain
//            | { "auto": true, "frames": 96 }
//            | { "keys": [ { "x": m, "y": m, "height": m, "above_ground": true,
//                            "yaw": deg, "pitch": deg, "roll": deg } ],
//                "clearance": m, "frames": 96 }
//                        on a sphere "longitude" and "latitude", in degrees, instead of x and y
//            | { "poses": "file.txt", "every": 5, "pitch": -12 }     rows of u v z yaw (see scene.c)
//     "view":  { "width": 640, "height": 480, "fov_vertical": 60, "near": m (optional) },
//     "renderers": "brute,pgm:law=target"       which renderers at which settings `bench run` flies when not
//     told
//                                               otherwise, in the words of its --renderers; missing: all
//     "effects": { "shading": "common"          the same for all renderers: normals of the drawn triangles
//                           | "own",            the renderer's own normals
//                  "colour": "x.png" } }        a PNG draped over the map from edge to edge, north at its
//                  top;
//                                               sought as the terrain is; missing: colour by height
//
// "name" and "terrain" are required; a missing "path" is "auto", a missing "view" 640 x 480 at 60 degrees.
// synthesize_levels: at most 8, on a sphere 18.  A key frame needs x, y and height; above_ground is false and
// angles are 0 when missing, clearance 2 m, frames 96. SPDX-License-Identifier: MIT
#ifndef COMMON_SCENE_SCENE_H
#define COMMON_SCENE_SCENE_H

#include "common/terrain/terrain.h"
#include "common/view/path.h"

#include <stdbool.h>

enum scene_shading { SCENE_SHADING_COMMON, SCENE_SHADING_OWN };

struct scene_colour { // an image draped over the map's outline
    char name[256];   // of its file
    char path[1024];  // where that stands; empty: the image was made, and its pixels stay
    char sha256[65];  // of its pixels
    int width, height;
    uint8_t *pixels; // RGBA, the north row first; NULL when all who held them have let go
    int holders;
};
// Pixels are there from loading until the first who hold them have let go: what draws with textures of them
// does not need them any more.  Held again, they are read again; false after one line on stderr.  Of the
// thread that draws.
bool scene_colour_hold(struct scene_colour *colour);
void scene_colour_release(struct scene_colour *colour); // once for each hold; accepts NULL

struct scene_effects {
    enum scene_shading shading;
    struct scene_colour *colour; // owned by the scene; NULL: colour by height
};

struct scene {
    char name[64];
    char sha256[65];         // of the scene's text
    char terrain_name[256];  // file name or builtin, for reports
    struct terrain *terrain; // owned
    struct path *path;       // owned
    int width, height;       // pixels
    double fov_vertical;     // radians
    double near_m;           // 0: by height over ground
    struct scene_effects effects;
    char renderers[512]; // empty: all
};

// The effects with shading `common`, for baselines, which have none of their own.
struct scene_effects scene_effects_common(const struct scene_effects *effects);
const char *scene_shading_word(enum scene_shading shading);

// Loads scene_file (NULL: the default scene that the program carries).  terrain_file (may be NULL) replaces
// the scene's terrain, and a path is made to suit it.  width and height > 0 replace the scene's.  NULL after
// one line on stderr.
struct scene *scene_load(const char *scene_file, const char *terrain_file, int width, int height);
// The same with all that a command line may say.
struct scene_request {
    const char *scene_file, *terrain_file;
    int width, height;
    double cache_mib; // > 0 replaces the scene's
};
struct scene *scene_open(const struct scene_request *request);
void scene_destroy(struct scene *scene); // accepts NULL

// View of frame `frame` of `frames`.
void scene_view(const struct scene *scene, int frame, int frames, struct view *view);

// SHA-256 of a block of memory as 64 hexadecimal digits.
void sha256_hex(const void *data, size_t size, char hex[65]);

#endif
