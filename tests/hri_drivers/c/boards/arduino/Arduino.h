/* As much of Arduino's core as the sketches use, for the tests. */
#ifndef ARDUINO_H
#define ARDUINO_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define LOW 0
#define HIGH 1
#define INPUT_PULLUP 2
#define OUTPUT 3
#define A0 14

unsigned long millis();
void pinMode(uint8_t pin, uint8_t mode);
void digitalWrite(uint8_t pin, uint8_t value);
int digitalRead(uint8_t pin);
int analogRead(uint8_t pin);
uint32_t esp_random();

class HardwareSerial {
public:
    void begin(unsigned long baud);
    int available();
    int read();
    size_t write(uint8_t value);
    size_t write(const uint8_t *data, size_t length);
    void print(int value);
    void print(const char *text);
    void println(const char *text);
};

extern HardwareSerial Serial;
extern HardwareSerial Serial1;

#endif
