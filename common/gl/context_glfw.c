// SPDX-License-Identifier: MIT
#include "common/gl/context.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <stdio.h>

static bool give_up(char reason[CONTEXT_REASON])
{
    const char *text = NULL;
    glfwGetError(&text);
    snprintf(reason, CONTEXT_REASON, "%s", text ? text : "no window");
    glfwTerminate();
    return false;
}

static bool open_glfw(struct gpu *gpu, int width, int height, const char *title, char reason[CONTEXT_REASON])
{
    if (!glfwInit()) return give_up(reason);
    glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
    glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
    glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
    glfwWindowHint(GLFW_OPENGL_FORWARD_COMPAT, GLFW_TRUE);
    glfwWindowHint(GLFW_DEPTH_BITS, 0); // the window only receives copies of finished pictures
    glfwWindowHint(GLFW_STENCIL_BITS, 0);
    gpu->window = glfwCreateWindow(width, height, title, NULL, NULL);
    if (!gpu->window) return give_up(reason);
    glfwMakeContextCurrent(gpu->window);
    glfwSwapInterval(0);
    gpu->info.backend = "glfw";
    return true;
}

static void close_glfw(struct gpu *gpu)
{
    glfwDestroyWindow(gpu->window);
    glfwTerminate();
    gpu->window = NULL;
}

const struct context_type context_glfw = {"glfw", open_glfw, close_glfw};
