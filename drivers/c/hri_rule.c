/* The receiver's rule: which messages count, how old their data are, and how fast the robot may
 * move. */
#include "hri_internal.h"

#include <string.h>

#define STARTING 0u /* hri_receiver.phase */
#define ADVISED 1u
#define SILENT 2u

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
uint8_t hri_lib_accept(hri_receiver *r, uint8_t kind, uint16_t counter, const uint8_t *payload,
                       uint32_t length, uint32_t now_ms)
{
    uint32_t mask = (r->settings.link == HRI_SERIAL) ? MASK_SERIAL : MASK_CAN;
    if ((kind != HRI_SCHEMA) && !fresh(&r->sequences[kind], &r->counts, counter, mask)) {
        return HRI_NOTHING;
    }
    if (!hri_lib_decode(&r->message, kind, payload, length)) {
        r->counts.malformed++;
        return HRI_NOTHING;
    }
    r->counts.received++;
    if ((kind == HRI_SCHEMA) || (kind == HRI_ADVICE)) {
        r->heard_ms = now_ms;
    }
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
void hri_lib_watch(hri_receiver *r, uint32_t now_ms)
{
    uint32_t keep_ms = (uint32_t)r->settings.max_age_ms + r->settings.silence_timeout_ms;
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
    if ((r->phase == ADVISED) && ((now_ms - r->advised_ms) >= r->settings.silence_timeout_ms)) {
        r->phase = SILENT;
    }
    if (r->schema_heard && (r->phase != ADVISED) && ((now_ms - r->heard_ms) >= HRI_FORGET_MS)) {
        r->schema_heard = false;
        r->schema_matches = false;
        r->part_started = false;
        r->sent_kept = 0u; /* a tick set back also leads here: old times are void */
        (void)memset(r->sequences, 0, sizeof r->sequences);
    }
}

uint32_t hri_lib_error_count(const hri_counts *c)
{
    return c->crc_errors + c->counter_errors + c->malformed + c->incomplete;
}

void hri_lib_note_errors(hri_receiver *r, uint32_t before, uint32_t now_ms)
{
    uint32_t more = hri_lib_error_count(&r->counts) - before;
    if (more > 0u) {
        r->errors += more;
        r->error_ms = now_ms;
    }
}

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
    hri_lib_watch(r, now_ms);
    if (!r->configured) {
        r->verdict = HRI_NOT_CONFIGURED;
    } else if (r->schema_heard && !r->schema_matches) {
        r->verdict = HRI_OTHER_SCHEMA;
    } else if (r->phase == SILENT) {
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
