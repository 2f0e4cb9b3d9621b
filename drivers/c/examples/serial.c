/* A controller on a serial line (POSIX): it sends its robot's state and obeys the advice.
 *
 *   serial PORT[,RATE] [SILENCE_MS [MAX_AGE_MS [TOLERATED_ERRORS [teach|recovery|muted]]]]
 *
 * Here robot 0 stands still; a real controller fills in its measurements, and asks for an operating
 * mode only while its operator does. With teach, this one is in manual mode and the enabling device
 * is held. It prints a line whenever the permitted speed changes, with the operating mode in force
 * if that is not the automatic one:
 *
 *   TIME_MS clear|warn|slow|stop SPEED_MM_S REASON VERDICT [MODE]
 *
 * Standard error says what there is to acknowledge; Enter acknowledges it. Only a person who has
 * looked may press: a controller never acknowledges by itself.
 */
#define _DEFAULT_SOURCE /* termios speeds above 38400 */
#define _POSIX_C_SOURCE 200809L
#include "../hri_predict.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#define STATE_PERIOD_MS 20u /* RobotState at 50 Hz */
#define CYCLE_MS 5u
#define PRESS_PAUSE_MS 12000u /* a press sooner after the one before does not count */
#define ACK_REPEATS 3u        /* a press is sent so often */

typedef struct {
    uint16_t shown_id; /* what standard error named last */
    uint16_t latch_id; /* what was shown when the button was pressed */
    uint32_t ack_id;   /* of the press: new for each, also after a start */
    uint32_t pressed_ms;
    unsigned left; /* how often it is still sent */
} acknowledgement;

static uint32_t now_ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint32_t)((uint64_t)t.tv_sec * 1000u + (uint64_t)t.tv_nsec / 1000000u);
}

/* The bit rate after the comma of PORT,RATE, which it cuts off; B0 if it is none of these. */
static speed_t take_rate(char *port)
{
    char *comma = strchr(port, ',');
    unsigned long rate = comma == NULL ? 115200u : strtoul(comma + 1, NULL, 10);
    if (comma != NULL) {
        *comma = '\0';
    }
    return rate == 115200u   ? B115200
           : rate == 230400u ? B230400
           : rate == 460800u ? B460800
           : rate == 921600u ? B921600
                             : B0;
}

/* Raw, 8 bits, no parity, 1 stop bit. */
static int open_port(const char *path, speed_t rate)
{
    struct termios raw;
    int port = open(path, O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (port < 0 || tcgetattr(port, &raw) != 0) {
        return -1;
    }
    raw.c_iflag = 0;
    raw.c_oflag = 0;
    raw.c_lflag = 0;
    raw.c_cflag = CS8 | CREAD | CLOCAL;
    raw.c_cc[VMIN] = 0;
    raw.c_cc[VTIME] = 0;
    if (cfsetspeed(&raw, rate) != 0 || tcsetattr(port, TCSANOW, &raw) != 0) {
        return -1;
    }
    return port;
}

static const char *word(const hri_receiver *r, unsigned speed)
{
    static const char *const levels[] = {"stop", "clear", "warn", "slow", "stop", "stop"};
    return speed == 0 ? "stop" : levels[r->message.advice.level];
}

static const char *const modes[] = {"automatic", "teach", "recovery", "muted"};

/* What the operator asks for. */
static void ask_for(hri_robot_state *state, const char *request)
{
    for (uint8_t mode = 0; mode < sizeof modes / sizeof modes[0]; mode++) {
        if (strcmp(request, modes[mode]) == 0) {
            state->request = mode;
        }
    }
    state->enabling = state->request == HRI_OPERATING_MODE_TEACH;
    state->mode = state->enabling ? HRI_MODE_MANUAL : HRI_MODE_AUTOMATIC;
}

/* Whether Enter was pressed: the rising edge of a button. */
static int pressed(void)
{
    struct pollfd keys = {.fd = STDIN_FILENO, .events = POLLIN};
    char text[64];
    return poll(&keys, 1, 0) == 1 && (keys.revents & POLLIN) != 0 &&
           read(STDIN_FILENO, text, sizeof text) > 0;
}

/* Show what there is to acknowledge, and take a press for what was shown. */
static void attend(acknowledgement *ack, uint16_t latch_id, uint32_t now)
{
    if (pressed()) {
        if (ack->ack_id != 0u && now - ack->pressed_ms < PRESS_PAUSE_MS) {
            fprintf(stderr, "not sent: press again %u s after the last press\n",
                    PRESS_PAUSE_MS / 1000u);
        } else if (ack->shown_id != 0u && ack->shown_id == latch_id) {
            ack->latch_id = latch_id;
            ack->ack_id = (uint32_t)time(NULL);
            ack->pressed_ms = now;
            ack->left = ACK_REPEATS;
        }
    }
    if (latch_id != ack->shown_id) {
        ack->shown_id = latch_id;
        if (latch_id != 0u) {
            fprintf(stderr, "to acknowledge: %u; look, then press Enter\n", latch_id);
        }
    }
}

/* Write a frame; after the start and after a frame that was cut, first end whatever the node has in
 * its buffer. Bytes that do not fit are lost: the next state is newer. */
static void put(int port, const hri_unit *unit)
{
    static const uint8_t end[1] = {0u};
    static bool cut = true;
    if (cut && write(port, end, sizeof end) != (ssize_t)sizeof end) {
        return;
    }
    cut = write(port, unit->data, unit->length) != (ssize_t)unit->length;
}

int main(int argc, char **argv)
{
    static hri_receiver receiver; /* the only memory that the library needs */
    hri_settings settings = {.link = HRI_SERIAL, .robot = 0, .silence_timeout_ms = 60};
    hri_robot_state state = {.mode = HRI_MODE_AUTOMATIC, .joints = 6, .tool = HRI_NO_U8};
    /* upright, elbow bent: microradians */
    static const int32_t posture[6] = {0, -1570796, 1570796, -1570796, -1570796, 0};
    acknowledgement ack = {0};
    uint32_t state_due = now_ms();
    char shown[64] = "";
    speed_t rate;
    int port;
    settings.silence_timeout_ms = (uint16_t)(argc > 2 ? atoi(argv[2]) : 60);
    settings.max_age_ms = (uint16_t)(argc > 3 ? atoi(argv[3]) : 204);
    settings.tolerated_errors = (uint16_t)(argc > 4 ? atoi(argv[4]) : 0);
    settings.error_window_ms = 500;
    settings.first_state_counter = (uint16_t)(state_due / STATE_PERIOD_MS);
    if (argc < 2 || !hri_init(&receiver, &settings)) {
        fprintf(stderr, "usage: serial PORT[,RATE] [SILENCE_MS [MAX_AGE_MS [TOLERATED_ERRORS "
                        "[teach|recovery|muted]]]]\n");
        return 2;
    }
    rate = take_rate(argv[1]);
    if (rate == B0) {
        fprintf(stderr, "serial: give a rate of 115200, 230400, 460800 or 921600 bit/s\n");
        return 2;
    }
    port = open_port(argv[1], rate);
    if (port < 0) {
        fprintf(stderr, "serial: %s cannot be opened: %s; check the port\n", argv[1],
                strerror(errno));
        return 2;
    }
    memcpy(state.position_urad, posture, sizeof posture);
    ask_for(&state, argc > 5 ? argv[5] : "automatic");
    for (;;) {
        struct pollfd readable = {.fd = port, .events = POLLIN};
        uint8_t bytes[256];
        ssize_t count;
        uint32_t now;
        unsigned speed;
        uint8_t mode;
        char line[64];
        poll(&readable, 1, CYCLE_MS);
        now = now_ms();
        while ((count = read(port, bytes, sizeof bytes)) > 0) {
            for (ssize_t i = 0; i < count; i++) {
                hri_receive_serial_byte(&receiver, bytes[i], now);
            }
        }
        if ((readable.revents & (POLLHUP | POLLERR)) != 0) { /* unplugged: do not spin */
            nanosleep(&(struct timespec){.tv_nsec = CYCLE_MS * 1000000}, NULL);
        }
        if (now - state_due < 0x80000000u) { /* due; the tick may wrap */
            hri_unit units[HRI_PARTS_STATE];
            state_due = now + STATE_PERIOD_MS;
            hri_send_robot_state(&receiver, &state, now, units);
            put(port, &units[0]);
            if (ack.left > 0u && hri_acknowledge(&receiver, ack.latch_id, ack.ack_id, units) > 0u) {
                ack.left--;
                put(port, &units[0]);
            }
        }
        speed = hri_permitted_speed(&receiver, now);
        attend(&ack, receiver.message.advice.latch_id, now);
        mode = receiver.message.advice.operating_mode;
        snprintf(line, sizeof line, "%s %u %u %s%s%s", word(&receiver, speed), speed,
                 receiver.message.advice.reason, hri_verdict_name(receiver.verdict),
                 mode != HRI_OPERATING_MODE_AUTOMATIC ? " " : "",
                 mode != HRI_OPERATING_MODE_AUTOMATIC ? modes[mode] : "");
        if (strcmp(line, shown) != 0) {
            memcpy(shown, line, sizeof shown);
            printf("%lu %s\n", (unsigned long)now, line);
            fflush(stdout);
        }
    }
}
