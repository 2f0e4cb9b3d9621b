/* Searches for errors that pass the protection.
 *
 *   errors CORPUS SAMPLES RANDOM [SEED]
 *
 * Of each classic frame in CORPUS: every error of one, two and three bits (64 bits: 43,744 of them).
 * Of each FD frame and each serial packet: SAMPLES such errors, in the protected bytes; of serial
 * packets as many on the wire as well, after COBS. Then RANDOM purely random frames with the id of
 * Status, each after a Status with counter 99. Prints how many were tried and how many accepted:
 *
 *   classic FRAMES TRIED ACCEPTED
 *   ...
 *   random LINK TRIED ACCEPTED
 */
#include "inputs.h"

#define STATUS_COUNTER 99

static uint64_t tried, accepted;

static void begin(hri_receiver *r, uint8_t link)
{
    hri_settings s = {.link = link, .robot = 1, .base_id = HRI_DEFAULT_BASE_ID};
    s.silence_timeout_ms = 150;
    s.max_age_ms = 400;
    hri_init(r, &s);
}

static uint8_t feed(hri_receiver *r, const input *in)
{
    uint8_t kind = HRI_NOTHING;
    if (in->link != HRI_SERIAL) {
        return hri_receive_can(r, in->id, false, in->link == HRI_FD, in->data,
                               (uint8_t)in->length, 0);
    }
    for (unsigned i = 0; i < in->length; i++) {
        uint8_t completed = hri_receive_serial_byte(r, in->data[i], 0);
        kind = completed != HRI_NOTHING ? completed : kind;
    }
    return kind;
}

/* A frame with an error counts as accepted if it passes the CRC, even if later checks refuse it. */
static void try_frame(const hri_receiver *fresh, const input *in)
{
    hri_receiver r = *fresh;
    feed(&r, in);
    tried++;
    accepted += r.counts.crc_errors != 1;
}

static void flip(input *in, unsigned bit)
{
    in->data[bit / 8] ^= (uint8_t)(1u << (bit % 8));
}

static void every_error(const hri_receiver *fresh, input *in)
{
    unsigned bits = 8 * in->length;
    for (unsigned a = 0; a < bits; a++) {
        flip(in, a);
        try_frame(fresh, in);
        for (unsigned b = a + 1; b < bits; b++) {
            flip(in, b);
            try_frame(fresh, in);
            for (unsigned c = b + 1; c < bits; c++) {
                flip(in, c);
                try_frame(fresh, in);
                flip(in, c);
            }
            flip(in, b);
        }
        flip(in, a);
    }
}

/* One to three different bits. */
static void spoil(input *in)
{
    unsigned bits = 8 * in->length;
    unsigned a = dice(bits), b = dice(bits), c = dice(bits);
    unsigned count = 1 + dice(3);
    flip(in, a);
    if (count > 1 && b != a) {
        flip(in, b);
    }
    if (count > 2 && c != a && c != b) {
        flip(in, c);
    }
}

static void some_errors(const hri_receiver *fresh, const input *good, uint64_t samples)
{
    for (uint64_t n = 0; n < samples; n++) {
        input in = *good;
        if (good->link == HRI_SERIAL) {
            input frame = *good;
            frame.length = unstuff(frame.data, good->data, good->length);
            spoil(&frame);
            in.length = stuff(in.data, frame.data, frame.length);
        } else {
            spoil(&in);
        }
        try_frame(fresh, &in);
    }
}

/* Damaged bytes may form no frame or another frame: they must complete no message. */
static void errors_on_the_wire(const hri_receiver *fresh, const input *good, uint64_t samples)
{
    for (uint64_t n = 0; n < samples; n++) {
        hri_receiver r = *fresh;
        input in = *good;
        in.length--; /* without the zero that ends it: it comes in any case */
        spoil(&in);
        in.data[in.length++] = 0;
        tried++;
        accepted += feed(&r, &in) != HRI_NOTHING;
    }
}

static void report(const char *name, unsigned frames)
{
    printf("%s %u %llu %llu\n", name, frames, (unsigned long long)tried,
           (unsigned long long)accepted);
    tried = accepted = 0;
}

static void random_frames(uint8_t link, unsigned length, uint64_t count)
{
    hri_receiver fresh;
    begin(&fresh, link);
    fresh.sequences[HRI_STATUS].started = true;
    fresh.sequences[HRI_STATUS].last = STATUS_COUNTER;
    for (uint64_t n = 0; n < count; n++) {
        hri_receiver r = fresh;
        input in = {.link = link, .id = HRI_DEFAULT_BASE_ID + HRI_NUMBER_STATUS};
        uint8_t frame[ROOM];
        for (unsigned i = 0; i < length; i++) {
            frame[i] = (uint8_t)dice(256);
        }
        in.length = link == HRI_SERIAL ? stuff(in.data, frame, length) : length;
        if (link != HRI_SERIAL) {
            memcpy(in.data, frame, length);
        }
        tried++;
        accepted += feed(&r, &in) != HRI_NOTHING;
    }
}

int main(int argc, char **argv)
{
    static const char *const names[] = {"classic", "fd", "serial"};
    unsigned frames[3] = {0};
    uint64_t samples, randoms;
    hri_receiver fresh;
    if (argc < 4) {
        fprintf(stderr, "usage: errors CORPUS SAMPLES RANDOM [SEED]\n");
        return 2;
    }
    load(argv[1]);
    samples = strtoull(argv[2], NULL, 0);
    randoms = strtoull(argv[3], NULL, 0);
    state = 0x9E3779B97F4A7C15u ^ strtoull(argc > 4 ? argv[4] : "1", NULL, 0);
    for (uint8_t link = 0; link < 3; link++) {
        begin(&fresh, link);
        for (unsigned i = 0; i < seed_count; i++) {
            if (seeds[i].link == link) {
                frames[link]++;
                if (link == HRI_CLASSIC) {
                    every_error(&fresh, &seeds[i]);
                } else {
                    some_errors(&fresh, &seeds[i], samples);
                }
            }
        }
        report(names[link], frames[link]);
    }
    for (unsigned i = 0; i < seed_count; i++) {
        if (seeds[i].link == HRI_SERIAL) {
            errors_on_the_wire(&fresh, &seeds[i], samples);
        }
    }
    report("wire", frames[2]);
    random_frames(HRI_CLASSIC, 8, randoms);
    report("random classic", 0);
    random_frames(HRI_FD, 12, randoms);
    report("random fd", 0);
    random_frames(HRI_SERIAL, 18, randoms);
    report("random serial", 0);
    return 0;
}
