/* From a payload to a message. */
#include "hri_bytes.h"
#include "hri_internal.h"

#define ZONE_ITEM_BYTES 15u
#define POSE_ITEM_BYTES 7u

static void decode_advice(hri_advice *m, const uint8_t *p)
{
    uint32_t rest = get_u16(&p[15]) | ((uint32_t)p[17] << 16);
    uint8_t level = p[0] & 15u;
    uint8_t mode = p[0] >> 4;
    m->level = (level <= HRI_LEVEL_FAULT) ? level : (uint8_t)HRI_LEVEL_UNKNOWN;
    m->operating_mode =
        (mode <= HRI_OPERATING_MODE_MUTED) ? mode : (uint8_t)HRI_OPERATING_MODE_AUTOMATIC;
    m->reason = p[1];
    m->speed_limit_mm_s = get_u16(&p[2]);
    m->separation_mm = get_i16(&p[4]);
    m->predicted_separation_mm = get_i16(&p[6]);
    m->echo = get_u16(&p[8]);
    m->age_ms = get_u16(&p[10]);
    m->latch_id = get_u16(&p[12]);
    m->tool = p[14];
    m->time_to_breach_ms = (uint16_t)(rest & 0xFFFu);
    m->body_part = (uint8_t)((rest >> 12) & 0x3Fu);
    m->robot_link = (uint8_t)(rest >> 18);
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
bool hri_lib_decode(hri_message *message, uint8_t kind, const uint8_t *p, uint32_t length)
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
