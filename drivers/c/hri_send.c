/* What the controller says: RobotState and Acknowledge, encoded and protected. */
#include "hri_bytes.h"
#include "hri_internal.h"

#include <string.h>

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
    put_big_u32(&frame[8], hri_lib_crc_serial(frame, total));
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
        put_u16(units->data, hri_lib_crc_fd(units->data, size, number));
        units->id = r->settings.base_id + number;
        units->length = size;
    } else {
        count = (uint8_t)(length / HRI_PART_BYTES);
        for (uint32_t part = 0u; part < count; part++) {
            uint8_t *data = units[part].data;
            (void)memcpy(&data[HEADER_CLASSIC], &payload[part * HRI_PART_BYTES], HRI_PART_BYTES);
            data[1] = (uint8_t)(*sequence & MASK_CAN);
            data[0] = hri_lib_crc_classic(data, number + part);
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
    hri_lib_watch(r, now_ms);
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
