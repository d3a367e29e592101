// The LRU manager, case C5 of numerics.md: a model of the buffer holds, for every slot, the tile that was
// last written there.
// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_cache.h"
#include "tests/test.h"

enum { TILES = 500 };

struct model {
    struct geomipmap_cache cache;
    int content[TILES]; // by slot
    int uploads, batches;
    bool used[TILES]; // by slot, in this batch
};

// Names far apart and close together.
static uint64_t name_of(int tile)
{
    return tile % 2 ? (uint64_t)tile << 48 | 5 : (uint64_t)tile;
}

static void start(struct model *m, int limit)
{
    *m = (struct model){.uploads = 0};
    assert_true(geomipmap_cache_init(&m->cache, limit, 0));
}

static void new_batch(struct model *m)
{
    m->batches++;
    for (int i = 0; i < TILES; i++) m->used[i] = false;
}

static void begin(struct model *m)
{
    int from = -1, to = -1, before = m->cache.slot_count;
    bool moved = geomipmap_cache_begin_frame(&m->cache, &from, &to);
    assert_in_range(before - m->cache.slot_count, 0, 1); // shrinks by one at most
    if (moved) {
        assert_int_equal(from, before - 1);
        assert_in_range(to, 0, m->cache.slot_count - 1);
        m->content[to] = m->content[from];
    }
    m->uploads = m->batches = 0;
    new_batch(m);
}

// Asks for a tile as the renderer does; false when the cache has no slot at all.
static bool ask(struct model *m, int tile)
{
    int slot;
    enum geomipmap_found found = geomipmap_cache_find(&m->cache, name_of(tile), &slot);
    if (found == GEOMIPMAP_FULL) {
        if (m->cache.slot_count == 0) return false;
        geomipmap_cache_begin_batch(&m->cache);
        new_batch(m);
        found = geomipmap_cache_find(&m->cache, name_of(tile), &slot);
        assert_int_not_equal(found, GEOMIPMAP_FULL);
    }
    assert_in_range(slot, 0, m->cache.slot_count - 1);
    if (found == GEOMIPMAP_MISS) {
        assert_false(m->used[slot]); // never a slot that this batch has drawn from
        m->content[slot] = tile;
        m->uploads++;
    }
    m->used[slot] = true;
    assert_int_equal(m->content[slot], tile); // what is drawn is always the tile's own
    return true;
}

static void static_frames_upload_nothing_after_warm_up(void **state)
{
    (void)state;
    enum { NEEDED = 60 };
    static const int limits[] = {0, NEEDED, NEEDED + 1};
    for (int i = 0; i < 3; i++) {
        struct model m;
        start(&m, limits[i]);
        for (int frame = 0; frame < 20; frame++) {
            begin(&m);
            for (int tile = 0; tile < NEEDED; tile++) assert_true(ask(&m, tile * 7));
            assert_int_equal(m.uploads, frame == 0 ? NEEDED : 0);
            assert_int_equal(m.batches, 1);
            assert_int_equal(m.cache.slot_count, NEEDED);
        }
        geomipmap_cache_finish(&m.cache);
    }
}

// One slot short and no growth: every tile is uploaded in every frame, the thrash that the paper's growth
// is there to avoid.
static void one_slot_short_uploads_everything(void **state)
{
    (void)state;
    enum { NEEDED = 60 };
    static const int limits[] = {NEEDED - 1, 1};
    for (int i = 0; i < 2; i++) {
        struct model m;
        start(&m, limits[i]);
        for (int frame = 0; frame < 20; frame++) {
            begin(&m);
            for (int tile = 0; tile < NEEDED; tile++) assert_true(ask(&m, tile));
            assert_int_equal(m.uploads, NEEDED);
            assert_int_equal(m.batches, i == 0 ? 2 : NEEDED);
            assert_int_equal(m.cache.slot_count, limits[i]);
        }
        assert_true(m.cache.counts.evictions > 0);
        geomipmap_cache_finish(&m.cache);
    }
}

static void cache_grows_in_a_frame_and_shrinks_by_one(void **state)
{
    (void)state;
    struct model m;
    start(&m, 0);
    begin(&m);
    for (int tile = 0; tile < 100; tile++) ask(&m, tile);
    assert_int_equal(m.cache.slot_count, 100);
    for (int frame = 1; frame <= 95; frame++) {
        begin(&m);
        assert_int_equal(m.cache.slot_count, frame - 1 < 90 ? 100 - (frame - 1) : 10);
        for (int tile = 0; tile < 10; tile++) ask(&m, tile);
        assert_int_equal(m.uploads, 0); // what is used is not what is given back
    }
    assert_int_equal(m.cache.counts.shrunk, 90);
    begin(&m); // empty frames give everything back
    for (int frame = 0; frame < 20; frame++) begin(&m);
    assert_int_equal(m.cache.slot_count, 0);
    begin(&m);
    assert_true(ask(&m, 3));
    geomipmap_cache_finish(&m.cache);
}

static void least_recently_used_goes_first(void **state)
{
    (void)state;
    struct model m;
    start(&m, 3);
    begin(&m);
    for (int tile = 0; tile < 3; tile++) ask(&m, tile);
    begin(&m);
    ask(&m, 2), ask(&m, 0), ask(&m, 1); // oldest now: 2
    begin(&m);
    ask(&m, 7), ask(&m, 0), ask(&m, 1); // takes the slot of 2
    assert_int_equal(m.uploads, 1);
    begin(&m);
    ask(&m, 2);             // takes the slot of 7
    ask(&m, 0), ask(&m, 1); // still there
    assert_int_equal(m.uploads, 1);
    ask(&m, 7); // is not
    assert_int_equal(m.uploads, 2);
    geomipmap_cache_finish(&m.cache);
}

// Views that wander, jump and differ; two views in one frame; every limit.
static void random_flights_draw_their_own_tiles(void **state)
{
    (void)state;
    uint64_t seed = 8;
    for (int run = 0; run < test_size(60, 600); run++) {
        struct model m;
        int limit = run % 3 == 0 ? 0 : 1 + (int)(test_random(&seed) % 120), eye[2] = {0, 0};
        uint64_t asked = 0;
        start(&m, limit);
        for (int frame = 0; frame < 60; frame++) {
            begin(&m);
            for (int view = 0; view < 1 + run % 2; view++) {
                eye[view] += (int)(test_random(&seed) % 9) - 4;
                if (test_random(&seed) % 20 == 0) eye[view] = (int)(test_random(&seed) % TILES);
                int count = (int)(test_random(&seed) % 100);
                for (int i = 0; i < count; i++, asked++) ask(&m, ((eye[view] + i) % TILES + TILES) % TILES);
            }
            if (limit) assert_true(m.cache.slot_count <= limit);
        }
        assert_int_equal(m.cache.counts.hits + m.cache.counts.misses, asked);
        geomipmap_cache_finish(&m.cache);
    }
}

// Kept slots outlive frames that do not ask for them, and are taken only when there are no others to add.
static void kept_slots_stay(void **state)
{
    (void)state;
    struct model m;
    m = (struct model){.uploads = 0};
    assert_true(geomipmap_cache_init(&m.cache, 0, 50));
    for (int frame = 0; frame < 40; frame++) { // 10 of 40 tiles a frame
        begin(&m);
        for (int i = 0; i < 10; i++) assert_true(ask(&m, frame % 4 * 10 + i));
        assert_int_equal(m.uploads, frame < 4 ? 10 : 0);
        assert_int_equal(m.cache.slot_count, frame < 4 ? 10 * (frame + 1) : 40);
    }
    for (int frame = 0; frame < 40; frame++) { // and of 200: no more than are kept
        begin(&m);
        for (int i = 0; i < 10; i++) assert_true(ask(&m, frame % 20 * 10 + i));
        assert_true(m.cache.slot_count <= 50);
    }
    begin(&m);
    for (int i = 0; i < 80; i++) assert_true(ask(&m, i)); // unless one frame needs them
    assert_int_equal(m.cache.slot_count, 80);
    geomipmap_cache_finish(&m.cache);
}

// A cache that may not have a single slot says so instead of drawing something else.
static void no_slot_is_said(void **state)
{
    (void)state;
    struct model m;
    start(&m, 1);
    begin(&m);
    assert_true(ask(&m, 1));
    int slot;
    assert_int_equal(geomipmap_cache_find(&m.cache, name_of(2), &slot), GEOMIPMAP_FULL);
    assert_int_equal(geomipmap_cache_find(&m.cache, name_of(1), &slot), GEOMIPMAP_HIT);
    geomipmap_cache_finish(&m.cache);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(static_frames_upload_nothing_after_warm_up),
        cmocka_unit_test(one_slot_short_uploads_everything),
        cmocka_unit_test(cache_grows_in_a_frame_and_shrinks_by_one),
        cmocka_unit_test(least_recently_used_goes_first),
        cmocka_unit_test(random_flights_draw_their_own_tiles),
        cmocka_unit_test(kept_slots_stay),
        cmocka_unit_test(no_slot_is_said),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
