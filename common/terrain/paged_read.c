// SPDX-License-Identifier: MIT
#include "common/parallel.h"
#include "common/report.h"
#include "common/terrain/paged_parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    BLOCK_BYTES = PAGED_BLOCK * PAGED_BLOCK * sizeof(int32_t),
    PAGE_SIDE = TERRAIN_PAGE + 1,
    PAGE_NODES = (4 * TERRAIN_PAGE * TERRAIN_PAGE - 1) / 3, // of all heights
    PAGE_BYTES = (PAGE_SIDE * PAGE_SIDE + PAGE_NODES) * sizeof(int32_t),
    // Blocks that decoding one from the coarser ones may hold on to: four a level.  With fewer they would
    // chase each other out.
    FEWEST_FOR_PARENTS = 128,
    PAGE_ALONE = 3, // levels that a page is decoded from without their blocks
};
#define DEFAULT_CACHE_BYTES ((uint64_t)64 << 20)

static bool no_memory(struct paged *p)
{
    if (!atomic_exchange(&p->failed, true))
        fail("terrain %s: a window does not fit in memory", p->header->name);
    return false;
}

// Samples since are made up, but the same for everyone.
static void made_up(struct paged *p, int32_t *samples, int64_t count)
{
    atomic_store(&p->failed, true);
    memset(samples, 0, (size_t)count * sizeof *samples);
}

// ---- one block -------------------------------------------------------------

static bool read_rect(struct paged *p, int level, const struct rect *wanted, bool units, int32_t *out,
                      int64_t stride);
static bool read_units(struct paged *p, int level, int alone, const struct patch *wanted);

// Internal units of a level of the file.  Those of the coarser level come from its blocks, which are then
// kept; with `alone` levels to go, where these are not there, only what is needed of it is decoded.
static bool decode(struct paged *p, int level, int alone, const struct patch *wanted)
{
    if (!p->keeps_parents || level == p->grid->count - 1) return relief_units(p->relief, level, wanted);
    struct patch coarse = {.rect = relief_coarse_rect(p->relief, level, &wanted->rect)};
    int64_t width = rect_width(&coarse.rect);
    coarse.samples = malloc((size_t)(width * rect_height(&coarse.rect)) * sizeof(int32_t));
    if (!coarse.samples) return no_memory(p);
    bool good = read_units(p, level + 1, alone, &coarse) && relief_refine(p->relief, level, &coarse, wanted);
    free(coarse.samples);
    return good;
}

// Continues a line of samples `stride` apart beyond index `end`, whose neighbour inside is `inner`.
static void continue_line(int32_t *line, int64_t stride, int64_t end, int64_t inner, int64_t from, int64_t to)
{
    int64_t edge = line[end * stride], slope = edge - line[inner * stride];
    for (int64_t i = from; i < to; i++) line[i * stride] = paged_limit(edge + llabs(i - end) * slope);
}

static void continue_ends(int32_t *line, int64_t stride, int64_t first, int64_t last, int64_t count)
{
    continue_line(line, stride, first, first < last ? first + 1 : first, 0, first);
    continue_line(line, stride, last, first < last ? last - 1 : last, last + 1, count);
}

// A window of a level at most as fine as 0, its samples beyond the map continued by straight lines: what U
// reads.
static void read_continued(struct paged *p, int level, int64_t x0, int64_t y0, int width, int height,
                           int32_t *out)
{
    const int64_t *size = paged_map(p, level)->size;
    int64_t first[2] = {larger(-x0, 0), larger(-y0, 0)};
    int64_t last[2] = {smaller(size[0] - 1 - x0, width - 1), smaller(size[1] - 1 - y0, height - 1)};
    paged_window(p, level, x0, y0, width, height, out, TERRAIN_WAIT);
    for (int64_t x = first[0]; x <= last[0]; x++) continue_ends(out + x, width, first[1], last[1], height);
    for (int64_t y = 0; y < height; y++) continue_ends(out + y * width, 1, first[0], last[0], width);
}

// Quanta of a level of its own: U of the coarser one and noise.
static bool synthesise(struct paged *p, int level, const struct patch *wanted)
{
    const struct rect *r = &wanted->rect;
    int width = (int)rect_width(r), height = (int)rect_height(r);
    int columns = upsample_coarse_size(r->x0, width), rows = upsample_coarse_size(r->y0, height);
    int32_t *coarse = malloc((size_t)columns * (size_t)rows * sizeof *coarse);
    if (!coarse) return no_memory(p);
    read_continued(p, level + 1, (r->x0 >> 1) - 1, (r->y0 >> 1) - 1, columns, rows, coarse);
    upsample(coarse, r->x0, r->y0, width, height, wanted->samples);
    free(coarse);
    double sigma_q = paged_map(p, level)->sigma_q;
    for (int y = 0; y < height; y++) {
        int32_t *row = wanted->samples + (int64_t)y * width;
        if (sigma_q > 0 && p->options.noise == TERRAIN_NOISE_TABLE)
            synthesis_add_table_row(row, width, r->x0, r->y0 + y, &p->table, sigma_q);
        else if (sigma_q > 0)
            synthesis_add_row(row, width, r->x0, r->y0 + y, level, p->options.seed, sigma_q);
        for (int x = 0; x < width; x++) row[x] = paged_limit(row[x]);
    }
    return true;
}

static void fill(struct paged *p, int level, const struct patch *wanted)
{
    bool good =
        !atomic_load(&p->failed) && (level < 0 ? synthesise(p, level, wanted) : decode(p, level, 0, wanted));
    if (!good) made_up(p, wanted->samples, rect_width(&wanted->rect) * rect_height(&wanted->rect));
}

static struct rect block_rect(const struct paged *p, struct slot_key key)
{
    const int64_t *stored = paged_map(p, key.level)->stored;
    return (struct rect){key.x * PAGED_BLOCK, key.y * PAGED_BLOCK,
                         smaller((key.x + 1) * PAGED_BLOCK, stored[0]),
                         smaller((key.y + 1) * PAGED_BLOCK, stored[1])};
}

// Pinned; NULL: there is no room for it.
static struct slot *take_block(struct paged *p, struct slot_key key)
{
    bool mine;
    struct slot *slot = slots_take(&p->blocks, key, &mine);
    if (slot && mine) {
        fill(p, key.level, &(struct patch){block_rect(p, key), slot->data});
        slots_filled(&p->blocks, slot);
    }
    return slot;
}

// ---- rectangles of stored samples ------------------------------------------

static void to_quanta(const struct paged *p, int32_t *samples, int64_t count)
{
    relief_quanta(p->relief, samples, count);
    if (p->bits)
        for (int64_t i = 0; i < count; i++) samples[i] = paged_limit((int64_t)samples[i] * (1 << p->bits));
}

// Copies what of a patch lies in `wanted`, whose first sample is *out.
static void copy_patch(const struct patch *from, const struct rect *wanted, int32_t *out, int64_t stride,
                       const struct paged *quanta)
{
    const struct rect *r = &from->rect;
    int64_t x0 = larger(r->x0, wanted->x0), x1 = smaller(r->x1, wanted->x1);
    for (int64_t y = larger(r->y0, wanted->y0); y < smaller(r->y1, wanted->y1); y++) {
        int32_t *to = out + (y - wanted->y0) * stride + (x0 - wanted->x0);
        memcpy(to, patch_at(from, x0, y), (size_t)(x1 - x0) * sizeof *to);
        if (quanta) to_quanta(quanta, to, x1 - x0);
    }
}

// Without a block to keep it in.
static bool read_alone(struct paged *p, struct slot_key key, const struct rect *wanted, int32_t *out,
                       int64_t stride, const struct paged *quanta)
{
    struct rect block = block_rect(p, key);
    struct patch part = {{larger(block.x0, wanted->x0), larger(block.y0, wanted->y0),
                          smaller(block.x1, wanted->x1), smaller(block.y1, wanted->y1)},
                         NULL};
    part.samples = malloc((size_t)(rect_width(&part.rect) * rect_height(&part.rect)) * sizeof *part.samples);
    if (!part.samples) return no_memory(p);
    fill(p, key.level, &part);
    copy_patch(&part, wanted, out, stride, quanta);
    free(part.samples);
    return true;
}

// A rectangle of stored samples, block by block; `units`: a level of the file in internal units.
static bool read_rect(struct paged *p, int level, const struct rect *wanted, bool units, int32_t *out,
                      int64_t stride)
{
    const struct paged *quanta = units || level < 0 ? NULL : p;
    struct slot_key key = {.level = level};
    for (key.y = wanted->y0 / PAGED_BLOCK; key.y * PAGED_BLOCK < wanted->y1; key.y++)
        for (key.x = wanted->x0 / PAGED_BLOCK; key.x * PAGED_BLOCK < wanted->x1; key.x++) {
            struct slot *slot = take_block(p, key);
            if (!slot) {
                if (!read_alone(p, key, wanted, out, stride, quanta)) return false;
                continue;
            }
            copy_patch(&(struct patch){block_rect(p, key), slot->data}, wanted, out, stride, quanta);
            slots_release(&p->blocks, slot);
        }
    return true;
}

static bool holds_rect(struct paged *p, int level, const struct rect *r)
{
    struct slot_key key = {.level = level};
    for (key.y = r->y0 / PAGED_BLOCK; key.y * PAGED_BLOCK < r->y1; key.y++)
        for (key.x = r->x0 / PAGED_BLOCK; key.x * PAGED_BLOCK < r->x1; key.x++)
            if (!paged_holds(p, key)) return false;
    return true;
}

static bool read_units(struct paged *p, int level, int alone, const struct patch *wanted)
{
    if (alone > 0 && !holds_rect(p, level, &wanted->rect)) return decode(p, level, alone - 1, wanted);
    return read_rect(p, level, &wanted->rect, true, wanted->samples, rect_width(&wanted->rect));
}

// ---- windows ---------------------------------------------------------------

static bool lies_in(const struct rect *r, const int64_t size[2])
{
    return r->x0 >= 0 && r->y0 >= 0 && r->x1 <= size[0] && r->y1 <= size[1];
}

enum { PIECE = 32 }; // samples a side of a piece of a window that reaches beyond what is stored

struct piece { // stored samples around a piece
    struct rect rect;
    int32_t samples[(PIECE + 2) * (PIECE + 2)];
};

static int64_t stored_at(const struct piece *piece, int64_t x, int64_t y)
{
    return piece->samples[(y - piece->rect.y0) * rect_width(&piece->rect) + (x - piece->rect.x0)];
}

// Along one row, one beyond the last stored sample: on along the line through the last two.
static int64_t along_row(const struct piece *piece, const int64_t stored[2], int64_t x, int64_t y)
{
    if (x < stored[0]) return stored_at(piece, x, y);
    int64_t a = stored_at(piece, stored[0] - 1, y);
    return stored[0] > 1 ? paged_limit(2 * a - stored_at(piece, stored[0] - 2, y)) : a;
}

static int32_t sample_at(const struct piece *piece, const struct paged_map *map, int64_t x, int64_t y)
{
    const int64_t *stored = map->stored;
    x = clamp(x, 0, map->size[0] - 1);
    y = clamp(y, 0, map->size[1] - 1);
    if (y < stored[1]) return (int32_t)along_row(piece, stored, x, y);
    int64_t a = along_row(piece, stored, x, stored[1] - 1);
    return stored[1] > 1 ? paged_limit(2 * a - along_row(piece, stored, x, stored[1] - 2)) : (int32_t)a;
}

// Stored indices that `count` samples from `first` follow from.
static void needed(int64_t first, int64_t count, int64_t stored, int64_t size, int64_t *from, int64_t *to)
{
    int64_t a = clamp(first, 0, size - 1), b = clamp(first + count - 1, 0, size - 1);
    *from = larger(smaller(a, b >= stored ? stored - 2 : a), 0);
    if (*from >= stored) *from = stored - 1;
    *to = smaller(b, stored - 1) + 1;
}

static bool read_piece(struct paged *p, int level, const struct rect *wanted, int32_t *out, int64_t stride)
{
    const struct paged_map *map = paged_map(p, level);
    struct piece piece;
    if (lies_in(wanted, map->stored)) return read_rect(p, level, wanted, false, out, stride);
    needed(wanted->x0, rect_width(wanted), map->stored[0], map->size[0], &piece.rect.x0, &piece.rect.x1);
    needed(wanted->y0, rect_height(wanted), map->stored[1], map->size[1], &piece.rect.y0, &piece.rect.y1);
    if (!read_rect(p, level, &piece.rect, false, piece.samples, rect_width(&piece.rect))) return false;
    for (int64_t y = wanted->y0; y < wanted->y1; y++)
        for (int64_t x = wanted->x0; x < wanted->x1; x++)
            out[(y - wanted->y0) * stride + (x - wanted->x0)] = sample_at(&piece, map, x, y);
    return true;
}

static struct rect window_rect(int64_t x0, int64_t y0, int width, int height)
{
    const int64_t far = (int64_t)1 << 60; // beyond any level; keeps sums from overflowing
    x0 = clamp(x0, -far, far);
    y0 = clamp(y0, -far, far);
    return (struct rect){x0, y0, x0 + width, y0 + height};
}

bool paged_rect(struct paged *p, int level, const struct rect *r, int32_t *out, int64_t stride)
{
    return read_rect(p, level, r, false, out, stride);
}

void paged_rect_and_parents(struct paged *p, int level, const struct patch *wanted,
                            const struct patch *parents)
{
    struct rect needed = relief_coarse_rect(p->relief, level, &wanted->rect);
    struct patch coarse = {.rect = rect_hull(&needed, &parents->rect)};
    coarse.samples =
        malloc((size_t)(rect_width(&coarse.rect) * rect_height(&coarse.rect)) * sizeof *coarse.samples);
    bool good = coarse.samples || no_memory(p);
    good = good && !atomic_load(&p->failed) && relief_units(p->relief, level + 1, &coarse) &&
           relief_refine(p->relief, level, &coarse, wanted);
    int64_t count = rect_width(&wanted->rect) * rect_height(&wanted->rect);
    if (good) {
        to_quanta(p, wanted->samples, count);
        copy_patch(&coarse, &parents->rect, parents->samples, rect_width(&parents->rect), p);
    } else {
        made_up(p, wanted->samples, count);
        made_up(p, parents->samples, rect_width(&parents->rect) * rect_height(&parents->rect));
    }
    free(coarse.samples);
}

static bool read_window(struct paged *p, int level, const struct rect *r, int32_t *out)
{
    if (lies_in(r, paged_map(p, level)->stored)) return read_rect(p, level, r, false, out, rect_width(r));
    bool good = true;
    for (int64_t y = r->y0; y < r->y1; y += PIECE)
        for (int64_t x = r->x0; x < r->x1; x += PIECE) {
            struct rect piece = {x, y, smaller(x + PIECE, r->x1), smaller(y + PIECE, r->y1)};
            good = good && read_piece(p, level, &piece, out + (y - r->y0) * rect_width(r) + (x - r->x0),
                                      rect_width(r));
        }
    return good;
}

struct terrain_extent paged_blocks(const struct paged *paged, int level, int64_t x0, int64_t y0, int width,
                                   int height)
{
    const struct paged_map *map = paged_map(paged, level);
    struct rect r = window_rect(x0, y0, width, height), n;
    needed(r.x0, width, map->stored[0], map->size[0], &n.x0, &n.x1);
    needed(r.y0, height, map->stored[1], map->size[1], &n.y0, &n.y1);
    return (struct terrain_extent){n.x0 / PAGED_BLOCK, n.y0 / PAGED_BLOCK, (n.x1 - 1) / PAGED_BLOCK + 1,
                                   (n.y1 - 1) / PAGED_BLOCK + 1};
}

bool paged_ask(struct paged *p, int level, const struct rect *r)
{
    struct terrain_extent blocks =
        paged_blocks(p, level, r->x0, r->y0, (int)rect_width(r), (int)rect_height(r));
    bool there = true;
    for (int64_t y = blocks.y0; y < blocks.y1; y++)
        for (int64_t x = blocks.x0; x < blocks.x1; x++) {
            struct slot_key key = {x, y, level};
            if (paged_holds(p, key)) continue;
            if (paged_request(p, key)) there = false; // without workers it is read at once
        }
    return there;
}

bool paged_window(struct paged *p, int level, int64_t x0, int64_t y0, int width, int height, int32_t *out,
                  enum terrain_wait wait)
{
    struct rect r = window_rect(x0, y0, width, height);
    if (width < 1 || height < 1) return true;
    if (wait == TERRAIN_TRY && !paged_ask(p, level, &r)) return false;
    if (!out) return true;
    if (!read_window(p, level, &r, out)) made_up(p, out, (int64_t)width * height);
    return true;
}

// ---- pages -----------------------------------------------------------------

// Quanta that the finest level may rise above a page of this one.
static int64_t page_error_q(const struct paged *p, int level, int64_t x, int64_t y)
{
    if (level == p->finest) return 0;
    double error_m = paged_error(p, level, x * TERRAIN_PAGE, y * TERRAIN_PAGE, (x + 1) * TERRAIN_PAGE,
                                 (y + 1) * TERRAIN_PAGE);
    return (int64_t)ceil(error_m / ldexp(p->header->quantum_m, -p->bits) * (1 + 1e-12));
}

// Far from each other, as the ends of rays are, blocks would be decoded for a page each.
static void read_page_samples(struct paged *p, int level, int64_t x0, int64_t y0, int32_t *samples)
{
    struct patch page = {{x0, y0, x0 + PAGE_SIDE, y0 + PAGE_SIDE}, samples};
    if (level < 0 || !p->keeps_parents || !lies_in(&page.rect, paged_map(p, level)->stored)) {
        paged_window(p, level, x0, y0, PAGE_SIDE, PAGE_SIDE, samples, TERRAIN_WAIT);
        return;
    }
    if (atomic_load(&p->failed) || !read_units(p, level, PAGE_ALONE, &page))
        made_up(p, samples, PAGE_SIDE * PAGE_SIDE);
    else
        to_quanta(p, samples, PAGE_SIDE * PAGE_SIDE);
}

static void read_page(struct paged *p, int level, int64_t x, int64_t y, int32_t *samples)
{
    int64_t error_q = page_error_q(p, level, x, y);
    read_page_samples(p, level, x * TERRAIN_PAGE, y * TERRAIN_PAGE, samples);
    int32_t *max_q = samples + PAGE_SIDE * PAGE_SIDE;
    for (int j = 0; j < TERRAIN_PAGE; j++)
        for (int i = 0; i < TERRAIN_PAGE; i++) {
            const int32_t *s = samples + j * PAGE_SIDE + i;
            int64_t most = larger(larger(s[0], s[1]), larger(s[PAGE_SIDE], s[PAGE_SIDE + 1]));
            max_q[j * TERRAIN_PAGE + i] = paged_limit(most + error_q);
        }
    for (int side = TERRAIN_PAGE / 2; side > 0; side /= 2) {
        const int32_t *below = max_q;
        max_q += 4 * side * side;
        for (int j = 0; j < side; j++)
            for (int i = 0; i < side; i++) {
                const int32_t *b = below + 4 * j * side + 2 * i;
                max_q[j * side + i] =
                    (int32_t)larger(larger(b[0], b[1]), larger(b[2 * side], b[2 * side + 1]));
            }
    }
}

static void point_into(struct terrain_page *page, const int32_t *samples)
{
    page->samples = samples;
    samples += PAGE_SIDE * PAGE_SIDE;
    for (int k = 0; k <= TERRAIN_PAGE_HEIGHT; k++) {
        page->max_q[k] = samples;
        samples += (TERRAIN_PAGE >> k) * (TERRAIN_PAGE >> k);
    }
}

void paged_page(struct paged *p, int level, int64_t x, int64_t y, struct terrain_page *page)
{
    if (page->slot) slots_release(&p->pages, page->slot);
    bool mine;
    struct slot *slot = slots_take(&p->pages, (struct slot_key){x, y, level}, &mine);
    page->slot = slot;
    page->level = level, page->x = x, page->y = y;
    if (!slot && !page->own) page->own = malloc(PAGE_BYTES);
    int32_t *samples = slot ? slot->data : page->own;
    if (!samples) { // no memory for a single page: the map ends here
        static const int32_t NOTHING[PAGE_BYTES / sizeof(int32_t)];
        no_memory(p);
        point_into(page, NOTHING);
        return;
    }
    if (!slot || mine) read_page(p, level, x, y, samples);
    if (mine) slots_filled(&p->pages, slot);
    point_into(page, samples);
}

void paged_page_release(struct paged *p, struct terrain_page *page)
{
    if (page->slot) slots_release(&p->pages, page->slot);
    free(page->own);
    *page = (struct terrain_page){0};
}

// ---- workers ---------------------------------------------------------------

static void *work(void *user)
{
    struct paged *p = user;
    struct paged_workers *w = &p->workers;
    pthread_mutex_lock(&w->lock);
    for (;;) {
        while (w->count == 0 && !w->stop) pthread_cond_wait(&w->asked, &w->lock);
        if (w->stop) break;
        struct slot_key key = w->queue[w->first];
        w->first = (w->first + 1) % PAGED_REQUESTS;
        w->count--;
        pthread_mutex_unlock(&w->lock);
        struct slot *slot = take_block(p, key);
        if (slot) slots_release(&p->blocks, slot);
        pthread_mutex_lock(&w->lock);
    }
    pthread_mutex_unlock(&w->lock);
    return NULL;
}

bool paged_request(struct paged *p, struct slot_key key)
{
    struct paged_workers *w = &p->workers;
    pthread_mutex_lock(&w->lock);
    while (w->started < w->wanted)
        if (pthread_create(&w->threads[w->started], NULL, work, p) == 0)
            w->started++;
        else
            w->wanted = w->started; // fewer threads, same result
    bool begun = w->started > 0;
    if (w->count < PAGED_REQUESTS) w->queue[(w->first + w->count++) % PAGED_REQUESTS] = key;
    pthread_cond_signal(&w->asked);
    pthread_mutex_unlock(&w->lock);
    return begun;
}

void paged_forget_requests(struct paged *p)
{
    pthread_mutex_lock(&p->workers.lock);
    p->workers.count = 0;
    pthread_mutex_unlock(&p->workers.lock);
}

bool paged_holds(struct paged *p, struct slot_key key)
{
    return slots_hold(&p->blocks, key);
}

bool paged_read_init(struct paged *p)
{
    uint64_t bytes = p->options.cache_bytes ? p->options.cache_bytes : DEFAULT_CACHE_BYTES;
    int64_t blocks = smaller((int64_t)(bytes / 4 * 3 / BLOCK_BYTES), INT32_MAX / 4);
    int64_t pages = smaller((int64_t)(bytes / 4 / PAGE_BYTES), INT32_MAX / 4);
    int workers = p->options.workers > 0 ? p->options.workers : parallel_processors() - 1;
    p->workers.wanted = (int)clamp(workers, 1, PAGED_MAX_WORKERS);
    p->ready = true;
    p->keeps_parents = blocks >= FEWEST_FOR_PARENTS;
    pthread_mutex_init(&p->workers.lock, NULL);
    pthread_cond_init(&p->workers.asked, NULL);
    return slots_init(&p->blocks, BLOCK_BYTES, (int32_t)blocks) &&
           slots_init(&p->pages, PAGE_BYTES, (int32_t)pages);
}

void paged_read_finish(struct paged *p)
{
    struct paged_workers *w = &p->workers;
    if (!p->ready) return;
    pthread_mutex_lock(&w->lock);
    w->stop = true;
    pthread_cond_broadcast(&w->asked);
    pthread_mutex_unlock(&w->lock);
    for (int i = 0; i < w->started; i++) pthread_join(w->threads[i], NULL);
    pthread_mutex_destroy(&w->lock);
    pthread_cond_destroy(&w->asked);
    slots_finish(&p->blocks);
    slots_finish(&p->pages);
}
