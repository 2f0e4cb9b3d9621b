/* A controller on an STM32's UART, by the HAL of CubeMX: DMA in both directions.
 *
 * In CubeMX: USART2 with the link's baudrate, 8 data bits, no parity; its receive DMA in circular
 * mode, its transmit DMA in normal mode, and its interrupt enabled. Where the core has a data cache
 * (F7, H7), place both buffers in memory that is not cached.
 */
#include "hri_stm32.h"
#include "main.h"

#include <string.h>

extern UART_HandleTypeDef huart2;

hri_receiver hri;
hri_robot_state hri_state = {.mode = HRI_MODE_AUTOMATIC, .joints = 6u, .tool = HRI_NO_U8};
uint32_t hri_lost;

static uint8_t ring[512]; /* the DMA writes round it; 44 ms at 115200 bit/s */
static volatile uint32_t written;  /* how far the DMA has come */
static volatile bool broken = true; /* reception has ended, or not begun */
static uint32_t taken;
static uint8_t outgoing[1u + HRI_UNIT_BYTES];
static bool begins = true;
static uint32_t state_ms;
static uint32_t ack_id;
static uint32_t ack_left;
static uint16_t latch_id;

/* The HAL calls it when the line falls idle and at half and full buffer. */
void HAL_UARTEx_RxEventCallback(UART_HandleTypeDef *handle, uint16_t position)
{
    if (handle == &huart2) {
        written = position % sizeof ring;
    }
}

/* An overrun or a framing error ends the DMA. */
void HAL_UART_ErrorCallback(UART_HandleTypeDef *handle)
{
    if (handle == &huart2) {
        broken = true;
    }
}

static bool receive(void)
{
    taken = 0u;
    written = 0u;
    broken = false;
    if (HAL_UARTEx_ReceiveToIdle_DMA(&huart2, ring, (uint16_t)sizeof ring) != HAL_OK) {
        broken = true;
    }
    return !broken;
}

bool hri_start(uint16_t first_state_counter)
{
    const hri_settings settings = {
        .link = HRI_SERIAL,
        .robot = 0u,
        .silence_timeout_ms = 60u,  /* the link's silence_timeout_s */
        .max_age_ms = 204u,         /* what `hri-predict check` prints for controllers */
        .tolerated_errors = 0u,
        .error_window_ms = 500u,
        .first_state_counter = first_state_counter,
    };
    state_ms = HAL_GetTick() - HRI_STATE_PERIOD_MS;
    return hri_init(&hri, &settings) && receive();
}

void hri_press(uint32_t press_id)
{
    ack_id = press_id;
    latch_id = hri.message.advice.latch_id;
    ack_left = (latch_id != 0u) ? HRI_ACK_REPEATS : 0u; /* 0: there is nothing to acknowledge */
}

void hri_release(void)
{
    ack_left = (latch_id != 0u) ? HRI_ACK_REPEATS : 0u; /* 0: the press has acknowledged nothing */
    latch_id = 0u;
}

/* The first bytes after a start begin with 0: they end whatever the node has in its buffer. */
static void transmit(const hri_unit *unit)
{
    uint16_t length = 0u;
    if (begins) {
        outgoing[0] = 0u;
        length = 1u;
    }
    (void)memcpy(&outgoing[length], unit->data, unit->length);
    length = (uint16_t)(length + unit->length);
    begins = (HAL_UART_Transmit_DMA(&huart2, outgoing, length) != HAL_OK);
    hri_lost += begins ? 1u : 0u;
}

uint16_t hri_cycle(void)
{
    hri_unit units[HRI_PARTS_STATE];
    uint32_t now = HAL_GetTick();
    uint32_t until;
    if (broken) {
        hri_lost++;
        (void)hri_receive_serial_byte(&hri, 0u, now); /* void what the break cut short */
        (void)receive();
    }
    until = written;
    while (taken != until) {
        (void)hri_receive_serial_byte(&hri, ring[taken], now);
        taken = (taken + 1u) % sizeof ring;
    }
    if (huart2.gState == HAL_UART_STATE_READY) { /* the newest state, once the last has left */
        if ((now - state_ms) >= HRI_STATE_PERIOD_MS) {
            state_ms = now;
            if (hri_send_robot_state(&hri, &hri_state, now, units) > 0u) {
                transmit(units);
            }
        } else if (ack_left > 0u) {
            ack_left--;
            if (((latch_id != 0u) ? hri_acknowledge(&hri, latch_id, ack_id, units)
                                  : hri_released(&hri, ack_id, units)) > 0u) {
                transmit(units);
            }
        } else {
            /* nothing to send */
        }
    }
    return hri_permitted_speed(&hri, now);
}
