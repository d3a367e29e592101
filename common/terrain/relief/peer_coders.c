// SPDX-License-Identifier: MIT
#include "common/terrain/relief/peer_coders.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <zlib.h>

#ifdef RELIEF_OPENJPEG
#include <openjpeg.h>
#endif
#ifdef RELIEF_CHARLS
#include <charls/charls.h>
#endif
#ifdef RELIEF_LERC
#include <Lerc_c_api.h>
#endif

struct image { // heights less the lowest one, in quanta
    uint32_t width, height;
    uint16_t *samples;
};

static size_t samples_of(const struct image *image)
{
    return (size_t)image->width * image->height;
}

struct bytes {
    uint8_t *data;
    size_t size, room;
};

// `coarse` is the coder's own measure of loss: 0 is lossless; where `whole`, only whole numbers count.
struct peer_coder {
    const char *name;
    bool whole;
    double most;                                                                 // of `coarse`
    bool (*encode)(const struct image *image, double coarse, struct bytes *out); // out->room bytes are there
    bool (*decode)(const struct bytes *in, const struct image *image, double coarse);
};

// ---- OpenJPEG: coarse is the rms error asked for ---------------------------

#ifdef RELIEF_OPENJPEG
struct memory_stream {
    struct bytes *bytes;
    size_t at;
};

static OPJ_SIZE_T stream_read(void *buffer, OPJ_SIZE_T size, void *user)
{
    struct memory_stream *s = user;
    size_t left = s->bytes->size - s->at, count = size < left ? size : left;
    if (count == 0) return (OPJ_SIZE_T)-1;
    memcpy(buffer, s->bytes->data + s->at, count);
    s->at += count;
    return count;
}

static OPJ_SIZE_T stream_write(void *buffer, OPJ_SIZE_T size, void *user)
{
    struct memory_stream *s = user;
    if (size > s->bytes->room - s->at) return (OPJ_SIZE_T)-1;
    memcpy(s->bytes->data + s->at, buffer, size);
    s->at += size;
    if (s->at > s->bytes->size) s->bytes->size = s->at;
    return size;
}

static OPJ_BOOL stream_seek(OPJ_OFF_T to, void *user)
{
    struct memory_stream *s = user;
    if (to < 0 || (size_t)to > s->bytes->room) return OPJ_FALSE;
    s->at = (size_t)to;
    return OPJ_TRUE;
}

static OPJ_OFF_T stream_skip(OPJ_OFF_T by, void *user)
{
    struct memory_stream *s = user;
    return stream_seek((OPJ_OFF_T)s->at + by, user) ? by : -1;
}

static opj_stream_t *open_stream(struct memory_stream *memory, bool reading)
{
    opj_stream_t *stream = opj_stream_default_create(reading);
    if (!stream) return NULL;
    opj_stream_set_user_data(stream, memory, NULL);
    opj_stream_set_user_data_length(stream, memory->bytes->size);
    opj_stream_set_read_function(stream, stream_read);
    opj_stream_set_write_function(stream, stream_write);
    opj_stream_set_seek_function(stream, stream_seek);
    opj_stream_set_skip_function(stream, stream_skip);
    return stream;
}

static opj_image_t *openjpeg_image(const struct image *image)
{
    opj_image_cmptparm_t component = {
        .dx = 1, .dy = 1, .w = image->width, .h = image->height, .prec = 16, .bpp = 16};
    opj_image_t *to = opj_image_create(1, &component, OPJ_CLRSPC_GRAY);
    if (!to) return NULL;
    to->x1 = image->width, to->y1 = image->height;
    for (size_t i = 0; i < samples_of(image); i++) to->comps[0].data[i] = image->samples[i];
    return to;
}

static bool openjpeg_encode(const struct image *image, double coarse, struct bytes *out)
{
    opj_cparameters_t parameters;
    opj_set_default_encoder_parameters(&parameters);
    parameters.tcp_numlayers = 1;
    parameters.irreversible = coarse > 0;
    parameters.cp_disto_alloc = coarse <= 0;
    parameters.cp_fixed_quality = coarse > 0;
    if (coarse > 0) parameters.tcp_distoratio[0] = (float)(20 * log10(65535 / coarse));
    uint32_t least = image->width < image->height ? image->width : image->height;
    while (parameters.numresolution > 1 && least >> (parameters.numresolution - 1) == 0)
        parameters.numresolution--;
    out->size = 0;
    struct memory_stream memory = {out, 0};
    opj_codec_t *codec = opj_create_compress(OPJ_CODEC_J2K);
    opj_image_t *from = openjpeg_image(image);
    opj_stream_t *stream = open_stream(&memory, false);
    bool good = codec && from && stream && opj_setup_encoder(codec, &parameters, from) &&
                opj_start_compress(codec, from, stream) && opj_encode(codec, stream) &&
                opj_end_compress(codec, stream);
    if (stream) opj_stream_destroy(stream);
    if (from) opj_image_destroy(from);
    if (codec) opj_destroy_codec(codec);
    return good;
}

static bool openjpeg_decode(const struct bytes *in, const struct image *image, double coarse)
{
    (void)coarse;
    struct bytes bytes = *in;
    struct memory_stream memory = {&bytes, 0};
    bytes.room = bytes.size;
    opj_dparameters_t parameters;
    opj_set_default_decoder_parameters(&parameters);
    opj_codec_t *codec = opj_create_decompress(OPJ_CODEC_J2K);
    opj_image_t *to = NULL;
    opj_stream_t *stream = open_stream(&memory, true);
    bool good = codec && stream && opj_setup_decoder(codec, &parameters) &&
                opj_read_header(stream, codec, &to) && opj_decode(codec, stream, to) &&
                to->comps[0].w == image->width && to->comps[0].h == image->height;
    for (size_t i = 0; good && i < samples_of(image); i++) {
        int32_t value = to->comps[0].data[i];
        image->samples[i] = (uint16_t)(value < 0 ? 0 : value > 65535 ? 65535 : value);
    }
    if (stream) opj_stream_destroy(stream);
    if (to) opj_image_destroy(to);
    if (codec) opj_destroy_codec(codec);
    return good;
}
#endif

// ---- JPEG-LS: coarse is the largest error ----------------------------------

#ifdef RELIEF_CHARLS
static bool charls_encode(const struct image *image, double coarse, struct bytes *out)
{
    const charls_frame_info frame = {image->width, image->height, 16, 1};
    charls_jpegls_encoder *encoder = charls_jpegls_encoder_create();
    bool good =
        encoder && !charls_jpegls_encoder_set_frame_info(encoder, &frame) &&
        !charls_jpegls_encoder_set_near_lossless(encoder, (int32_t)coarse) &&
        !charls_jpegls_encoder_set_destination_buffer(encoder, out->data, out->room) &&
        !charls_jpegls_encoder_encode_from_buffer(encoder, image->samples, 2 * samples_of(image), 0) &&
        !charls_jpegls_encoder_get_bytes_written(encoder, &out->size);
    charls_jpegls_encoder_destroy(encoder);
    return good;
}

static bool charls_decode(const struct bytes *in, const struct image *image, double coarse)
{
    (void)coarse;
    charls_jpegls_decoder *decoder = charls_jpegls_decoder_create();
    bool good = decoder && !charls_jpegls_decoder_set_source_buffer(decoder, in->data, in->size) &&
                !charls_jpegls_decoder_read_header(decoder) &&
                !charls_jpegls_decoder_decode_to_buffer(decoder, image->samples, 2 * samples_of(image), 0);
    charls_jpegls_decoder_destroy(decoder);
    return good;
}
#endif

// ---- LERC: coarse is the largest error -------------------------------------

#ifdef RELIEF_LERC
enum { LERC_USHORT = 3 };

static bool lerc_encode_image(const struct image *image, double coarse, struct bytes *out)
{
    unsigned int written = 0;
    bool good = lerc_encode(image->samples, LERC_USHORT, 1, (int)image->width, (int)image->height, 1, 0, NULL,
                            coarse, out->data, (unsigned int)out->room, &written) == 0;
    out->size = written;
    return good;
}

static bool lerc_decode_image(const struct bytes *in, const struct image *image, double coarse)
{
    (void)coarse;
    return lerc_decode(in->data, (unsigned int)in->size, 0, NULL, 1, (int)image->width, (int)image->height, 1,
                       LERC_USHORT, image->samples) == 0;
}
#endif

// ---- zlib: heights in steps of 2 coarse + 1, differences along rows --------

static bool zlib_encode(const struct image *image, double coarse, struct bytes *out)
{
    uint32_t step = 2 * (uint32_t)coarse + 1;
    uint16_t *differences = malloc(2 * samples_of(image));
    if (!differences) return false;
    for (size_t y = 0, i = 0; y < image->height; y++) {
        uint32_t before = 0;
        for (size_t x = 0; x < image->width; x++, i++) {
            uint32_t k = (image->samples[i] + step / 2) / step;
            differences[i] = (uint16_t)(k - before);
            before = k;
        }
    }
    uLongf size = (uLongf)out->room;
    bool good = compress2(out->data, &size, (const Bytef *)differences, 2 * samples_of(image), 9) == Z_OK;
    out->size = size;
    free(differences);
    return good;
}

static bool zlib_decode(const struct bytes *in, const struct image *image, double coarse)
{
    uint32_t step = 2 * (uint32_t)coarse + 1;
    uLongf size = 2 * samples_of(image);
    if (uncompress((Bytef *)image->samples, &size, in->data, in->size) != Z_OK) return false;
    for (size_t y = 0, i = 0; y < image->height; y++) {
        uint16_t k = 0;
        for (size_t x = 0; x < image->width; x++, i++) {
            k = (uint16_t)(k + image->samples[i]);
            uint32_t value = k * step;
            image->samples[i] = (uint16_t)(value < 65535 ? value : 65535);
        }
    }
    return true;
}

static const struct peer_coder CODERS[] = {
#ifdef RELIEF_OPENJPEG
    {"OpenJPEG (JPEG 2000, 9/7, untiled)", false, 65535, openjpeg_encode, openjpeg_decode},
#else
    {"OpenJPEG (JPEG 2000, 9/7, untiled)", false, 0, NULL, NULL},
#endif
#ifdef RELIEF_CHARLS
    {"CharLS (JPEG-LS)", true, 255, charls_encode, charls_decode},
#else
    {"CharLS (JPEG-LS)", true, 0, NULL, NULL},
#endif
#ifdef RELIEF_LERC
    {"LERC", true, 32767, lerc_encode_image, lerc_decode_image},
#else
    {"LERC", true, 0, NULL, NULL},
#endif
    {"zlib 9 of row differences", true, 32767, zlib_encode, zlib_decode},
};

int peer_coder_count(void)
{
    return (int)(sizeof CODERS / sizeof *CODERS);
}

const char *peer_coder_name(int number)
{
    return CODERS[number].name;
}

// ---- measuring -------------------------------------------------------------

double coder_cpu_seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

void coder_errors(const struct heightfield *a, const struct heightfield *b, double *rms_m, double *max_m)
{
    double squares = 0, most = 0;
    for (int64_t i = 0; i < a->width * a->height; i++) {
        double off =
            fabs((b->quantum_m * b->samples[i] + b->offset_m) - (a->quantum_m * a->samples[i] + a->offset_m));
        squares += off * off;
        most = fmax(most, off);
    }
    *rms_m = sqrt(squares / (double)(a->width * a->height));
    *max_m = most;
}

struct comparison {
    const struct peer_coder *coder;
    struct image source, decoded;
    struct bytes bytes;
    double quantum_m;
};

// One encoding and one decoding; false when the coder refused.
static bool run_once(struct comparison *c, double coarse, struct coder_run *run)
{
    double start = coder_cpu_seconds(), squares = 0;
    if (!c->coder->encode(&c->source, coarse, &c->bytes)) return false;
    double middle = coder_cpu_seconds();
    if (!c->coder->decode(&c->bytes, &c->decoded, coarse)) return false;
    run->encode_s = middle - start;
    run->decode_s = coder_cpu_seconds() - middle;
    run->bytes = (double)c->bytes.size;
    int most = 0;
    for (size_t i = 0; i < samples_of(&c->source); i++) {
        int off = abs(c->source.samples[i] - c->decoded.samples[i]);
        squares += (double)off * off;
        most = off > most ? off : most;
    }
    run->rms_m = sqrt(squares / (double)samples_of(&c->source)) * c->quantum_m;
    run->max_m = most * c->quantum_m;
    return true;
}

// The coarsest setting that keeps the aim.
static bool search(struct comparison *c, const struct coder_aim *aim, struct coder_run *best)
{
    enum { TRIES = 14 };
    double target = aim->rms_m > 0 ? aim->rms_m : aim->max_m;
    if (target <= 0) return run_once(c, 0, best);
    double low = 0, high = c->coder->most + 1, coarse = target / c->quantum_m;
    bool found = false;
    for (int i = 0; i < TRIES; i++) {
        struct coder_run run = *best;
        if (c->coder->whole) coarse = floor(coarse + 1e-9);
        if (coarse >= high) coarse = c->coder->whole ? high - 1 : sqrt(low * high);
        if (coarse <= low && found) break; // whole numbers: both neighbours are known
        if (!run_once(c, coarse, &run)) return false;
        double reached = aim->rms_m > 0 ? run.rms_m : run.max_m;
        if (reached <= target * (1 + 1e-9)) {
            low = coarse, found = true, *best = run;
            if (reached >= 0.998 * target) break;
        } else
            high = coarse;
        double guess = reached > 0 ? coarse * target / reached : 2 * coarse + 1;
        bool inside = guess > low && guess < high && i % 3 != 2;
        coarse = inside ? guess : (low + high) / 2;
        if (c->coder->whole && floor(coarse) <= low) coarse = low + 1;
    }
    return found;
}

static bool to_image(const struct heightfield *field, struct image *image)
{
    int32_t low = INT32_MAX, high = INT32_MIN;
    for (int64_t i = 0; i < field->width * field->height; i++) {
        low = field->samples[i] < low ? field->samples[i] : low;
        high = field->samples[i] > high ? field->samples[i] : high;
    }
    if ((int64_t)high - low > 65535) return false;
    for (int64_t i = 0; i < field->width * field->height; i++)
        image->samples[i] = (uint16_t)(field->samples[i] - low);
    return true;
}

struct coder_run peer_coder_run(int number, const struct heightfield *field, const struct coder_aim *aim)
{
    const struct peer_coder *coder = &CODERS[number];
    struct coder_run run = {.coder = coder->name};
    size_t count = (size_t)field->width * (size_t)field->height;
    struct comparison c = {.coder = coder, .quantum_m = field->quantum_m};
    if (!coder->encode) {
        run.reason = "its library was not there at build time (make deps)";
        return run;
    }
    c.source.width = c.decoded.width = (uint32_t)field->width;
    c.source.height = c.decoded.height = (uint32_t)field->height;
    c.source.samples = malloc(2 * count);
    c.decoded.samples = malloc(2 * count);
    c.bytes.room = 4 * count + 65536;
    c.bytes.data = malloc(c.bytes.room);
    if (!c.source.samples || !c.decoded.samples || !c.bytes.data)
        run.reason = "out of memory";
    else if (!to_image(field, &c.source))
        run.reason = "heights span more than 16 bits";
    else if (!search(&c, aim, &run))
        run.reason = "no setting of it keeps the aim";
    free(c.source.samples);
    free(c.decoded.samples);
    free(c.bytes.data);
    return run;
}
