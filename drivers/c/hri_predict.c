/* The controller's side of hri-predict; see hri_predict.h, and ../PROTOCOL.md for the wire. */
#include "hri_predict.h"

#include <string.h>

#define HEADER_CLASSIC 2u /* bytes of protection before the payload */
#define HEADER_FD 3u
#define HEADER_SERIAL 12u
#define CLASSIC_BYTES 8u
#define FD_BYTES 64u
#define MASK_CAN 0xFFu /* counters advance modulo 256 on CAN, modulo 65536 on serial lines */
#define MASK_SERIAL 0xFFFFu
#define ALL_PARTS ((1u << HRI_PARTS_ADVICE) - 1u)
#define ZONE_ITEM_BYTES 15u
#define POSE_ITEM_BYTES 7u
#define NO_COBS 0xFFFFFFFFu

/* -- bytes -------------------------------------------------------------------------------- */

static uint16_t get_u16(const uint8_t *p)
{
    return (uint16_t)(p[0] | ((uint32_t)p[1] << 8));
}

static int16_t get_i16(const uint8_t *p)
{
    uint16_t raw = get_u16(p);
    return (raw < 0x8000u) ? (int16_t)raw : (int16_t)((int32_t)raw - 0x10000);
}

static uint32_t get_u32(const uint8_t *p)
{
    return get_u16(p) | ((uint32_t)get_u16(&p[2]) << 16);
}

static uint32_t get_big_u32(const uint8_t *p)
{
    return ((uint32_t)p[0] << 24) | ((uint32_t)p[1] << 16) | ((uint32_t)p[2] << 8) | p[3];
}

static void put_u16(uint8_t *p, uint32_t value)
{
    p[0] = (uint8_t)(value & 0xFFu);
    p[1] = (uint8_t)((value >> 8) & 0xFFu);
}

static void put_big_u32(uint8_t *p, uint32_t value)
{
    for (uint32_t i = 0u; i < 4u; i++) {
        p[i] = (uint8_t)((value >> (24u - (8u * i))) & 0xFFu);
    }
}

/* -- CRCs, four bits at a time  */

static uint8_t crc8(uint8_t start, const uint8_t *data, uint32_t length)
{
    static const uint8_t table[16] = {0x00u, 0x2Fu, 0x5Eu, 0x71u, 0xBCu, 0x93u, 0xE2u, 0xCDu,
                                      0x57u, 0x78u, 0x09u, 0x26u, 0xEBu, 0xC4u, 0xB5u, 0x9Au};
    uint8_t crc = start;
    for (uint32_t i = 0u; i < length; i++) {
        crc = (uint8_t)(crc ^ data[i]);
        crc = (uint8_t)(((uint32_t)crc << 4) ^ table[crc >> 4]);
        crc = (uint8_t)(((uint32_t)crc << 4) ^ table[crc >> 4]);
    }
    return crc;
}

static uint16_t crc16(uint16_t start, const uint8_t *data, uint32_t length)
{
    static const uint16_t table[16] = {0x0000u, 0x1021u, 0x2042u, 0x3063u, 0x4084u, 0x50A5u,
                                       0x60C6u, 0x70E7u, 0x8108u, 0x9129u, 0xA14Au, 0xB16Bu,
                                       0xC18Cu, 0xD1ADu, 0xE1CEu, 0xF1EFu};
    uint16_t crc = start;
    for (uint32_t i = 0u; i < length; i++) {
        crc = (uint16_t)(crc ^ ((uint32_t)data[i] << 8));
        crc = (uint16_t)(((uint32_t)crc << 4) ^ table[crc >> 12]);
        crc = (uint16_t)(((uint32_t)crc << 4) ^ table[crc >> 12]);
    }
    return crc;
}

static uint32_t crc32(uint32_t start, const uint8_t *data, uint32_t length)
{
    static const uint32_t table[16] = {
        0x00000000u, 0x2B2C2BEEu, 0x565857DCu, 0x7D747C32u, 0xACB0AFB8u, 0x879C8456u,
        0xFAE8F864u, 0xD1C4D38Au, 0xC8DF352Fu, 0xE3F31EC1u, 0x9E8762F3u, 0xB5AB491Du,
        0x646F9A97u, 0x4F43B179u, 0x3237CD4Bu, 0x191BE6A5u};
    uint32_t crc = start;
    for (uint32_t i = 0u; i < length; i++) {
        crc ^= data[i];
        crc = (crc >> 4) ^ table[crc & 15u];
        crc = (crc >> 4) ^ table[crc & 15u];
    }
    return crc;
}

static uint8_t crc_classic(const uint8_t *frame, uint32_t number)
{
    uint8_t data_id = (uint8_t)(number + 1u);
    return crc8(crc8(0xFFu, &frame[1], CLASSIC_BYTES - 1u), &data_id, 1u) ^ 0xFFu;
}

static uint16_t crc_fd(const uint8_t *frame, uint32_t length, uint32_t number)
{
    uint8_t data_id[2];
    put_u16(data_id, HRI_DATA_ID_16 + number);
    return crc16(crc16(0xFFFFu, &frame[2], length - 2u), data_id, 2u);
}

static uint32_t crc_serial(const uint8_t *frame, uint32_t length)
{
    uint32_t crc = crc32(0xFFFFFFFFu, frame, 8u);
    return crc32(crc, &frame[HEADER_SERIAL], length - HEADER_SERIAL) ^ 0xFFFFFFFFu;
}

/* -- payloads ----------------------------------------------------------------------------- */

static void decode_advice(hri_advice *m, const uint8_t *p)
{
    m->level = (p[0] <= HRI_LEVEL_FAULT) ? p[0] : (uint8_t)HRI_LEVEL_UNKNOWN;
    m->reason = p[1];
    m->speed_limit_mm_s = get_u16(&p[2]);
    m->separation_mm = get_i16(&p[4]);
    m->predicted_separation_mm = get_i16(&p[6]);
    m->time_to_breach_ms = get_u16(&p[8]);
    m->age_ms = get_u16(&p[10]);
    m->latch_id = get_u16(&p[12]);
    m->echo = get_u16(&p[14]);
    m->body_part = p[16];
    m->robot_link = p[17];
}

static void decode_status(hri_status *m, const uint8_t *p)
{
    uint8_t state = p[0] & 15u;
    m->node_state = (state <= HRI_NODE_STATE_STOPPING) ? state : (uint8_t)HRI_NODE_STATE_UNKNOWN;
    m->people = p[0] >> 4;
    m->reason = p[1];
    m->predictor = p[2];
    m->cycle = p[3];
    m->age_ms = get_u16(&p[4]);
}

static bool get_point(int16_t *point, const uint8_t *p)
{
    bool available = true;
    for (uint32_t i = 0u; i < 3u; i++) {
        point[i] = get_i16(&p[2u * i]);
        available = available && (point[i] != HRI_NO_I16);
    }
    return available;
}

static bool decode_body(hri_body *m, uint8_t kind, const uint8_t *p, uint32_t length)
{
    uint32_t room = (kind == HRI_ZONE) ? HRI_ZONE_ITEMS : HRI_POSE_ITEMS;
    uint32_t item_bytes = (kind == HRI_ZONE) ? ZONE_ITEM_BYTES : POSE_ITEM_BYTES;
    bool valid;
    m->person = get_u16(&p[0]);
    m->step = p[2];
    m->horizon_ms = get_u16(&p[3]);
    m->age_ms = get_u16(&p[5]);
    m->first = p[7];
    m->total = p[8];
    m->count = p[9];
    valid = (m->horizon_ms != HRI_NO_U16) && (m->count <= room) &&
            (((uint32_t)m->first + m->count) <= m->total) &&
            (length >= (HRI_BYTES_ZONE + (m->count * item_bytes)));
    for (uint32_t i = 0u; valid && (i < m->count); i++) {
        const uint8_t *item = &p[HRI_BYTES_ZONE + (i * item_bytes)];
        if (kind == HRI_ZONE) {
            hri_capsule *c = &m->capsules[i];
            c->segment = item[0];
            c->radius_mm = get_u16(&item[13]);
            valid = get_point(c->a_mm, &item[1]) && get_point(c->b_mm, &item[7]) &&
                    (c->radius_mm != HRI_NO_U16);
        } else {
            m->joints[i].joint = item[0];
            valid = get_point(m->joints[i].position_mm, &item[1]);
        }
    }
    return valid;
}

/* Decode into the newest message of its kind; refuse impossible values and change nothing. */
static bool decode(hri_message *message, uint8_t kind, const uint8_t *p, uint32_t length)
{
    static const uint8_t least[HRI_KINDS] = {0u,
                                             HRI_BYTES_ADVICE,
                                             HRI_BYTES_STATUS,
                                             HRI_BYTES_SCHEMA,
                                             HRI_BYTES_ZONE,
                                             HRI_BYTES_POSE};
    bool valid = (length >= least[kind]);
    hri_body body = message->body;
    if (!valid) {
        /* too short */
    } else if (kind == HRI_ADVICE) {
        decode_advice(&message->advice, p);
    } else if (kind == HRI_STATUS) {
        decode_status(&message->status, p);
    } else if (kind == HRI_SCHEMA) {
        message->schema.version = get_u16(p);
        message->schema.hash = get_u32(&p[2]);
    } else {
        valid = decode_body(&body, kind, p, length);
        message->body = valid ? body : message->body;
    }
    return valid;
}

/* -- what counts: counters, schema, age, time --------------------------------------------- */

#define STARTING 0u /* hri_receiver.phase */
#define ADVISED 1u
#define SILENT 2u
#define FORGOTTEN 3u

static bool fresh(hri_sequence *s, hri_counts *counts, uint16_t counter, uint32_t mask)
{
    uint32_t delta = ((uint32_t)counter - s->last) & mask;
    bool in_order = !s->started || ((delta >= 1u) && (delta <= HRI_MAX_DELTA));
    if (in_order) {
        counts->counter_errors += s->started ? (delta - 1u) : 0u;
    } else {
        uint32_t step = ((uint32_t)counter - s->candidate) & mask;
        if ((delta == 0u) || ((s->run > 0u) && (step == 0u))) {
            s->run = 0u; /* a repeat ends the row */
        } else {
            s->run = ((s->run > 0u) && (step == 1u)) ? (uint8_t)(s->run + 1u) : 1u;
        }
        s->candidate = counter;
        in_order = (s->run >= HRI_RESYNC);
        counts->counter_errors += in_order ? 0u : 1u;
    }
    if (in_order) {
        s->started = true;
        s->last = counter;
        s->run = 0u;
    }
    return in_order;
}

/* The node encoded an Advice after we sent the RobotState that it echoes. So its data are now no
 * older than its AGE plus the time since that RobotState. */
static void take_advice(hri_receiver *r, uint32_t now_ms)
{
    const hri_advice *advice = &r->message.advice;
    uint32_t behind = ((uint32_t)r->state_counter - advice->echo) & 0xFFFFu;
    uint32_t place = (r->sent_newest + HRI_SENT_KEPT - behind) % HRI_SENT_KEPT;
    r->age_bounded = (advice->age_ms != HRI_NO_U16) && (advice->echo != HRI_NO_U16) &&
                     (behind < r->sent_kept);
    r->age_at_receipt_ms = advice->age_ms + (now_ms - r->sent_ms[place]);
    r->level = advice->level;
    r->speed_mm_s = advice->speed_limit_mm_s;
    r->advised_ms = now_ms;
    r->phase = ADVISED;
}

/* Judge a payload with a right CRC; the counter of Schema does not matter (see PROTOCOL.md). */
static uint8_t accept(hri_receiver *r, uint8_t kind, uint16_t counter, const uint8_t *payload,
                      uint32_t length, uint32_t now_ms)
{
    uint32_t mask = (r->settings.link == HRI_SERIAL) ? MASK_SERIAL : MASK_CAN;
    if ((kind != HRI_SCHEMA) && !fresh(&r->sequences[kind], &r->counts, counter, mask)) {
        return HRI_NOTHING;
    }
    if (!decode(&r->message, kind, payload, length)) {
        r->counts.malformed++;
        return HRI_NOTHING;
    }
    r->counts.received++;
    if (kind == HRI_SCHEMA) {
        r->schema_heard = true;
        r->schema_matches = (r->message.schema.version == HRI_SCHEMA_VERSION) &&
                            (r->message.schema.hash == HRI_SCHEMA_HASH);
        r->phase = r->schema_matches ? r->phase : (uint8_t)STARTING;
    } else if ((kind == HRI_ADVICE) && r->schema_matches) {
        take_advice(r, now_ms);
    } else {
        /* for display */
    }
    return kind;
}

/* Forget what is too old, before anything is received or permitted, because the tick may wrap. */
static void watch(hri_receiver *r, uint32_t now_ms)
{
    uint32_t keep_ms = (uint32_t)r->settings.max_age_ms + r->settings.silence_timeout_ms;
    uint32_t silent_ms = now_ms - r->advised_ms;
    for (uint32_t kept = r->sent_kept; kept > 0u; kept--) {
        uint32_t oldest = (r->sent_newest + HRI_SENT_KEPT + 1u - kept) % HRI_SENT_KEPT;
        r->sent_kept = (uint8_t)kept;
        if ((now_ms - r->sent_ms[oldest]) <= keep_ms) {
            break;
        }
        r->sent_kept = (uint8_t)(kept - 1u);
    }
    if ((r->settings.error_window_ms != 0u) &&
        ((now_ms - r->error_ms) >= r->settings.error_window_ms)) {
        r->errors = 0u;
    }
    if ((r->phase == ADVISED) && (silent_ms >= r->settings.silence_timeout_ms)) {
        r->phase = SILENT;
    }
    if ((r->phase == SILENT) && (silent_ms >= HRI_FORGET_MS)) {
        r->phase = FORGOTTEN;
        r->schema_heard = false;
        r->schema_matches = false;
        r->part_started = false;
        r->sent_kept = 0u; /* a tick set back also leads here: old times are void */
        (void)memset(r->sequences, 0, sizeof r->sequences);
    }
}

static uint32_t error_count(const hri_counts *c)
{
    return c->crc_errors + c->counter_errors + c->malformed + c->incomplete;
}

static void note_errors(hri_receiver *r, uint32_t before, uint32_t now_ms)
{
    uint32_t more = error_count(&r->counts) - before;
    if (more > 0u) {
        r->errors += more;
        r->error_ms = now_ms;
    }
}

/* Kind of the frame of this number, HRI_NOTHING if it is not for us. */
static uint8_t kind_of(const hri_receiver *r, uint32_t number)
{
    bool wide = (r->settings.link != HRI_CLASSIC);
    uint32_t part = number - (HRI_NUMBER_ADVICE + (HRI_ROBOT_STRIDE * r->settings.robot));
    uint8_t kind = HRI_NOTHING;
    if (part < (wide ? 1u : HRI_PARTS_ADVICE)) {
        kind = HRI_ADVICE;
    } else if (number == HRI_NUMBER_STATUS) {
        kind = HRI_STATUS;
    } else if (number == HRI_NUMBER_SCHEMA) {
        kind = HRI_SCHEMA;
    } else if (wide && (number == HRI_NUMBER_ZONE)) {
        kind = HRI_ZONE;
    } else if (wide && (number == HRI_NUMBER_POSE)) {
        kind = HRI_POSE;
    } else {
        /* of another robot, or from a controller */
    }
    return kind;
}

/* -- what comes in ------------------------------------------------------------------------ */

static uint8_t take_classic(hri_receiver *r, uint8_t kind, uint32_t number, const uint8_t *data,
                            uint32_t now_ms)
{
    uint32_t part = number % HRI_ROBOT_STRIDE;
    uint32_t bit = 1u << part;
    if (crc_classic(data, number) != data[0]) {
        r->counts.crc_errors++;
        return HRI_NOTHING;
    }
    if (kind != HRI_ADVICE) {
        return accept(r, kind, data[1], &data[HEADER_CLASSIC], HRI_PART_BYTES, now_ms);
    }
    if (!r->part_started || (data[1] != r->part_counter)) {
        r->counts.incomplete += (r->part_started && (r->part_mask != ALL_PARTS)) ? 1u : 0u;
        r->part_started = true;
        r->part_counter = data[1];
        r->part_mask = 0u;
    } else if ((r->part_mask & bit) != 0u) {
        r->counts.counter_errors++;
        r->part_mask = ALL_PARTS; /* void: the two may come from two senders */
        r->sequences[HRI_ADVICE].run = 0u;
        return HRI_NOTHING;
    } else {
        /* another part of the incomplete message */
    }
    (void)memcpy(&r->parts[part * HRI_PART_BYTES], &data[HEADER_CLASSIC], HRI_PART_BYTES);
    r->part_mask = (uint8_t)(r->part_mask | bit);
    return (r->part_mask != ALL_PARTS) ? (uint8_t)HRI_NOTHING
               : accept(r, HRI_ADVICE, data[1], r->parts, HRI_BYTES_ADVICE, now_ms);
}

static uint8_t take_fd(hri_receiver *r, uint8_t kind, uint32_t number, const uint8_t *data,
                       uint32_t length, uint32_t now_ms)
{
    if ((length < HEADER_FD) || (crc_fd(data, length, number) != get_u16(data))) {
        r->counts.crc_errors++;
        return HRI_NOTHING;
    }
    return accept(r, kind, data[2], &data[HEADER_FD], length - HEADER_FD, now_ms);
}

uint8_t hri_receive_can(hri_receiver *r, uint32_t id, bool extended, bool fd, const uint8_t *data,
                        uint8_t length, uint32_t now_ms)
{
    uint32_t before = error_count(&r->counts);
    uint32_t number = id - r->settings.base_id;
    uint8_t kind = kind_of(r, number);
    uint8_t completed = HRI_NOTHING;
    watch(r, now_ms);
    if (!r->configured || (kind == HRI_NOTHING) || (extended != r->settings.extended)) {
        r->counts.ignored++;
    } else if (fd != (r->settings.link == HRI_FD)) {
        r->counts.malformed++;
    } else if (fd && (length <= FD_BYTES)) {
        completed = take_fd(r, kind, number, data, length, now_ms);
    } else if (!fd && (length == CLASSIC_BYTES)) {
        completed = take_classic(r, kind, number, data, now_ms);
    } else {
        r->counts.malformed++;
    }
    note_errors(r, before, now_ms);
    return completed;
}

/* Undo COBS in place; return the length, or NO_COBS if the line is not COBS. */
static uint32_t cobs_decode(uint8_t *line, uint32_t length)
{
    uint32_t out = 0u;
    uint32_t in = 0u;
    while (in < length) {
        uint32_t block = line[in] - 1u; /* never 0: a 0 ends the line */
        in++;
        if (block > (length - in)) {
            return NO_COBS;
        }
        (void)memmove(&line[out], &line[in], block);
        in += block;
        out += block;
        if (in < length) {
            line[out] = 0u;
            out++;
        }
    }
    return out;
}

static uint8_t take_serial(hri_receiver *r, uint32_t now_ms)
{
    uint8_t *frame = r->line;
    uint32_t length = cobs_decode(frame, r->line_length);
    uint8_t kind;
    if (length == NO_COBS) {
        r->counts.malformed++;
        return HRI_NOTHING;
    }
    if ((length < HEADER_SERIAL) || ((get_big_u32(frame) >> 16) != length) ||
        (crc_serial(frame, length) != get_big_u32(&frame[8]))) {
        r->counts.crc_errors++;
        return HRI_NOTHING;
    }
    kind = kind_of(r, get_big_u32(&frame[4]) - HRI_DATA_ID_32);
    if (kind == HRI_NOTHING) {
        r->counts.ignored++;
        return HRI_NOTHING;
    }
    return accept(r, kind, (uint16_t)(get_big_u32(frame) & 0xFFFFu), &frame[HEADER_SERIAL],
                  length - HEADER_SERIAL, now_ms);
}

uint8_t hri_receive_serial_byte(hri_receiver *r, uint8_t byte, uint32_t now_ms)
{
    uint32_t before = error_count(&r->counts);
    uint8_t completed = HRI_NOTHING;
    watch(r, now_ms);
    if (!r->configured || (r->settings.link != HRI_SERIAL)) {
        r->counts.ignored++;
    } else if (byte == 0u) {
        completed = (r->line_length > 0u) ? take_serial(r, now_ms) : (uint8_t)HRI_NOTHING;
        r->line_length = 0u;
        r->line_skipping = false;
    } else if (r->line_skipping) {
        /* too long to be one of ours: skip to its end */
    } else if (r->line_length < HRI_SERIAL_BYTES) {
        r->line[r->line_length] = byte;
        r->line_length++;
    } else {
        r->counts.malformed++;
        r->line_length = 0u;
        r->line_skipping = true;
    }
    note_errors(r, before, now_ms);
    return completed;
}

/* -- what is permitted -------------------------------------------------------------------- */

bool hri_init(hri_receiver *r, const hri_settings *settings)
{
    uint32_t highest = (settings->extended ? 0x1FFFFFFFu : 0x7FFu) - HRI_LAST_NUMBER;
    (void)memset(r, 0, sizeof *r);
    r->settings = *settings;
    r->state_counter = settings->first_state_counter;
    r->configured = (settings->link <= HRI_SERIAL) && (settings->robot < HRI_MAX_ROBOTS) &&
                    ((settings->link == HRI_SERIAL) || (settings->base_id <= highest)) &&
                    (settings->silence_timeout_ms > 0u) && (settings->max_age_ms > 0u);
    r->verdict = r->configured ? HRI_NO_SCHEMA : HRI_NOT_CONFIGURED;
    return r->configured;
}

uint16_t hri_permitted_speed(hri_receiver *r, uint32_t now_ms)
{
    uint16_t speed_mm_s = 0u;
    watch(r, now_ms);
    if (!r->configured) {
        r->verdict = HRI_NOT_CONFIGURED;
    } else if (r->schema_heard && !r->schema_matches) {
        r->verdict = HRI_OTHER_SCHEMA;
    } else if ((r->phase == SILENT) || (r->phase == FORGOTTEN)) {
        r->verdict = HRI_SILENT;
    } else if (!r->schema_matches) {
        r->verdict = HRI_NO_SCHEMA;
    } else if (r->phase != ADVISED) {
        r->verdict = HRI_STARTING;
    } else if (r->errors > r->settings.tolerated_errors) {
        r->verdict = HRI_ERRORS;
    } else if ((r->level < HRI_LEVEL_CLEAR) || (r->level > HRI_LEVEL_SLOW)) {
        r->verdict = HRI_BY_ADVICE; /* a stop is a stop at any age */
    } else if (!r->age_bounded) {
        r->verdict = HRI_NO_AGE;
    } else if ((r->age_at_receipt_ms + (now_ms - r->advised_ms)) >= r->settings.max_age_ms) {
        r->verdict = HRI_STALE;
    } else {
        r->verdict = HRI_BY_ADVICE;
        speed_mm_s = (r->speed_mm_s != HRI_NO_U16) ? r->speed_mm_s : 0u;
    }
    return speed_mm_s;
}

const char *hri_verdict_name(uint8_t verdict)
{
    static const char *const names[] = {"advice", "not configured", "starting", "silent",
                                        "no schema", "other schema", "errors", "no age", "stale"};
    return (verdict <= HRI_STALE) ? names[verdict] : "?";
}

/* -- what goes out ------------------------------------------------------------------------ */

/* Nearest step, saturated, in two's complement. */
static uint32_t steps(int32_t value, int32_t step, int32_t limit)
{
    int32_t count = value / step;
    int32_t rest = value % step;
    if ((2 * rest) >= step) {
        count++;
    } else if ((2 * rest) <= -step) {
        count--;
    } else {
        /* the nearest already */
    }
    count = (count > limit) ? limit : count;
    count = (count < -limit) ? -limit : count;
    return (uint32_t)((value == HRI_NO_I32) ? (-limit - 1) : count);
}

static void encode_state(uint8_t *p, const hri_robot_state *state, uint16_t counter)
{
    uint32_t seventh = 0x800800u; /* two 12-bit numbers, both not available */
    if (state->joints == HRI_MAX_JOINTS) {
        seventh = (steps(state->position_urad[6], 4000, 2047) & 0xFFFu) |
                  ((steps(state->velocity_urad_s[6], 10000, 2047) & 0xFFFu) << 12);
    }
    p[0] = (uint8_t)((state->mode & 15u) | ((uint32_t)state->joints << 4));
    put_u16(&p[1], counter);
    put_u16(&p[3], seventh);
    p[5] = (uint8_t)(seventh >> 16);
    for (uint32_t i = 0u; i < (HRI_MAX_JOINTS - 1u); i++) {
        bool used = (i < state->joints);
        put_u16(&p[6u + (2u * i)], used ? steps(state->position_urad[i], 250, 32767) : 0x8000u);
        put_u16(&p[18u + (2u * i)], used ? steps(state->velocity_urad_s[i], 1000, 32767) : 0x8000u);
    }
}

static void protect_serial(hri_unit *unit, uint32_t number, uint16_t sequence,
                           const uint8_t *payload, uint32_t length)
{
    uint8_t frame[HEADER_SERIAL + HRI_BYTES_ROBOT_STATE];
    uint32_t total = HEADER_SERIAL + length;
    uint32_t code = 0u; /* index of the length of the current block */
    uint32_t out = 1u;
    put_big_u32(frame, (total << 16) | sequence);
    put_big_u32(&frame[4], HRI_DATA_ID_32 + number);
    (void)memcpy(&frame[HEADER_SERIAL], payload, length);
    put_big_u32(&frame[8], crc_serial(frame, total));
    for (uint32_t i = 0u; i <= total; i++) { /* COBS, with a zero at the end */
        bool ends = (i == total) || (frame[i] == 0u);
        unit->data[out] = ends ? 0u : frame[i];
        if (ends) {
            unit->data[code] = (uint8_t)(out - code);
            code = out;
        }
        out++;
    }
    unit->length = (uint8_t)out;
}

/* Encode one message: several frames on classic CAN, else one. Return how many. */
static uint8_t protect(const hri_receiver *r, hri_unit *units, uint32_t number, uint16_t *sequence,
                       const uint8_t *payload, uint32_t length)
{
    static const uint8_t fd_lengths[] = {12u, 16u, 20u, 24u, 32u, HRI_UNIT_BYTES};
    uint8_t count = 1u;
    uint8_t size = 0u;
    if (r->settings.link == HRI_SERIAL) {
        units->id = 0u;
        protect_serial(units, number, *sequence, payload, length);
    } else if (r->settings.link == HRI_FD) {
        for (uint32_t i = 0u; size < (HEADER_FD + length); i++) {
            size = fd_lengths[i];
        }
        (void)memset(units->data, 0, sizeof units->data);
        (void)memcpy(&units->data[HEADER_FD], payload, length);
        units->data[2] = (uint8_t)(*sequence & MASK_CAN);
        put_u16(units->data, crc_fd(units->data, size, number));
        units->id = r->settings.base_id + number;
        units->length = size;
    } else {
        count = (uint8_t)(length / HRI_PART_BYTES);
        for (uint32_t part = 0u; part < count; part++) {
            uint8_t *data = units[part].data;
            (void)memcpy(&data[HEADER_CLASSIC], &payload[part * HRI_PART_BYTES], HRI_PART_BYTES);
            data[1] = (uint8_t)(*sequence & MASK_CAN);
            data[0] = crc_classic(data, number + part);
            units[part].id = r->settings.base_id + number + part;
            units[part].length = CLASSIC_BYTES;
        }
    }
    *sequence = (uint16_t)(*sequence + 1u);
    return count;
}

uint8_t hri_send_robot_state(hri_receiver *r, const hri_robot_state *state, uint32_t now_ms,
                             hri_unit units[HRI_PARTS_STATE])
{
    uint8_t payload[HRI_BYTES_ROBOT_STATE];
    uint32_t number = HRI_NUMBER_ROBOT_STATE + (HRI_ROBOT_STRIDE * r->settings.robot);
    if (!r->configured || (state->joints > HRI_MAX_JOINTS)) {
        return 0u;
    }
    watch(r, now_ms);
    r->state_counter = (uint16_t)(r->state_counter + 1u);
    r->sent_newest = (uint8_t)((r->sent_newest + 1u) % HRI_SENT_KEPT);
    r->sent_ms[r->sent_newest] = now_ms;
    r->sent_kept = (r->sent_kept < HRI_SENT_KEPT) ? (uint8_t)(r->sent_kept + 1u) : r->sent_kept;
    encode_state(payload, state, r->state_counter);
    return protect(r, units, number, &r->state_sequence, payload, sizeof payload);
}

uint8_t hri_acknowledge(hri_receiver *r, uint16_t latch_id, uint32_t ack_id, hri_unit *unit)
{
    uint8_t payload[HRI_BYTES_ACKNOWLEDGE];
    if (!r->configured) {
        return 0u;
    }
    put_u16(payload, latch_id);
    put_u16(&payload[2], ack_id & 0xFFFFu);
    put_u16(&payload[4], ack_id >> 16);
    return protect(r, unit, HRI_NUMBER_ACKNOWLEDGE, &r->ack_sequence, payload, sizeof payload);
}
