/* Decodes recorded frames, one line of output per line of standard input.
 *
 *   decode classic|fd|serial FIRST_ROBOT LAST_ROBOT [BASE_ID [29]]
 *
 * A line is "ID BYTES" for CAN, "BYTES" for serial, both in hexadecimal without spaces between the
 * bytes. For CAN it may also be one of a log of candump -l or python-can,
 * "(TIME) INTERFACE ID#BYTES", or with a digit of flags for CAN FD, "(TIME) INTERFACE ID##FBYTES".
 * Standard error names lines that cannot be read.
 * It prints each complete and fresh message with its raw values under the names of
 * PROTOCOL.md, several on one line separated by ";"; "-" means none. The last line has the counts
 * of the first robot's receiver.
 */
#include "../hri_predict.h"

#include <ctype.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LINE_BYTES 4096

/* generated: begin printing (renew: hri-predict protocol files) */
static void print_message(uint8_t kind, unsigned robot, const hri_message *message)
{
    switch (kind) {
    case HRI_ADVICE:
        printf("Advice");
        printf(" ROBOT=%u", robot);
        printf(" LEVEL=%u", message->advice.level);
        printf(" OPERATING_MODE=%u", message->advice.operating_mode);
        printf(" REASON=%u", message->advice.reason);
        printf(" SPEED_LIMIT=%u", message->advice.speed_limit_mm_s);
        printf(" SEPARATION=%d", message->advice.separation_mm);
        printf(" PREDICTED_SEPARATION=%d", message->advice.predicted_separation_mm);
        printf(" ECHO=%u", message->advice.echo);
        printf(" AGE=%u", message->advice.age_ms);
        printf(" LATCH_ID=%u", message->advice.latch_id);
        printf(" TOOL=%u", message->advice.tool);
        printf(" TIME_TO_BREACH=%u", message->advice.time_to_breach_ms);
        printf(" BODY_PART=%u", message->advice.body_part);
        printf(" ROBOT_LINK=%u", message->advice.robot_link);
        break;
    case HRI_STATUS:
        printf("Status");
        printf(" NODE_STATE=%u", message->status.node_state);
        printf(" PEOPLE=%u", message->status.people);
        printf(" REASON=%u", message->status.reason);
        printf(" PREDICTOR=%u", message->status.predictor);
        printf(" CYCLE=%u", message->status.cycle);
        printf(" AGE=%u", message->status.age_ms);
        break;
    case HRI_SCHEMA:
        printf("Schema");
        printf(" SCHEMA_VERSION=%u", message->schema.version);
        printf(" SCHEMA_HASH=%lu", (unsigned long)message->schema.hash);
        break;
    case HRI_ZONE:
        printf("Zone");
        printf(" PERSON=%u", message->body.person);
        printf(" STEP=%u", message->body.step);
        printf(" HORIZON=%u", message->body.horizon_ms);
        printf(" AGE=%u", message->body.age_ms);
        printf(" FIRST=%u", message->body.first);
        printf(" TOTAL=%u", message->body.total);
        printf(" COUNT=%u", message->body.count);
        for (unsigned i = 0; i < message->body.count; i++) {
            printf(" SEGMENT_%u=%u", i, message->body.capsules[i].segment);
            printf(" A_X_%u=%d", i, message->body.capsules[i].a_mm[0]);
            printf(" A_Y_%u=%d", i, message->body.capsules[i].a_mm[1]);
            printf(" A_Z_%u=%d", i, message->body.capsules[i].a_mm[2]);
            printf(" B_X_%u=%d", i, message->body.capsules[i].b_mm[0]);
            printf(" B_Y_%u=%d", i, message->body.capsules[i].b_mm[1]);
            printf(" B_Z_%u=%d", i, message->body.capsules[i].b_mm[2]);
            printf(" RADIUS_%u=%u", i, message->body.capsules[i].radius_mm);
        }
        break;
    case HRI_POSE:
        printf("Pose");
        printf(" PERSON=%u", message->body.person);
        printf(" STEP=%u", message->body.step);
        printf(" HORIZON=%u", message->body.horizon_ms);
        printf(" AGE=%u", message->body.age_ms);
        printf(" FIRST=%u", message->body.first);
        printf(" TOTAL=%u", message->body.total);
        printf(" COUNT=%u", message->body.count);
        for (unsigned i = 0; i < message->body.count; i++) {
            printf(" JOINT_%u=%u", i, message->body.joints[i].joint);
            printf(" X_%u=%d", i, message->body.joints[i].position_mm[0]);
            printf(" Y_%u=%d", i, message->body.joints[i].position_mm[1]);
            printf(" Z_%u=%d", i, message->body.joints[i].position_mm[2]);
        }
        break;
    default:
        break;
    }
}
/* generated: end */

/* Bytes of a hexadecimal text; false if more follows them than python-can's R or T of a log. */
static bool parse(const char *text, uint8_t *bytes, unsigned room, unsigned *length)
{
    unsigned value;
    *length = 0;
    while (*length < room && isxdigit((unsigned char)text[0]) &&
           isxdigit((unsigned char)text[1]) && sscanf(text, "%2x", &value) == 1) {
        bytes[(*length)++] = (uint8_t)value;
        text += 2;
    }
    text += text[0] == ' ' && (text[1] == 'R' || text[1] == 'T') ? 2 : 0;
    return text[strspn(text, " \r\n")] == '\0';
}

/* Read the id of a CAN line. Return the start of its bytes, or NULL without an id. */
static const char *parse_id(const char *line, uint32_t *id)
{
    char *rest;
    bool is_log = line[0] == '(';
    if (is_log) { /* "(TIME) INTERFACE ID#BYTES" */
        int start = 0;
        (void)sscanf(line, "(%*[^)]) %*s %n", &start);
        line += start;
    }
    *id = (uint32_t)strtoul(line, &rest, 16);
    if (rest == line || (is_log && *rest != '#')) {
        return NULL;
    }
    if (rest[0] == '#') {
        rest += rest[1] == '#' && rest[2] != '\0' ? 3 : 1; /* CAN FD: a digit of flags */
    }
    return rest + strspn(rest, " ");
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
    for (unsigned long number = 1; fgets(line, sizeof line, stdin) != NULL; number++) {
        const char *separator = "";
        uint32_t id = 0;
        const char *rest = settings.link == HRI_SERIAL ? line : parse_id(line, &id);
        unsigned units, length = 0;
        if (rest == NULL || !parse(rest, data, sizeof data, &length)) {
            fprintf(stderr, "decode: line %lu cannot be read; give %s in hexadecimal\n", number,
                    settings.link == HRI_SERIAL ? "BYTES"
                                                : "ID BYTES, or (TIME) INTERFACE ID#BYTES,");
            printf("-\n");
            continue;
        }
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
