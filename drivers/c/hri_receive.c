/* From the wire to a payload: frames of CAN, and bytes of a serial line. */
#include "hri_bytes.h"
#include "hri_internal.h"

#include <string.h>

#define FD_BYTES 64u
#define ALL_PARTS ((1u << HRI_PARTS_ADVICE) - 1u)
#define NO_COBS 0xFFFFFFFFu

static uint8_t kind_of(const hri_receiver *r, uint32_t number)
{
    return hri_lib_kind(number, r->settings.robot, r->settings.link != HRI_CLASSIC);
}

static uint8_t take_classic(hri_receiver *r, uint8_t kind, uint32_t number, const uint8_t *data,
                            uint32_t now_ms)
{
    uint32_t part = number % HRI_ROBOT_STRIDE;
    uint32_t bit = 1u << part;
    if (hri_lib_crc_classic(data, number) != data[0]) {
        r->counts.crc_errors++;
        return HRI_NOTHING;
    }
    if (kind != HRI_ADVICE) {
        return hri_lib_accept(r, kind, data[1], &data[HEADER_CLASSIC], HRI_PART_BYTES, now_ms);
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
               : hri_lib_accept(r, HRI_ADVICE, data[1], r->parts, HRI_BYTES_ADVICE, now_ms);
}

static uint8_t take_fd(hri_receiver *r, uint8_t kind, uint32_t number, const uint8_t *data,
                       uint32_t length, uint32_t now_ms)
{
    if ((length < HEADER_FD) || (hri_lib_crc_fd(data, length, number) != get_u16(data))) {
        r->counts.crc_errors++;
        return HRI_NOTHING;
    }
    return hri_lib_accept(r, kind, data[2], &data[HEADER_FD], length - HEADER_FD, now_ms);
}

uint8_t hri_receive_can(hri_receiver *r, uint32_t id, bool extended, bool fd, const uint8_t *data,
                        uint8_t length, uint32_t now_ms)
{
    uint32_t before = hri_lib_error_count(&r->counts);
    uint32_t number = id - r->settings.base_id;
    uint8_t kind = kind_of(r, number);
    uint8_t completed = HRI_NOTHING;
    hri_lib_watch(r, now_ms);
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
    hri_lib_note_errors(r, before, now_ms);
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
        (hri_lib_crc_serial(frame, length) != get_big_u32(&frame[8]))) {
        r->counts.crc_errors++;
        return HRI_NOTHING;
    }
    kind = kind_of(r, get_big_u32(&frame[4]) - HRI_DATA_ID_32);
    if (kind == HRI_NOTHING) {
        r->counts.ignored++;
        return HRI_NOTHING;
    }
    return hri_lib_accept(r, kind, (uint16_t)(get_big_u32(frame) & 0xFFFFu), &frame[HEADER_SERIAL],
                          length - HEADER_SERIAL, now_ms);
}

uint8_t hri_receive_serial_byte(hri_receiver *r, uint8_t byte, uint32_t now_ms)
{
    uint32_t before = hri_lib_error_count(&r->counts);
    uint8_t completed = HRI_NOTHING;
    hri_lib_watch(r, now_ms);
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
    hri_lib_note_errors(r, before, now_ms);
    return completed;
}
