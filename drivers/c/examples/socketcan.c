/* A controller on classic CAN under Linux (SocketCAN): like serial.c, on another wire.
 *
 *   ip link set can0 up type can bitrate 500000 restart-ms 100
 *   socketcan can0 [teach|recovery|muted]
 *
 * With CAN FD: link HRI_FD, the socket option CAN_RAW_FD_FRAMES, and struct canfd_frame.
 */
#define _DEFAULT_SOURCE
#define _POSIX_C_SOURCE 200809L
#include "../hri_predict.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define STATE_PERIOD_MS 20u
#define CYCLE_MS 5u

static uint32_t now_ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint32_t)((uint64_t)t.tv_sec * 1000u + (uint64_t)t.tv_nsec / 1000000u);
}

/* A socket for our frames only: ids from base to base + 7F, if the base ends in 00 or 80. */
static int open_bus(const char *name, uint32_t base_id)
{
    struct ifreq interface = {0};
    struct sockaddr_can address = {0};
    struct can_filter ours = {.can_id = base_id,
                              .can_mask = CAN_EFF_FLAG | (CAN_SFF_MASK & ~0x7Fu)};
    int bus = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK, CAN_RAW);
    if (bus < 0) {
        return -1;
    }
    strncpy(interface.ifr_name, name, IFNAMSIZ - 1);
    address.can_family = AF_CAN;
    if (ioctl(bus, SIOCGIFINDEX, &interface) < 0) {
        return -1;
    }
    address.can_ifindex = interface.ifr_ifindex;
    if (setsockopt(bus, SOL_CAN_RAW, CAN_RAW_FILTER, &ours, sizeof ours) != 0 ||
        bind(bus, (struct sockaddr *)&address, sizeof address) != 0) {
        return -1;
    }
    return bus;
}

static void receive(hri_receiver *r, int bus, uint32_t now)
{
    struct can_frame frame;
    while (read(bus, &frame, sizeof frame) == (ssize_t)sizeof frame) {
        if ((frame.can_id & (CAN_RTR_FLAG | CAN_ERR_FLAG)) == 0) {
            hri_receive_can(r, frame.can_id & CAN_EFF_MASK, (frame.can_id & CAN_EFF_FLAG) != 0,
                            false, frame.data, frame.can_dlc, now);
        }
    }
}

static void send_state(hri_receiver *r, int bus, const hri_robot_state *state, uint32_t now)
{
    hri_unit units[HRI_PARTS_STATE];
    unsigned count = hri_send_robot_state(r, state, now, units);
    for (unsigned i = 0; i < count; i++) {
        struct can_frame frame = {.can_id = units[i].id, .can_dlc = units[i].length};
        memcpy(frame.data, units[i].data, units[i].length);
        if (write(bus, &frame, sizeof frame) != (ssize_t)sizeof frame) {
            return; /* the queue is full: the node sees that the state is incomplete */
        }
    }
}

/* What the operator asks for; with teach, in manual mode with the enabling device held. */
static void ask_for(hri_robot_state *state, const char *request)
{
    state->request = strcmp(request, "teach") == 0      ? HRI_OPERATING_MODE_TEACH
                     : strcmp(request, "recovery") == 0 ? HRI_OPERATING_MODE_RECOVERY
                     : strcmp(request, "muted") == 0    ? HRI_OPERATING_MODE_MUTED
                                                        : HRI_OPERATING_MODE_AUTOMATIC;
    state->enabling = state->request == HRI_OPERATING_MODE_TEACH;
    state->mode = state->enabling ? HRI_MODE_MANUAL : HRI_MODE_AUTOMATIC;
}

int main(int argc, char **argv)
{
    static hri_receiver receiver;
    hri_robot_state still = {.mode = HRI_MODE_AUTOMATIC, .joints = 6, .tool = HRI_NO_U8};
    hri_settings settings = {.link = HRI_CLASSIC,
                             .robot = 0,
                             .base_id = HRI_DEFAULT_BASE_ID,
                             .silence_timeout_ms = 60,
                             .max_age_ms = 204,
                             .error_window_ms = 500};
    uint32_t state_due = now_ms();
    unsigned shown = 1;
    int bus;
    settings.first_state_counter = (uint16_t)(state_due / STATE_PERIOD_MS);
    if (argc < 2 || !hri_init(&receiver, &settings)) {
        fprintf(stderr, "usage: socketcan INTERFACE [teach|recovery|muted] (the interface, such as "
                        "can0, must be up)\n");
        return 2;
    }
    ask_for(&still, argc > 2 ? argv[2] : "automatic");
    bus = open_bus(argv[1], settings.base_id);
    if (bus < 0) {
        fprintf(stderr, "socketcan: %s cannot be opened: %s; check 'ip link'\n", argv[1],
                errno == EAFNOSUPPORT ? "this kernel has no CAN" : strerror(errno));
        return 2;
    }
    for (;;) {
        struct pollfd readable = {.fd = bus, .events = POLLIN};
        uint32_t now;
        unsigned speed;
        poll(&readable, 1, CYCLE_MS);
        now = now_ms();
        receive(&receiver, bus, now);
        if (now - state_due < 0x80000000u) {
            state_due = now + STATE_PERIOD_MS;
            send_state(&receiver, bus, &still, now);
        }
        speed = hri_permitted_speed(&receiver, now);
        if (speed != shown) {
            shown = speed;
            printf("%lu %u mm/s (%s)\n", (unsigned long)now, speed,
                   hri_verdict_name(receiver.verdict));
            fflush(stdout);
        }
    }
}
