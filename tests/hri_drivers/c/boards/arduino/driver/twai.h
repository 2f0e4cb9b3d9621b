/* As much of the ESP32's TWAI driver as the sketch uses, for the tests. */
#ifndef TWAI_H
#define TWAI_H

#include <stdint.h>

typedef int esp_err_t;
typedef int gpio_num_t;
#define ESP_OK 0
#define ESP_FAIL (-1)
#define GPIO_NUM_4 4
#define GPIO_NUM_5 5

typedef enum { TWAI_MODE_NORMAL } twai_mode_t;
typedef enum {
    TWAI_STATE_STOPPED,
    TWAI_STATE_RUNNING,
    TWAI_STATE_BUS_OFF,
    TWAI_STATE_RECOVERING
} twai_state_t;

typedef struct {
    union {
        struct {
            uint32_t extd : 1;
            uint32_t rtr : 1;
            uint32_t ss : 1;
            uint32_t self : 1;
            uint32_t dlc_non_comp : 1;
            uint32_t reserved : 27;
        };
        uint32_t flags;
    };
    uint32_t identifier;
    uint8_t data_length_code;
    uint8_t data[8];
} twai_message_t;
typedef struct {
    twai_mode_t mode;
    gpio_num_t tx_io, rx_io;
    uint32_t tx_queue_len, rx_queue_len;
} twai_general_config_t;
typedef struct { uint32_t brp; } twai_timing_config_t;
typedef struct { uint32_t acceptance_code, acceptance_mask; bool single_filter; } twai_filter_config_t;
typedef struct { twai_state_t state; } twai_status_info_t;

#define TWAI_GENERAL_CONFIG_DEFAULT(tx, rx, mode) {mode, tx, rx, 5, 5}
#define TWAI_TIMING_CONFIG_500KBITS() {8}
#define TWAI_FILTER_CONFIG_ACCEPT_ALL() {0, 0xFFFFFFFF, true}

esp_err_t twai_driver_install(const twai_general_config_t *general,
                              const twai_timing_config_t *timing,
                              const twai_filter_config_t *filter);
esp_err_t twai_start();
esp_err_t twai_transmit(const twai_message_t *message, uint32_t ticks);
esp_err_t twai_receive(twai_message_t *message, uint32_t ticks);
esp_err_t twai_get_status_info(twai_status_info_t *status);
esp_err_t twai_initiate_recovery();

#endif
