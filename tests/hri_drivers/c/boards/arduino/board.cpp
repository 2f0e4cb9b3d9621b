/* A board that is none: it runs an Arduino sketch by the lines of standard input.
 *
 *   at MS          the clock from now on
 *   rx ID BYTES    a CAN frame comes (with Serial1: the bytes)
 *   state N        the TWAI driver's state
 *   press ID       the button goes down (ID is the sketch's matter);   free, up: it goes up
 *   cycle          prints "tx ID:BYTES ..." of what was sent, then "SPEED LOST VERDICT"
 *                  after one loop(), where SPEED is 1 if the relay is closed
 */
#include "Arduino.h"

#include "driver/twai.h"
#include "hri_predict.h"

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <string>

void setup();
void loop();
extern hri_receiver receiver;

HardwareSerial Serial, Serial1;
static unsigned long now_ms;
static int relay = -1, button = HIGH, bus_state = TWAI_STATE_RUNNING;
static std::deque<uint8_t> bytes;
static std::deque<twai_message_t> messages;
static std::string sent;

static void show(uint32_t id, const uint8_t *data, size_t length)
{
    char text[16];
    std::snprintf(text, sizeof text, " %lx:", (unsigned long)id);
    sent += text;
    for (size_t i = 0; i < length; i++) {
        std::snprintf(text, sizeof text, "%02x", data[i]);
        sent += text;
    }
}

unsigned long millis() { return now_ms; }
void pinMode(uint8_t, uint8_t) {}
void digitalWrite(uint8_t, uint8_t value) { relay = value; }
int digitalRead(uint8_t) { return button; }
int analogRead(uint8_t pin) { return pin; }
uint32_t esp_random() { return 4711; }

void HardwareSerial::begin(unsigned long) {}
int HardwareSerial::available() { return (int)bytes.size(); }
int HardwareSerial::read()
{
    int value = bytes.front();
    bytes.pop_front();
    return value;
}
size_t HardwareSerial::write(uint8_t value) { return write(&value, 1); }
size_t HardwareSerial::write(const uint8_t *data, size_t length)
{
    show(0, data, length);
    return length;
}
void HardwareSerial::print(int) {}
void HardwareSerial::print(const char *) {}
void HardwareSerial::println(const char *) {}

esp_err_t twai_driver_install(const twai_general_config_t *general, const twai_timing_config_t *,
                              const twai_filter_config_t *)
{
    return general->rx_queue_len >= 16 ? ESP_OK : ESP_FAIL;
}
esp_err_t twai_start()
{
    bus_state = TWAI_STATE_RUNNING;
    return ESP_OK;
}
esp_err_t twai_initiate_recovery()
{
    bus_state = TWAI_STATE_STOPPED;
    return ESP_OK;
}
esp_err_t twai_get_status_info(twai_status_info_t *status)
{
    status->state = (twai_state_t)bus_state;
    return ESP_OK;
}
esp_err_t twai_transmit(const twai_message_t *message, uint32_t)
{
    if (bus_state != TWAI_STATE_RUNNING) {
        return ESP_FAIL;
    }
    show(message->identifier, message->data, message->data_length_code);
    return ESP_OK;
}
esp_err_t twai_receive(twai_message_t *message, uint32_t)
{
    if (messages.empty()) {
        return ESP_FAIL;
    }
    *message = messages.front();
    messages.pop_front();
    return ESP_OK;
}

static void arrive(uint32_t id, const char *text)
{
    twai_message_t message = {};
    unsigned value;
    message.identifier = id;
    for (unsigned i = 0; std::sscanf(text + 2 * i, "%2x", &value) == 1; i++) {
        bytes.push_back((uint8_t)value);
        if (i < 8) {
            message.data[i] = (uint8_t)value;
            message.data_length_code = (uint8_t)(i + 1);
        }
    }
    messages.push_back(message);
}

int main()
{
    static char line[8192];
    std::setvbuf(stdout, NULL, _IOLBF, BUFSIZ);
    setup();
    while (std::fgets(line, sizeof line, stdin) != NULL) {
        const char *word = std::strtok(line, " \n");
        std::string command = word == NULL ? "cycle" : word;
        if (command == "cycle") {
            loop();
            std::printf("tx%s\n%d 0 %s\n", sent.c_str(), relay, hri_verdict_name(receiver.verdict));
            sent.clear();
        } else if (command == "at") {
            now_ms = std::strtoul(std::strtok(NULL, " \n"), NULL, 0);
        } else if (command == "rx") {
            uint32_t id = (uint32_t)std::strtoul(std::strtok(NULL, " \n"), NULL, 16);
            const char *text = std::strtok(NULL, " \n");
            arrive(id, text == NULL ? "" : text);
        } else if (command == "state") {
            bus_state = std::atoi(std::strtok(NULL, " \n"));
        } else {
            button = command == "press" ? LOW : HIGH;
        }
    }
    return 0;
}
