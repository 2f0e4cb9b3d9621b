/* What the controller says: RobotState and Acknowledge, encoded and protected. */
#include "hri_bytes.h"
#include "hri_internal.h"

#include <string.h>

#define ALWAYS_JOINTS 6u      /* joints whose place is in the parts that every RobotState has */
#define JOINTS_AT 6u          /* bytes of the payload before them */
#define MORE_AT 30u           /* before the seventh joint */
#define BASE_AT 42u           /* before the base */
#define STEP_POSITION 250     /* microradians or micrometres */
#define STEP_VELOCITY 1000
#define STEP_BASE 1000        /* micrometres, micrometres and microradians per second */
#define STEP_YAW 100          /* microradians */
#define FULL_TURN_URAD 6283185
#define HALF_TURN_URAD 3141593

/* Nearest step, saturated, in two's complement. */
static uint32_t steps(int32_t value, int32_t step)
{
    const int32_t limit = 32767;
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

/* The same; not available beyond the range, whose end would be another place. */
static uint32_t place(int32_t value, int32_t step)
{
    int32_t beyond = 32768 * step;
    return ((value < beyond) && (value > -beyond)) ? steps(value, step) : 0x8000u;
}

static uint32_t turn(int32_t yaw_urad)
{
    int32_t rest = yaw_urad % FULL_TURN_URAD;
    if (yaw_urad == HRI_NO_I32) {
        return 0x8000u;
    }
    rest = (rest > HALF_TURN_URAD) ? (rest - FULL_TURN_URAD) : rest;
    rest = (rest < -HALF_TURN_URAD) ? (rest + FULL_TURN_URAD) : rest;
    return steps(rest, STEP_YAW);
}

static void encode_base(uint8_t *p, const hri_robot_state *state)
{
    put_u16(&p[0], state->base_moves ? place(state->base_um[0], STEP_BASE) : 0x8000u);
    put_u16(&p[2], state->base_moves ? place(state->base_um[1], STEP_BASE) : 0x8000u);
    put_u16(&p[4], state->base_moves ? turn(state->base_yaw_urad) : 0x8000u);
    put_u16(&p[6], state->base_moves ? steps(state->base_um_s[0], STEP_BASE) : 0x8000u);
    put_u16(&p[8], state->base_moves ? steps(state->base_um_s[1], STEP_BASE) : 0x8000u);
    put_u16(&p[10], state->base_moves ? steps(state->base_yaw_urad_s, STEP_BASE) : 0x8000u);
}

static void encode_state(uint8_t *p, const hri_robot_state *state, uint16_t counter)
{
    p[0] = (uint8_t)((state->mode & 15u) | ((uint32_t)state->joints << 4));
    put_u16(&p[1], counter);
    p[3] = state->request;
    p[4] = state->tool;
    p[5] = (uint8_t)((state->enabling ? 1u : 0u) | (state->tool_confirmed ? 4u : 0u) |
                     (state->base_moves ? 16u : 0u));
    for (uint32_t i = 0u; i < HRI_MAX_JOINTS; i++) {
        bool used = (i < state->joints);
        uint32_t position = used ? place(state->position_urad[i], STEP_POSITION) : 0x8000u;
        uint32_t velocity = used ? steps(state->velocity_urad_s[i], STEP_VELOCITY) : 0x8000u;
        if (i < ALWAYS_JOINTS) {
            put_u16(&p[JOINTS_AT + (2u * i)], position);
            put_u16(&p[JOINTS_AT + (2u * (ALWAYS_JOINTS + i))], velocity);
        } else {
            put_u16(&p[MORE_AT + (4u * (i - ALWAYS_JOINTS))], position);
            put_u16(&p[MORE_AT + 2u + (4u * (i - ALWAYS_JOINTS))], velocity);
        }
    }
    encode_base(&p[BASE_AT], state);
}

/* Which parts this state needs: bit p for part p. */
static uint32_t needed_parts(const hri_robot_state *state)
{
    uint32_t needed = (1u << HRI_PARTS_STATE_ALWAYS) - 1u;
    needed |= (state->joints >= 7u) ? (1u << 5) : 0u;
    needed |= (state->joints >= 8u) ? (1u << 6) : 0u;
    needed |= state->base_moves ? ((1u << 7) | (1u << 8)) : 0u;
    return needed;
}

/* Number of the frame of a part on classic CAN, after that of part 0. */
static uint32_t number_of(const hri_receiver *r, uint32_t first, uint32_t part)
{
    static const uint32_t extra[] = {HRI_NUMBER_STATE_PART_5, HRI_NUMBER_STATE_PART_6,
                                     HRI_NUMBER_STATE_PART_7, HRI_NUMBER_STATE_PART_8};
    return (part < HRI_PARTS_STATE_ALWAYS)
               ? (first + part)
               : (extra[part - HRI_PARTS_STATE_ALWAYS] + (HRI_EXTRA_STRIDE * r->settings.robot));
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

/* Encode one message: the frames of the needed parts on classic CAN, else one. Return how many. */
static uint8_t protect(const hri_receiver *r, hri_unit *units, uint32_t number, uint16_t *sequence,
                       const uint8_t *payload, uint32_t length, uint32_t needed)
{
    static const uint8_t fd_lengths[] = {12u, 16u, 20u, 24u, 32u, 48u, 64u};
    uint32_t parts = length / HRI_PART_BYTES;
    uint8_t count = 1u;
    uint8_t size = 0u;
    if (r->settings.link == HRI_SERIAL) {
        while ((needed >> (parts - 1u)) == 0u) { /* it ends after the last part that it needs */
            parts--;
        }
        units->id = 0u;
        protect_serial(units, number, *sequence, payload, HRI_PART_BYTES * parts);
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
        count = 0u;
        for (uint32_t part = 0u; part < parts; part++) {
            uint8_t *data = units[count].data;
            uint32_t own = number_of(r, number, part);
            if (((needed >> part) & 1u) == 0u) {
                continue;
            }
            (void)memcpy(&data[HEADER_CLASSIC], &payload[part * HRI_PART_BYTES], HRI_PART_BYTES);
            data[1] = (uint8_t)(*sequence & MASK_CAN);
            data[0] = hri_lib_crc_classic(data, own);
            units[count].id = r->settings.base_id + own;
            units[count].length = CLASSIC_BYTES;
            count++;
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
    bool carried = !state->base_moves || (r->settings.link != HRI_CLASSIC) ||
                   (r->settings.robot < HRI_BASE_ROBOTS);
    if (!r->configured || !carried || (state->joints > HRI_MAX_JOINTS)) {
        return 0u;
    }
    hri_lib_watch(r, now_ms);
    r->state_counter = (uint16_t)(r->state_counter + 1u);
    r->sent_newest = (uint8_t)((r->sent_newest + 1u) % HRI_SENT_KEPT);
    r->sent_ms[r->sent_newest] = now_ms;
    r->sent_kept = (r->sent_kept < HRI_SENT_KEPT) ? (uint8_t)(r->sent_kept + 1u) : r->sent_kept;
    encode_state(payload, state, r->state_counter);
    return protect(r, units, number, &r->state_sequence, payload, sizeof payload,
                   needed_parts(state));
}

static uint8_t edge(hri_receiver *r, uint16_t latch_id, uint32_t ack_id, hri_unit *unit)
{
    uint8_t payload[HRI_BYTES_ACKNOWLEDGE];
    put_u16(payload, latch_id);
    put_u16(&payload[2], ack_id & 0xFFFFu);
    put_u16(&payload[4], ack_id >> 16);
    return protect(r, unit, HRI_NUMBER_ACKNOWLEDGE, &r->ack_sequence, payload, sizeof payload,
                   1u);
}

uint8_t hri_acknowledge(hri_receiver *r, uint16_t latch_id, uint32_t ack_id, hri_unit *unit)
{
    return (r->configured && (latch_id != 0u)) ? edge(r, latch_id, ack_id, unit) : 0u;
}

uint8_t hri_released(hri_receiver *r, uint32_t ack_id, hri_unit *unit)
{
    return (r->configured && (ack_id != 0u)) ? edge(r, 0u, ack_id, unit) : 0u;
}
