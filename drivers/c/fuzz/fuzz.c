/* Feeds the receiver input that no node sends: mutated, truncated and random.
 *
 *   fuzz CORPUS INPUTS [SEED]
 *
 * CORPUS holds good units, a line each: "classic ID BYTES", "fd ID BYTES", "serial BYTES". Every
 * input is one CAN frame or one burst of serial bytes. Some get a new right CRC, so that they reach
 * the later checks. After each input the receiver must be intact: within its bounds, and permitting
 * motion only by its own rule. Build it with the sanitizers: they find what this test does not.
 *
 * Prints the inputs, what was accepted, and the maximum resident memory in KiB after a tenth of them
 * and at the end; exits 1 on a broken rule.
 */
#define _POSIX_C_SOURCE 200809L
#include "inputs.h"

#include <sys/resource.h>
#include <time.h>

static unsigned mutate(uint8_t *data, unsigned length, unsigned room)
{
    for (unsigned times = 1 + dice(3); times > 0; times--) {
        unsigned at = length > 0 ? dice(length) : 0;
        switch (dice(7)) {
        case 0: /* a few bits */
            for (unsigned k = 1 + dice(4); length > 0 && k > 0; k--) {
                data[dice(length)] ^= (uint8_t)(1u << dice(8));
            }
            break;
        case 1: /* cut off */
            length = at;
            break;
        case 2: /* an extreme value */
            if (length > 0) {
                data[at] = (uint8_t)(dice(2) ? 0xFF : dice(2) ? 0x00 : 0x80);
            }
            break;
        case 3: /* one byte more */
            if (length < room) {
                memmove(data + at + 1, data + at, length - at);
                data[at] = (uint8_t)dice(256);
                length++;
            }
            break;
        case 4: /* one byte less */
            if (length > 0) {
                memmove(data + at, data + at + 1, length - at - 1);
                length--;
            }
            break;
        case 5: /* longer, of anything */
            for (unsigned k = dice(64); k > 0 && length < room; k--) {
                data[length++] = (uint8_t)dice(256);
            }
            break;
        default: /* the counter goes on */
            if (length > 2) {
                data[1 + dice(3) % (length - 1)] = (uint8_t)(data[1] + 1 + dice(3));
            }
            break;
        }
    }
    return length;
}

static void make(input *in)
{
    uint8_t frame[ROOM];
    unsigned length;
    static unsigned last; /* parts of one message follow each other in the corpus */
    last = dice(2) ? (last + 1) % seed_count : dice(seed_count);
    *in = seeds[last];
    switch (dice(12)) {
    default: /* as it was */
        break;
    case 1: /* purely random */
        in->length = in->link == HRI_CLASSIC ? dice(9) : dice(in->link == HRI_FD ? 65 : 200);
        for (unsigned i = 0; i < in->length; i++) {
            in->data[i] = (uint8_t)dice(256);
        }
        break;
    case 2:
    case 3:
    case 4: /* wrong on the wire */
        in->length = mutate(in->data, in->length, ROOM - 1);
        break;
    case 5:
    case 6:
    case 7: /* wrong, and well protected */
        if (in->link == HRI_SERIAL) {
            length = unstuff(frame, in->data, in->length);
            length = mutate(frame, length, 90);
            sign_serial(in, frame, length);
        } else {
            in->length = mutate(in->data, in->length, ROOM - 1);
            sign_can(in);
        }
        break;
    }
    if (in->link != HRI_SERIAL && dice(16) == 0) {
        in->id += dice(3) - 1;
    }
}

/* Check the receiver's own rule from its visible state; 0 if it is broken. */
static int whole(hri_receiver *r, uint32_t now)
{
    uint16_t speed = hri_permitted_speed(r, now);
    const hri_advice *a = &r->message.advice;
    int may = r->message.schema.version == HRI_SCHEMA_VERSION &&
              r->message.schema.hash == HRI_SCHEMA_HASH && a->level >= 1 && a->level <= 3 &&
              a->age_ms < r->settings.max_age_ms && speed == a->speed_limit_mm_s &&
              r->verdict == HRI_BY_ADVICE && r->errors <= r->settings.tolerated_errors;
    return (speed == 0 || may) && r->line_length <= HRI_SERIAL_BYTES &&
           r->message.body.count <= HRI_POSE_ITEMS && r->sent_kept <= HRI_SENT_KEPT &&
           a->level <= HRI_LEVEL_FAULT && r->verdict <= HRI_STALE;
}

/* The address sanitizer keeps what was freed for a while; keep that small. */
const char *__asan_default_options(void);
const char *__asan_default_options(void)
{
    return "quarantine_size_mb=1";
}

static long resident_kib(void)
{
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    return usage.ru_maxrss;
}

static void run(uint64_t inputs)
{
    static const hri_robot_state still = {.mode = HRI_MODE_AUTOMATIC, .joints = 6};
    hri_receiver receivers[3];
    hri_unit units[HRI_PARTS_STATE];
    uint64_t accepted = 0, permitted = 0;
    uint32_t now = 0xFFFFF000u; /* the tick wraps soon */
    clock_t began = clock();
    long memory_kib = 0;
    for (unsigned i = 0; i < 3; i++) {
        hri_settings s = {.link = (uint8_t)i, .robot = 1, .base_id = HRI_DEFAULT_BASE_ID};
        s.silence_timeout_ms = 150;
        s.max_age_ms = 1000;
        s.tolerated_errors = 65535;
        s.error_window_ms = 1;
        s.first_state_counter = 4707; /* so that the corpus' ECHO 4711 is one of the next */
        hri_init(&receivers[i], &s);
    }
    for (uint64_t n = 0; n < inputs; n++) {
        input in;
        hri_receiver *r;
        memory_kib = n == inputs / 10 ? resident_kib() : memory_kib;
        make(&in);
        r = &receivers[in.link];
        now += dice(64) == 0 ? dice(400) : dice(4);
        if (dice(8) == 0) { /* this test does not cover counters in order */
            memset(r->sequences, 0, sizeof r->sequences);
        }
        if (dice(4) == 0) {
            if (dice(8) == 0) {
                r->state_counter = (uint16_t)(4707 + dice(8));
            }
            hri_send_robot_state(r, &still, now, units);
        }
        if (in.link == HRI_SERIAL) {
            for (unsigned i = 0; i < in.length; i++) {
                accepted += hri_receive_serial_byte(r, in.data[i], now) != HRI_NOTHING;
            }
        } else {
            /* a copy of the exact size, so that the sanitizer finds a read past the end */
            uint8_t *copy = malloc(in.length > 0 ? in.length : 1);
            memcpy(copy, in.data, in.length);
            accepted += hri_receive_can(r, in.id, false, in.link == HRI_FD, copy,
                                        (uint8_t)in.length, now) != HRI_NOTHING;
            free(copy);
        }
        permitted += hri_permitted_speed(r, now) > 0;
        if (!whole(r, now)) {
            fprintf(stderr, "input %llu broke the rule: verdict %s\n", (unsigned long long)n,
                    hri_verdict_name(r->verdict));
            exit(1);
        }
    }
    printf("inputs %llu accepted %llu permitted %llu seconds %.1f memory_kib %ld to %ld\n",
           (unsigned long long)inputs, (unsigned long long)accepted, (unsigned long long)permitted,
           (double)(clock() - began) / CLOCKS_PER_SEC, memory_kib, resident_kib());
}

int main(int argc, char **argv)
{
    if (argc < 3) {
        fprintf(stderr, "usage: fuzz CORPUS INPUTS [SEED]\n");
        return 2;
    }
    load(argv[1]);
    state = 0x9E3779B97F4A7C15u ^ strtoull(argc > 3 ? argv[3] : "1", NULL, 0);
    run(strtoull(argv[2], NULL, 0));
    return 0;
}
