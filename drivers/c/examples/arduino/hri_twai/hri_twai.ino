/* A controller on an ESP32 with a CAN transceiver (TWAI driver), as an Arduino sketch.
 *
 * Copy hri_*.h and hri_*.c of drivers/c into this sketch's folder. The relay of the stop circuit is
 * at RELAY, the button at BUTTON (to ground). Another CAN library: change receive() and transmit().
 * The advice is no safety function; the relay must not be the only stop.
 */
#include "hri_predict.h"

#include "driver/twai.h"

const gpio_num_t CAN_TX = GPIO_NUM_5;
const gpio_num_t CAN_RX = GPIO_NUM_4;
const int RELAY = 25;
const int BUTTON = 26;
const uint32_t STATE_PERIOD_MS = 20;
const uint32_t BOUNCE_MS = 30; /* after a change, the contact may bounce for this time */

hri_receiver receiver;
hri_robot_state robot; /* fill it with what your robot measures */
uint32_t state_ms, shown_ms, button_ms, press_id;
uint16_t latch_id;
uint8_t ack_left;
bool pressed, open_bus;

void receive(uint32_t now)
{
    twai_message_t message;
    while (twai_receive(&message, 0) == ESP_OK) {
        if (!message.rtr && message.data_length_code <= 8) {
            hri_receive_can(&receiver, message.identifier, message.extd, false, message.data,
                            message.data_length_code, now);
        }
    }
}

/* What finds no room in the driver's queue is lost: the next state is newer. */
void transmit(const hri_unit *units, uint8_t count)
{
    for (uint8_t i = 0; i < count; i++) {
        twai_message_t message = {};
        message.identifier = units[i].id;
        message.data_length_code = units[i].length;
        memcpy(message.data, units[i].data, units[i].length);
        twai_transmit(&message, 0);
    }
}

/* A bus that was off comes back by itself; the robot stands meanwhile, because nothing is heard. */
void heal()
{
    twai_status_info_t status;
    if (twai_get_status_info(&status) == ESP_OK) {
        if (status.state == TWAI_STATE_BUS_OFF) {
            twai_initiate_recovery();
        } else if (status.state == TWAI_STATE_STOPPED) {
            twai_start();
        }
    }
}

void setup()
{
    twai_general_config_t general =
        TWAI_GENERAL_CONFIG_DEFAULT(CAN_TX, CAN_RX, TWAI_MODE_NORMAL);
    twai_timing_config_t timing = TWAI_TIMING_CONFIG_500KBITS();
    twai_filter_config_t filter = TWAI_FILTER_CONFIG_ACCEPT_ALL();
    hri_settings settings = {};
    general.rx_queue_len = 64;
    general.tx_queue_len = 16;
    settings.link = HRI_CLASSIC;
    settings.robot = 0;
    settings.base_id = HRI_DEFAULT_BASE_ID;
    settings.silence_timeout_ms = 60;  /* the link's silence_timeout_s */
    settings.max_age_ms = 204;         /* what `hri-predict check` prints for controllers */
    settings.tolerated_errors = 0;
    settings.error_window_ms = 500;
    settings.first_state_counter = (uint16_t)esp_random();
    robot.mode = HRI_MODE_AUTOMATIC;
    robot.joints = 6;
    robot.tool = HRI_NO_U8;
    press_id = esp_random();
    Serial.begin(115200);
    pinMode(RELAY, OUTPUT);
    digitalWrite(RELAY, LOW);
    pinMode(BUTTON, INPUT_PULLUP);
    open_bus = hri_init(&receiver, &settings) &&
               twai_driver_install(&general, &timing, &filter) == ESP_OK && twai_start() == ESP_OK;
    if (!open_bus) {
        Serial.println("the CAN bus cannot be opened; check the pins and the transceiver");
    }
}

void loop()
{
    uint32_t now = millis();
    hri_unit units[HRI_PARTS_STATE];
    uint16_t speed_mm_s;
    bool down = digitalRead(BUTTON) == LOW;
    receive(now);
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
        heal();
        transmit(units, hri_send_robot_state(&receiver, &robot, now, units));
        if (ack_left > 0) {
            ack_left--;
            transmit(units, latch_id != 0 ? hri_acknowledge(&receiver, latch_id, press_id, units)
                                          : hri_released(&receiver, press_id, units));
        }
    }
    speed_mm_s = open_bus ? hri_permitted_speed(&receiver, now) : 0;
    digitalWrite(RELAY, speed_mm_s > 0 ? HIGH : LOW);
    if (now - shown_ms >= 200) {
        shown_ms = now;
        Serial.print(speed_mm_s);
        Serial.print(" mm/s, reason ");
        Serial.print(receiver.message.advice.reason);
        Serial.print(", ");
        Serial.println(hri_verdict_name(receiver.verdict));
    }
}
