/* From a payload to a message. */
#include "hri_bytes.h"
#include "hri_internal.h"

/* A value of an enumeration; a value that this code does not know is the fallback. */
static uint8_t known(uint32_t value, uint32_t last, uint32_t fallback)
{
    return (uint8_t)((value <= last) ? value : fallback);
}

/* generated: begin decoding (renew: hri-predict protocol files) */
static bool decode_advice(hri_advice *m, const uint8_t *p, uint32_t length)
{
    if (length < HRI_BYTES_ADVICE) {
        return false;
    }
    m->level = known((uint8_t)(p[0] & 15u),
        HRI_LEVEL_FAULT, HRI_LEVEL_UNKNOWN);
    m->operating_mode = known((uint8_t)(p[0] >> 4),
        HRI_OPERATING_MODE_MUTED, HRI_OPERATING_MODE_AUTOMATIC);
    m->reason = p[1];
    m->speed_limit_mm_s = get_u16(&p[2]);
    m->separation_mm = get_i16(&p[4]);
    m->predicted_separation_mm = get_i16(&p[6]);
    m->echo = get_u16(&p[8]);
    m->age_ms = get_u16(&p[10]);
    m->latch_id = get_u16(&p[12]);
    m->tool = p[14];
    m->time_to_breach_ms = (uint16_t)get_bits(p, 120u, 12u);
    m->body_part = (uint8_t)get_bits(p, 132u, 6u);
    m->robot_link = (uint8_t)(p[17] >> 2);
    return true;
}

static bool decode_status(hri_status *m, const uint8_t *p, uint32_t length)
{
    if (length < HRI_BYTES_STATUS) {
        return false;
    }
    m->node_state = known((uint8_t)(p[0] & 15u),
        HRI_NODE_STATE_STOPPING, HRI_NODE_STATE_UNKNOWN);
    m->people = (uint8_t)(p[0] >> 4);
    m->reason = p[1];
    m->predictor = p[2];
    m->cycle = p[3];
    m->age_ms = get_u16(&p[4]);
    return true;
}

static bool decode_schema(hri_schema *m, const uint8_t *p, uint32_t length)
{
    if (length < HRI_BYTES_SCHEMA) {
        return false;
    }
    m->version = get_u16(&p[0]);
    m->hash = get_u32(&p[2]);
    return true;
}

static bool decode_body(hri_body *m, const uint8_t *p, uint32_t length,
                        uint32_t room, uint32_t item_bytes)
{
    if (length < HRI_BYTES_ZONE) {
        return false;
    }
    m->person = get_u16(&p[0]);
    m->step = p[2];
    m->horizon_ms = get_u16(&p[3]);
    m->age_ms = get_u16(&p[5]);
    m->first = p[7];
    m->total = p[8];
    m->count = p[9];
    return (m->horizon_ms != HRI_NO_U16) &&
           (m->count <= room) &&
           (((uint32_t)m->first + m->count) <= m->total) &&
           (length >= (HRI_BYTES_ZONE + (m->count * item_bytes)));
}

static bool decode_capsule(hri_capsule *m, const uint8_t *p)
{
    m->segment = p[0];
    m->a_mm[0] = get_i16(&p[1]);
    m->a_mm[1] = get_i16(&p[3]);
    m->a_mm[2] = get_i16(&p[5]);
    m->b_mm[0] = get_i16(&p[7]);
    m->b_mm[1] = get_i16(&p[9]);
    m->b_mm[2] = get_i16(&p[11]);
    m->radius_mm = get_u16(&p[13]);
    return (m->a_mm[0] != HRI_NO_I16) &&
           (m->a_mm[1] != HRI_NO_I16) &&
           (m->a_mm[2] != HRI_NO_I16) &&
           (m->b_mm[0] != HRI_NO_I16) &&
           (m->b_mm[1] != HRI_NO_I16) &&
           (m->b_mm[2] != HRI_NO_I16) &&
           (m->radius_mm != HRI_NO_U16);
}

static bool decode_zone(hri_body *m, const uint8_t *p, uint32_t length)
{
    bool valid = decode_body(m, p, length, HRI_ZONE_ITEMS, HRI_ITEM_BYTES_ZONE);
    for (uint32_t i = 0u; valid && (i < m->count); i++) {
        valid = decode_capsule(&m->capsules[i], &p[HRI_BYTES_ZONE + (i * HRI_ITEM_BYTES_ZONE)]);
    }
    return valid;
}

static bool decode_joint(hri_joint *m, const uint8_t *p)
{
    m->joint = p[0];
    m->position_mm[0] = get_i16(&p[1]);
    m->position_mm[1] = get_i16(&p[3]);
    m->position_mm[2] = get_i16(&p[5]);
    return (m->position_mm[0] != HRI_NO_I16) &&
           (m->position_mm[1] != HRI_NO_I16) &&
           (m->position_mm[2] != HRI_NO_I16);
}

static bool decode_pose(hri_body *m, const uint8_t *p, uint32_t length)
{
    bool valid = decode_body(m, p, length, HRI_POSE_ITEMS, HRI_ITEM_BYTES_POSE);
    for (uint32_t i = 0u; valid && (i < m->count); i++) {
        valid = decode_joint(&m->joints[i], &p[HRI_BYTES_POSE + (i * HRI_ITEM_BYTES_POSE)]);
    }
    return valid;
}

/* Decode into the newest message of its kind; refuse impossible values and change nothing. */
bool hri_lib_decode(hri_message *message, uint8_t kind, const uint8_t *p, uint32_t length)
{
    hri_message next = *message;
    bool valid = false;
    switch (kind) {
    case HRI_ADVICE:
        valid = decode_advice(&next.advice, p, length);
        break;
    case HRI_STATUS:
        valid = decode_status(&next.status, p, length);
        break;
    case HRI_SCHEMA:
        valid = decode_schema(&next.schema, p, length);
        break;
    case HRI_ZONE:
        valid = decode_zone(&next.body, p, length);
        break;
    case HRI_POSE:
        valid = decode_pose(&next.body, p, length);
        break;
    default:
        break; /* HRI_NOTHING */
    }
    if (valid) {
        *message = next;
    }
    return valid;
}
/* generated: end */

/* generated: begin numbers (renew: hri-predict protocol files) */
/* Kind of the frame with this number; HRI_NOTHING if it belongs to another robot or sender. */
uint8_t hri_lib_kind(uint32_t number, uint32_t robot, bool wide)
{
    uint8_t kind = HRI_NOTHING;
    if ((number - (HRI_NUMBER_ADVICE + (HRI_ROBOT_STRIDE * robot))) <
        (wide ? 1u : HRI_PARTS_ADVICE)) {
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
        /* not for us */
    }
    return kind;
}
/* generated: end */
