// SPDX-License-Identifier: MIT
#include "common/gl/context.h"
#include "common/report.h"

// samples 0: one a pixel.
static GLuint attach_buffer(GLenum attachment, GLenum format, int width, int height, int samples)
{
    GLuint buffer;
    glGenRenderbuffers(1, &buffer);
    glBindRenderbuffer(GL_RENDERBUFFER, buffer);
    glRenderbufferStorageMultisample(GL_RENDERBUFFER, samples, format, width, height);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, attachment, GL_RENDERBUFFER, buffer);
    return buffer;
}

bool gpu_target_init(struct gpu *gpu, struct gpu_target *target, int width, int height, GLenum colour_format)
{
    return gpu_target_init_multisampled(gpu, target, width, height, colour_format, 0);
}

bool gpu_target_init_multisampled(struct gpu *gpu, struct gpu_target *target, int width, int height,
                                  GLenum colour_format, int samples)
{
    *target = (struct gpu_target){.width = width, .height = height, .colour_format = colour_format};
    int limit, most_samples;
    glGetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &limit);
    glGetIntegerv(GL_MAX_SAMPLES, &most_samples);
    if (width < 1 || height < 1 || width > limit || height > limit)
        return fail("a picture of %dx%d: %s draws 1x1 to %dx%d", width, height, gpu->info.renderer, limit,
                    limit);
    if (samples > most_samples)
        return fail("a picture of %d samples a pixel: %s draws at most %d", samples, gpu->info.renderer,
                    most_samples);
    glGenFramebuffers(1, &target->framebuffer);
    glBindFramebuffer(GL_FRAMEBUFFER, target->framebuffer);
    if (colour_format)
        target->colour = attach_buffer(GL_COLOR_ATTACHMENT0, colour_format, width, height, samples);
    target->depth = attach_buffer(GL_DEPTH_ATTACHMENT, GL_DEPTH_COMPONENT32F, width, height, samples);
    glDrawBuffer(colour_format ? GL_COLOR_ATTACHMENT0 : GL_NONE);
    glReadBuffer(colour_format ? GL_COLOR_ATTACHMENT0 : GL_NONE);
    GLenum status = glCheckFramebufferStatus(GL_FRAMEBUFFER);
    if (status == GL_FRAMEBUFFER_COMPLETE) return true;
    gpu_target_finish(target);
    return fail("a picture of %dx%d: %s cannot make it (framebuffer status 0x%04x)", width, height,
                gpu->info.renderer, status);
}

void gpu_target_finish(struct gpu_target *target)
{
    if (target->framebuffer) glDeleteFramebuffers(1, &target->framebuffer);
    if (target->colour) glDeleteRenderbuffers(1, &target->colour);
    if (target->depth) glDeleteRenderbuffers(1, &target->depth);
    *target = (struct gpu_target){0};
}

void gpu_target_resolve(struct gpu *gpu, const struct gpu_target *from, const struct gpu_target *to)
{
    (void)gpu;
    glBindFramebuffer(GL_READ_FRAMEBUFFER, from->framebuffer);
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, to->framebuffer);
    glBlitFramebuffer(0, 0, from->width, from->height, 0, 0, to->width, to->height, GL_COLOR_BUFFER_BIT,
                      GL_NEAREST);
}

void gpu_target_begin(struct gpu *gpu, const struct gpu_target *target)
{
    static const float sky[4] = {0.64f, 0.77f, 0.90f, 1.0f}, nothing[4] = {0};
    (void)gpu;
    glBindFramebuffer(GL_FRAMEBUFFER, target->framebuffer);
    glViewport(0, 0, target->width, target->height);
    glDisable(GL_SCISSOR_TEST);
    glDisable(GL_BLEND);
    glDisable(GL_DITHER);
    glDisable(GL_CULL_FACE);
    glFrontFace(GL_CCW);
    glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
    glEnable(GL_DEPTH_TEST);
    // A triangle that is narrower than the sub-pixel grid may cover a centre far outside itself, where its
    // depth runs below 0 and is clamped to what was cleared: it still is ground, not sky.
    glDepthFunc(GL_GEQUAL);
    glDepthMask(GL_TRUE);
    static const float far_away = 0;
    if (target->colour_format)
        glClearBufferfv(GL_COLOR, 0, target->colour_format == GL_RGBA8 ? sky : nothing);
    glClearBufferfv(GL_DEPTH, 0, &far_away);
}

void gpu_target_read(struct gpu *gpu, const struct gpu_target *target, void *pixels)
{
    (void)gpu;
    glBindFramebuffer(GL_READ_FRAMEBUFFER, target->framebuffer);
    glPixelStorei(GL_PACK_ALIGNMENT, 4);
    if (target->colour_format)
        glReadPixels(0, 0, target->width, target->height, GL_RGBA,
                     target->colour_format == GL_RGBA8 ? GL_UNSIGNED_BYTE : GL_FLOAT, pixels);
    else
        gpu_target_read_depth(gpu, target, pixels);
}

void gpu_target_read_depth(struct gpu *gpu, const struct gpu_target *target, float *depth)
{
    (void)gpu;
    glBindFramebuffer(GL_READ_FRAMEBUFFER, target->framebuffer);
    glPixelStorei(GL_PACK_ALIGNMENT, 4);
    glReadPixels(0, 0, target->width, target->height, GL_DEPTH_COMPONENT, GL_FLOAT, depth);
}
