/* A controller on any Arduino with a second serial port (Serial1), at 115200 bit/s.
 *
 * Copy hri_*.h and hri_*.c of drivers/c into this sketch's folder. The relay of the stop circuit is
 * at RELAY, the button at BUTTON (to ground). Enlarge the core's receive buffer where it can be set:
 * bytes that it loses stop the robot. The advice is no safety function; the relay must not be the
 * only stop.
 */
#include "hri_predict.h"

const int RELAY = 7;
const int BUTTON = 8;
const int NOISE = A0; /* an open pin: a start value that differs from start to start */
const uint32_t STATE_PERIOD_MS = 20;
const uint32_t BOUNCE_MS = 30; /* after a change, the contact may bounce for this time */

hri_receiver receiver;
hri_robot_state robot; /* fill it with what your robot measures */
uint32_t state_ms, button_ms, press_id;
uint16_t latch_id;
uint8_t ack_left;
bool pressed;

void setup()
{
    hri_settings settings = {};
    uint16_t noise = 0;
    for (uint8_t i = 0; i < 16; i++) {
        noise = (uint16_t)((noise << 1) ^ analogRead(NOISE));
    }
    settings.link = HRI_SERIAL;
    settings.robot = 0;
    settings.silence_timeout_ms = 60;  /* the link's silence_timeout_s */
    settings.max_age_ms = 204;         /* what `hri-predict check` prints for controllers */
    settings.tolerated_errors = 0;
    settings.error_window_ms = 500;
    settings.first_state_counter = noise;
    robot.mode = HRI_MODE_AUTOMATIC;
    robot.joints = 6;
    robot.tool = HRI_NO_U8;
    press_id = noise;
    pinMode(RELAY, OUTPUT);
    digitalWrite(RELAY, LOW);
    pinMode(BUTTON, INPUT_PULLUP);
    hri_init(&receiver, &settings);
    Serial1.begin(115200);
    Serial1.write((uint8_t)0); /* ends whatever the node has in its buffer */
}

uint8_t acknowledge(hri_unit *unit)
{
    return latch_id != 0 ? hri_acknowledge(&receiver, latch_id, press_id, unit)
                         : hri_released(&receiver, press_id, unit);
}

void loop()
{
    uint32_t now = millis();
    hri_unit units[HRI_PARTS_STATE];
    uint16_t speed_mm_s;
    bool down = digitalRead(BUTTON) == LOW;
    while (Serial1.available() > 0) {
        hri_receive_serial_byte(&receiver, (uint8_t)Serial1.read(), now);
    }
    if (down != pressed) {
        if (now - button_ms < BOUNCE_MS) {
            down = pressed;
        } else {
            button_ms = now;
        }
    }
    if (down && !pressed) {
        press_id = press_id + 1 != 0 ? press_id + 1 : 1; /* never 0 */
        latch_id = receiver.message.advice.latch_id;
        ack_left = latch_id != 0 ? 3 : 0; /* 0: there is nothing to acknowledge */
    } else if (!down && pressed && latch_id != 0) {
        latch_id = 0; /* the button was released */
        ack_left = 3;
    }
    pressed = down;
    if (now - state_ms >= STATE_PERIOD_MS) {
        state_ms = now;
        if (hri_send_robot_state(&receiver, &robot, now, units) > 0) {
            Serial1.write(units[0].data, units[0].length);
        }
        if (ack_left > 0 && acknowledge(units) > 0) {
            ack_left--;
            Serial1.write(units[0].data, units[0].length);
        }
    }
    speed_mm_s = hri_permitted_speed(&receiver, now);
    digitalWrite(RELAY, speed_mm_s > 0 ? HIGH : LOW);
}
