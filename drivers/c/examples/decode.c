/* Decodes recorded frames, one line of output per line of standard input.
 *
 *   decode classic|fd|serial FIRST_ROBOT LAST_ROBOT [BASE_ID [29]]
 *
 * A line is "ID BYTES" for CAN, "BYTES" for serial, both in hexadecimal without spaces between the
 * bytes. It prints each complete and fresh message with its raw values under the names of
 * PROTOCOL.md, several on one line separated by ";"; "-" means none. The last line has the counts
 * of the first robot's receiver.
 */
#include "../hri_predict.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LINE_BYTES 4096

static void print_body(uint8_t kind, const hri_body *m)
{
    printf(" PERSON=%u STEP=%u HORIZON=%u AGE=%u FIRST=%u TOTAL=%u COUNT=%u", m->person, m->step,
           m->horizon_ms, m->age_ms, m->first, m->total, m->count);
    for (unsigned i = 0; i < m->count; i++) {
        if (kind == HRI_ZONE) {
            const hri_capsule *c = &m->capsules[i];
            printf(" SEGMENT_%u=%u A_X_%u=%d A_Y_%u=%d A_Z_%u=%d", i, c->segment, i, c->a_mm[0], i,
                   c->a_mm[1], i, c->a_mm[2]);
            printf(" B_X_%u=%d B_Y_%u=%d B_Z_%u=%d RADIUS_%u=%u", i, c->b_mm[0], i, c->b_mm[1], i,
                   c->b_mm[2], i, c->radius_mm);
        } else {
            const hri_joint *j = &m->joints[i];
            printf(" JOINT_%u=%u X_%u=%d Y_%u=%d Z_%u=%d", i, j->joint, i, j->position_mm[0], i,
                   j->position_mm[1], i, j->position_mm[2]);
        }
    }
}

static void print_message(uint8_t kind, unsigned robot, const hri_message *message)
{
    static const char *const names[] = {"", "Advice", "Status", "Schema", "Zone", "Pose"};
    const hri_advice *a = &message->advice;
    const hri_status *s = &message->status;
    printf("%s", names[kind]);
    if (kind == HRI_ADVICE) {
        printf(" ROBOT=%u LEVEL=%u REASON=%u SPEED_LIMIT=%u SEPARATION=%d", robot, a->level,
               a->reason, a->speed_limit_mm_s, a->separation_mm);
        printf(" PREDICTED_SEPARATION=%d TIME_TO_BREACH=%u AGE=%u", a->predicted_separation_mm,
               a->time_to_breach_ms, a->age_ms);
        printf(" LATCH_ID=%u ECHO=%u BODY_PART=%u ROBOT_LINK=%u", a->latch_id, a->echo,
               a->body_part, a->robot_link);
        printf(" OPERATING_MODE=%u TOOL=%u", a->operating_mode, a->tool);
    } else if (kind == HRI_STATUS) {
        printf(" NODE_STATE=%u PEOPLE=%u REASON=%u PREDICTOR=%u CYCLE=%u AGE=%u", s->node_state,
               s->people, s->reason, s->predictor, s->cycle, s->age_ms);
    } else if (kind == HRI_SCHEMA) {
        printf(" SCHEMA_VERSION=%u SCHEMA_HASH=%lu", message->schema.version,
               (unsigned long)message->schema.hash);
    } else {
        print_body(kind, &message->body);
    }
}

/* Bytes of a hexadecimal text; stops at the first other character. */
static unsigned parse(const char *text, uint8_t *bytes, unsigned room)
{
    unsigned length = 0;
    unsigned value;
    while (length < room && sscanf(text + 2 * length, "%2x", &value) == 1) {
        bytes[length++] = (uint8_t)value;
    }
    return length;
}

int main(int argc, char **argv)
{
    static hri_receiver receivers[HRI_MAX_ROBOTS];
    static char line[2 * LINE_BYTES + 32];
    static uint8_t data[LINE_BYTES];
    hri_settings settings = {.base_id = HRI_DEFAULT_BASE_ID,
                             .silence_timeout_ms = 60,
                             .max_age_ms = 400};
    unsigned first = argc > 3 ? (unsigned)atoi(argv[2]) : HRI_MAX_ROBOTS;
    unsigned last = argc > 3 ? (unsigned)atoi(argv[3]) : 0;
    if (first > last || last >= HRI_MAX_ROBOTS) {
        fprintf(stderr, "usage: decode classic|fd|serial FIRST_ROBOT LAST_ROBOT [BASE_ID [29]]\n");
        return 2;
    }
    settings.link = strcmp(argv[1], "serial") == 0 ? HRI_SERIAL
                    : strcmp(argv[1], "fd") == 0   ? HRI_FD
                                                   : HRI_CLASSIC;
    settings.base_id = argc > 4 ? (uint32_t)strtoul(argv[4], NULL, 16) : settings.base_id;
    settings.extended = argc > 5;
    for (unsigned robot = first; robot <= last; robot++) {
        settings.robot = (uint8_t)robot;
        if (!hri_init(&receivers[robot], &settings)) {
            fprintf(stderr, "decode: no such base id\n");
            return 2;
        }
    }
    while (fgets(line, sizeof line, stdin) != NULL) {
        const char *separator = "";
        char *rest = line;
        uint32_t id = settings.link == HRI_SERIAL ? 0 : (uint32_t)strtoul(line, &rest, 16);
        unsigned units, length;
        while (*rest == ' ') {
            rest++;
        }
        length = parse(rest, data, sizeof data);
        units = settings.link == HRI_SERIAL ? length : 1;
        for (unsigned i = 0; i < units; i++) {
            for (unsigned robot = first; robot <= last; robot++) {
                hri_receiver *r = &receivers[robot];
                uint8_t kind = settings.link == HRI_SERIAL
                                   ? hri_receive_serial_byte(r, data[i], 0)
                                   : hri_receive_can(r, id, settings.extended,
                                                     settings.link == HRI_FD, data,
                                                     (uint8_t)(length > 255 ? 255 : length), 0);
                if (kind == HRI_ADVICE || (kind != HRI_NOTHING && robot == first)) {
                    printf("%s", separator);
                    print_message(kind, robot, &r->message);
                    separator = "; ";
                }
            }
        }
        printf("%s\n", separator[0] == '\0' ? "-" : "");
    }
    printf("counts received=%lu crc_errors=%lu counter_errors=%lu malformed=%lu incomplete=%lu\n",
           (unsigned long)receivers[first].counts.received,
           (unsigned long)receivers[first].counts.crc_errors,
           (unsigned long)receivers[first].counts.counter_errors,
           (unsigned long)receivers[first].counts.malformed,
           (unsigned long)receivers[first].counts.incomplete);
    return 0;
}
