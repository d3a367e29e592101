// SPDX-License-Identifier: MIT
#include "common/viewer_window.h"

#include "common/report.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <math.h>
#include <stdio.h>
#include <unistd.h>

enum { PATH_STEPS = 8192 }; // fine enough for any frame rate
static const double path_seconds = 60, settle_seconds = 0.2, hud_seconds = 0.5, pitch_limit = 1.56;

struct flight {
    struct viewer *viewer;
    GLFWwindow *window;
    struct camera camera;
    bool on_path, vertical_sync;
    double path_time; // seconds into the path
    double speed;     // the wheel's factor
    int quality_step; // asked for by + and -, not yet done
    bool picture_wanted;
    double cursor[2];
    int seen_size[2]; // of the window, and since when it has been that
    double seen_since;
    double hud_begin;
    int hud_frames;
};

// ---- keys and mouse --------------------------------------------------------

static void on_key(GLFWwindow *window, int key, int scancode, int action, int mods)
{
    (void)scancode, (void)mods;
    struct flight *f = glfwGetWindowUserPointer(window);
    if (action != GLFW_PRESS) return;
    if (key == GLFW_KEY_ESCAPE) glfwSetWindowShouldClose(window, GLFW_TRUE);
    if (key == GLFW_KEY_P) f->on_path = !f->on_path;
    if (key == GLFW_KEY_F) f->viewer->wireframe = !f->viewer->wireframe;
    if (key == GLFW_KEY_F12) f->picture_wanted = true;
    if (key == GLFW_KEY_EQUAL || key == GLFW_KEY_KP_ADD) f->quality_step++;
    if (key == GLFW_KEY_MINUS || key == GLFW_KEY_KP_SUBTRACT) f->quality_step--;
    if (key == GLFW_KEY_V) glfwSwapInterval(f->vertical_sync = !f->vertical_sync);
}

static void on_wheel(GLFWwindow *window, double x, double y)
{
    (void)x;
    struct flight *f = glfwGetWindowUserPointer(window);
    f->speed = fmin(fmax(f->speed * pow(1.25, y), 1e-3), 1e3);
}

// Dragging turns the view with the hand: a drag over the window's height turns it by the angle of view.
static void on_cursor(GLFWwindow *window, double x, double y)
{
    struct flight *f = glfwGetWindowUserPointer(window);
    if (glfwGetMouseButton(window, GLFW_MOUSE_BUTTON_LEFT) == GLFW_PRESS) {
        int width, height;
        glfwGetWindowSize(window, &width, &height);
        double turn = f->camera.fov_vertical / (height > 0 ? height : 1);
        f->camera.yaw -= (x - f->cursor[0]) * turn;
        f->camera.pitch -= (y - f->cursor[1]) * turn;
        f->on_path = false;
    }
    f->cursor[0] = x;
    f->cursor[1] = y;
}

static double axis(GLFWwindow *window, int less, int more)
{
    return (glfwGetKey(window, more) == GLFW_PRESS) - (glfwGetKey(window, less) == GLFW_PRESS);
}

// ---- the camera ------------------------------------------------------------

// Height of the ground under a place; beyond the map, its lowest height.
static double ground_under(const struct terrain *terrain, const double place[3])
{
    const struct terrain_info *info = terrain_info(terrain);
    double q;
    if (!terrain_truth_at(terrain, place[0], place[1], &q, NULL)) q = info->min_q;
    return info->offset_m + info->quantum_m * q;
}

// Moves the camera by a step along east, north and up.  On a sphere these turn on the way: where the camera
// looks is kept, and told by the axes where it arrives.
static void step_over(const struct terrain *terrain, struct camera *c, const double step[3])
{
    double world[3], from[3][3], to[3][3], ahead[3] = {cos(c->yaw), sin(c->yaw), 0}, place[3];
    terrain_axes(terrain, c->eye_m, from);
    terrain_world_from_place(terrain, c->eye_m, world);
    for (int k = 0; k < 3; k++)
        world[k] += step[0] * from[0][k] + step[1] * from[1][k] + step[2] * from[2][k];
    terrain_place_from_world(terrain, world, place);
    terrain_axes(terrain, place, to);
    double east = 0, north = 0;
    for (int k = 0; k < 3; k++) {
        double looks = ahead[0] * from[0][k] + ahead[1] * from[1][k];
        east += looks * to[0][k];
        north += looks * to[1][k];
    }
    c->yaw += remainder(atan2(north, east) - c->yaw, 2 * M_PI);
    for (int k = 0; k < 3; k++) c->eye_m[k] = place[k];
}

// Speed follows the height over ground, and the eye never sinks below a man's height over it.
static void move_by_hand(struct flight *f, double seconds)
{
    static const double lowest_m = 2;
    struct camera *c = &f->camera;
    const struct terrain *terrain = f->viewer->scene->terrain;
    double ahead = axis(f->window, GLFW_KEY_S, GLFW_KEY_W);
    double aside = axis(f->window, GLFW_KEY_A, GLFW_KEY_D), rise = axis(f->window, GLFW_KEY_Q, GLFW_KEY_E);
    double left = axis(f->window, GLFW_KEY_RIGHT, GLFW_KEY_LEFT);
    double upward = axis(f->window, GLFW_KEY_DOWN, GLFW_KEY_UP);
    if (ahead != 0 || aside != 0 || rise != 0 || left != 0 || upward != 0) f->on_path = false;
    double metres = f->speed * fmax(20, c->eye_m[2] - ground_under(terrain, c->eye_m)) * seconds;
    bool shift = glfwGetKey(f->window, GLFW_KEY_LEFT_SHIFT) || glfwGetKey(f->window, GLFW_KEY_RIGHT_SHIFT);
    if (shift) metres *= 6;
    c->yaw += left * seconds;
    c->pitch = fmin(fmax(c->pitch + upward * seconds, -pitch_limit), pitch_limit);
    double step[3] = {metres * (ahead * cos(c->pitch) * cos(c->yaw) + aside * sin(c->yaw)),
                      metres * (ahead * cos(c->pitch) * sin(c->yaw) - aside * cos(c->yaw)),
                      metres * (ahead * sin(c->pitch) + rise)};
    step_over(terrain, c, step);
    c->eye_m[2] = fmax(c->eye_m[2], ground_under(terrain, c->eye_m) + lowest_m);
}

static void move(struct flight *f, double seconds)
{
    move_by_hand(f, seconds);
    if (!f->on_path) return;
    f->path_time = fmod(f->path_time + seconds, path_seconds);
    f->camera =
        path_camera(f->viewer->scene->path, (int)(f->path_time / path_seconds * PATH_STEPS), PATH_STEPS);
}

// ---- the window ------------------------------------------------------------

// Follows the window's size once it has come to rest: making a picture and a renderer anew at each step of a
// drag would stall it.
static bool follow_size(struct flight *f, double now)
{
    struct viewer *viewer = f->viewer;
    struct scene *scene = viewer->scene;
    int size[2];
    glfwGetFramebufferSize(f->window, &size[0], &size[1]);
    if (size[0] != f->seen_size[0] || size[1] != f->seen_size[1]) {
        f->seen_size[0] = size[0];
        f->seen_size[1] = size[1];
        f->seen_since = now;
    }
    bool same = size[0] == scene->width && size[1] == scene->height;
    if (same || size[0] < 1 || size[1] < 1 || now - f->seen_since < settle_seconds) return true;
    scene->width = size[0];
    scene->height = size[1];
    gpu_target_finish(&viewer->target);
    if (!gpu_target_init(viewer->gpu, &viewer->target, size[0], size[1], GL_RGBA8)) return false;
    return (size[0] <= viewer->largest[0] && size[1] <= viewer->largest[1]) || viewer_make_renderer(viewer);
}

// Moves the quality knob along its list of values and makes the renderer anew with it.
static bool change_quality(struct flight *f)
{
    struct viewer *viewer = f->viewer;
    const double *values = viewer->type->full;
    int step = f->quality_step, count = 0, nearest = 0;
    f->quality_step = 0;
    if (!viewer->type->quality_knob || !values || step == 0) return true;
    double *knob = &viewer->knobs[renderer_knob_index(viewer->type, viewer->type->quality_knob)];
    for (; !isnan(values[count]); count++)
        if (fabs(values[count] - *knob) < fabs(values[nearest] - *knob)) nearest = count;
    int wanted = nearest + step < 0 ? 0 : nearest + step >= count ? count - 1 : nearest + step;
    if (count == 0 || values[wanted] == *knob) return true;
    *knob = values[wanted];
    return viewer_make_renderer(viewer);
}

// Writes the picture under the first number that is still free; a folder that takes no file is no reason to
// stop flying.
static void take_picture(struct flight *f)
{
    char path[128];
    f->picture_wanted = false;
    for (int number = 1; number < 10000; number++) {
        snprintf(path, sizeof path, "%s-%04d.png", f->viewer->type->name, number);
        if (access(path, F_OK) == 0) continue;
        if (viewer_save(f->viewer, path)) note("%s: written", path);
        return;
    }
}

// Head-up display in the title bar.
static void show_figures(struct flight *f, double now)
{
    const struct viewer *viewer = f->viewer;
    f->hud_frames++;
    double seconds = now - f->hud_begin;
    if (seconds < hud_seconds) return;
    struct renderer_stats stats = {0};
    char title[256], setting[128] = "", claim[64] = "";
    viewer->type->stats(viewer->renderer, &stats);
    int k = viewer->type->quality_knob ? renderer_knob_index(viewer->type, viewer->type->quality_knob) : -1;
    if (k >= 0) {
        char value[64];
        renderer_format_knob(&viewer->type->knobs[k], viewer->knobs[k], value);
        snprintf(setting, sizeof setting, " %s %s", viewer->type->quality_knob, value);
    }
    if (!isnan(stats.claimed_error_px))
        snprintf(claim, sizeof claim, " | claims %.2f px", stats.claimed_error_px);
    snprintf(title, sizeof title, "%s%s | %.1f fps | %.2f ms | %.0f k triangles%s%s", viewer->type->name,
             setting, f->hud_frames / seconds, 1e3 * seconds / f->hud_frames, (double)stats.triangles / 1e3,
             claim, f->on_path ? " | path" : "");
    glfwSetWindowTitle(f->window, title);
    f->hud_begin = now;
    f->hud_frames = 0;
}

static bool fly_frame(struct flight *f, double seconds, double now)
{
    struct viewer *viewer = f->viewer;
    struct view view;
    move(f, seconds);
    if (!follow_size(f, now) || !change_quality(f)) return false;
    view_init(&view, viewer->scene->terrain, &f->camera, viewer->scene->width, viewer->scene->height,
              viewer->scene->near_m);
    if (!viewer_draw(viewer, &view)) return false;
    if (f->picture_wanted) take_picture(f);
    viewer_show(viewer);
    show_figures(f, now);
    return true;
}

bool viewer_fly(struct viewer *viewer)
{
    struct flight f = {
        .viewer = viewer, .window = gpu_window(viewer->gpu), .speed = 1, .vertical_sync = true};
    f.camera = path_camera(viewer->scene->path, 0, PATH_STEPS);
    glfwSetWindowUserPointer(f.window, &f);
    glfwSetKeyCallback(f.window, on_key);
    glfwSetScrollCallback(f.window, on_wheel);
    glfwSetCursorPosCallback(f.window, on_cursor);
    glfwGetCursorPos(f.window, &f.cursor[0], &f.cursor[1]);
    glfwSwapInterval(1);
    double before = glfwGetTime();
    f.hud_begin = before;
    bool good = true;
    while (good && !glfwWindowShouldClose(f.window)) {
        glfwPollEvents();
        double now = glfwGetTime();
        good = fly_frame(&f, fmin(now - before, 0.25), now);
        before = now;
    }
    return good;
}
