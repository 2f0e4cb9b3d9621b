/* Drives one receiver by the lines of standard input, for the tests.
 *
 *   init LINK ROBOT BASE_ID EXTENDED SILENCE MAX_AGE TOLERATED WINDOW FIRST_COUNTER   prints 1 or 0
 *   at MS                    the tick from now on
 *   rx ID BYTES              takes a CAN frame (a serial line: ID is ignored)
 *   state MODE JOINTS P... V... [REQUEST ENABLING TOOL CONFIRMED MOVES X Y YAW VX VY YAW_RATE]
 *                                   prints the units, "ID:BYTES ..."
 *   ack LATCH_ID ACK_ID             prints the unit
 *   mode                     prints the operating mode in force, "mode:M"
 *   ask                      prints the permitted speed, the verdict, and the counts of errors
 */
#include "hri_predict.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static hri_receiver r;
static uint32_t now;

static long number(void)
{
    const char *word = strtok(NULL, " \n");
    return word == NULL ? 0 : strtol(word, NULL, 0);
}

static void init(void)
{
    hri_settings s = {0};
    s.link = (uint8_t)number();
    s.robot = (uint8_t)number();
    s.base_id = (uint32_t)number();
    s.extended = number() != 0;
    s.silence_timeout_ms = (uint16_t)number();
    s.max_age_ms = (uint16_t)number();
    s.tolerated_errors = (uint16_t)number();
    s.error_window_ms = (uint16_t)number();
    s.first_state_counter = (uint16_t)number();
    printf("%d\n", hri_init(&r, &s));
}

static void receive(void)
{
    uint32_t id = (uint32_t)number();
    const char *text = strtok(NULL, " \n");
    uint8_t data[256];
    unsigned length = 0, value;
    while (text != NULL && length < 255 && sscanf(text + 2 * length, "%2x", &value) == 1) {
        data[length++] = (uint8_t)value;
    }
    if (r.settings.link == HRI_SERIAL) {
        for (unsigned i = 0; i < length; i++) {
            hri_receive_serial_byte(&r, data[i], now);
        }
    } else {
        hri_receive_can(&r, id, r.settings.extended, r.settings.link == HRI_FD, data,
                        (uint8_t)length, now);
    }
}

static void print_units(const hri_unit *units, unsigned count)
{
    for (unsigned i = 0; i < count; i++) {
        printf("%s%lx:", i > 0 ? " " : "", (unsigned long)units[i].id);
        for (unsigned k = 0; k < units[i].length; k++) {
            printf("%02x", units[i].data[k]);
        }
    }
    printf("\n");
}

static void send_state(hri_unit *units)
{
    hri_robot_state state = {0};
    state.mode = (uint8_t)number();
    state.joints = (uint8_t)number();
    for (unsigned i = 0; i < state.joints && i < HRI_MAX_JOINTS; i++) {
        state.position_urad[i] = (int32_t)number();
    }
    for (unsigned i = 0; i < state.joints && i < HRI_MAX_JOINTS; i++) {
        state.velocity_urad_s[i] = (int32_t)number();
    }
    state.request = (uint8_t)number();
    state.enabling = number() != 0;
    state.tool = (uint8_t)number();
    state.tool_confirmed = number() != 0;
    state.base_moves = number() != 0;
    state.base_um[0] = (int32_t)number();
    state.base_um[1] = (int32_t)number();
    state.base_yaw_urad = (int32_t)number();
    state.base_um_s[0] = (int32_t)number();
    state.base_um_s[1] = (int32_t)number();
    state.base_yaw_urad_s = (int32_t)number();
    print_units(units, hri_send_robot_state(&r, &state, now, units));
}

int main(void)
{
    static char line[8192];
    hri_unit units[HRI_PARTS_STATE];
    setvbuf(stdout, NULL, _IOLBF, BUFSIZ); /* whoever asks may wait for the answer */
    while (fgets(line, sizeof line, stdin) != NULL) {
        const char *command = strtok(line, " \n");
        if (command == NULL) {
            continue;
        } else if (strcmp(command, "init") == 0) {
            init();
        } else if (strcmp(command, "at") == 0) {
            now = (uint32_t)strtoul(strtok(NULL, " \n"), NULL, 0);
        } else if (strcmp(command, "rx") == 0) {
            receive();
        } else if (strcmp(command, "state") == 0) {
            send_state(units);
        } else if (strcmp(command, "ack") == 0) {
            uint16_t latch = (uint16_t)number();
            print_units(units, hri_acknowledge(&r, latch, (uint32_t)number(), units));
        } else if (strcmp(command, "released") == 0) {
            print_units(units, hri_released(&r, (uint32_t)number(), units));
        } else if (strcmp(command, "mode") == 0) {
            printf("mode:%u\n", r.message.advice.operating_mode);
        } else if (strcmp(command, "ask") == 0) {
            unsigned speed = hri_permitted_speed(&r, now);
            printf("%u %s %lu %lu %lu %lu\n", speed, hri_verdict_name(r.verdict),
                   (unsigned long)r.counts.crc_errors, (unsigned long)r.counts.counter_errors,
                   (unsigned long)r.counts.malformed, (unsigned long)r.counts.incomplete);
        } else {
            return 2;
        }
    }
    return 0;
}
