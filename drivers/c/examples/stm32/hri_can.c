/* A controller on an STM32 with bxCAN (classic CAN) or FDCAN (CAN FD), by the HAL of CubeMX.
 *
 * In CubeMX: set the bit rates, and enable the interrupt of receive FIFO 0 (bxCAN: CAN RX0; FDCAN:
 * interrupt 0). FDCAN: frame format "FD with bit-rate switching", and no filters, so that all frames
 * reach FIFO 0. The handles are hcan and hfdcan1, as CubeMX names them.
 */
#include "hri_stm32.h"
#include "main.h"

#include <string.h>

#define QUEUE 64u /* frames between two cycles; a power of two */

typedef struct {
    uint32_t id;
    bool extended;
    bool fd;
    uint8_t length;
    uint8_t data[64];
} frame;

hri_receiver hri;
hri_robot_state hri_state = {.mode = HRI_MODE_AUTOMATIC, .joints = 6u, .tool = HRI_NO_U8};
uint32_t hri_lost;

/* The interrupt writes at came, hri_cycle reads at taken: a queue, as every frame counts. */
static frame queue[QUEUE];
static volatile uint32_t came;
static volatile uint32_t taken;
static volatile uint32_t overrun;
static uint32_t late; /* frames of ours that had not left when the next state was due */

static hri_unit units[HRI_PARTS_STATE]; /* on their way: from next to count */
static uint8_t next;
static uint8_t count;
static uint32_t state_ms;
static uint32_t ack_id;
static uint32_t ack_left;
static uint16_t latch_id;

static void keep(uint32_t id, bool extended, bool fd, const uint8_t *data, uint8_t length)
{
    frame *f = &queue[came % QUEUE];
    if ((came - taken) >= QUEUE) {
        overrun++; /* the receiver notices the gap, too, and stops the robot */
        return;
    }
    f->id = id;
    f->extended = extended;
    f->fd = fd;
    f->length = length;
    (void)memcpy(f->data, data, length);
    __DMB(); /* the frame before the index */
    came++;
}

#ifdef HAL_FDCAN_MODULE_ENABLED
extern FDCAN_HandleTypeDef hfdcan1;

static const uint8_t sizes[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
/* The codes of these sizes differ between families of the HAL, their names do not. */
static const uint32_t codes[16] = {
    FDCAN_DLC_BYTES_0,  FDCAN_DLC_BYTES_1,  FDCAN_DLC_BYTES_2,  FDCAN_DLC_BYTES_3,
    FDCAN_DLC_BYTES_4,  FDCAN_DLC_BYTES_5,  FDCAN_DLC_BYTES_6,  FDCAN_DLC_BYTES_7,
    FDCAN_DLC_BYTES_8,  FDCAN_DLC_BYTES_12, FDCAN_DLC_BYTES_16, FDCAN_DLC_BYTES_20,
    FDCAN_DLC_BYTES_24, FDCAN_DLC_BYTES_32, FDCAN_DLC_BYTES_48, FDCAN_DLC_BYTES_64};

static uint8_t size_of(uint32_t code)
{
    uint8_t size = 0u;
    for (uint32_t i = 0u; i < 16u; i++) {
        size = (codes[i] == code) ? sizes[i] : size;
    }
    return size;
}

void HAL_FDCAN_RxFifo0Callback(FDCAN_HandleTypeDef *hfdcan, uint32_t interrupts)
{
    FDCAN_RxHeaderTypeDef header;
    uint8_t data[64];
    (void)interrupts;
    while ((HAL_FDCAN_GetRxFifoFillLevel(hfdcan, FDCAN_RX_FIFO0) > 0u) &&
           (HAL_FDCAN_GetRxMessage(hfdcan, FDCAN_RX_FIFO0, &header, data) == HAL_OK)) {
        if (header.RxFrameType == FDCAN_DATA_FRAME) {
            keep(header.Identifier, header.IdType == FDCAN_EXTENDED_ID,
                 header.FDFormat == FDCAN_FD_CAN, data, size_of(header.DataLength));
        }
    }
}

static bool open_bus(void)
{
    return (HAL_FDCAN_Start(&hfdcan1) == HAL_OK) &&
           (HAL_FDCAN_ActivateNotification(&hfdcan1, FDCAN_IT_RX_FIFO0_NEW_MESSAGE, 0u) == HAL_OK);
}

/* False if there is no room now. */
static bool sent(hri_unit *unit)
{
    FDCAN_TxHeaderTypeDef header = {0};
    header.Identifier = unit->id;
    header.IdType = hri.settings.extended ? FDCAN_EXTENDED_ID : FDCAN_STANDARD_ID;
    header.TxFrameType = FDCAN_DATA_FRAME;
    for (uint32_t i = 0u; i < 16u; i++) {
        header.DataLength = (sizes[i] == unit->length) ? codes[i] : header.DataLength;
    }
    header.ErrorStateIndicator = FDCAN_ESI_ACTIVE;
    header.BitRateSwitch = FDCAN_BRS_ON;
    header.FDFormat = FDCAN_FD_CAN;
    header.TxEventFifoControl = FDCAN_NO_TX_EVENTS;
    return (HAL_FDCAN_GetTxFifoFreeLevel(&hfdcan1) > 0u) &&
           (HAL_FDCAN_AddMessageToTxFifoQ(&hfdcan1, &header, unit->data) == HAL_OK);
}

#define LINK HRI_FD
#else
extern CAN_HandleTypeDef hcan;

void HAL_CAN_RxFifo0MsgPendingCallback(CAN_HandleTypeDef *handle)
{
    CAN_RxHeaderTypeDef header;
    uint8_t data[8];
    while ((HAL_CAN_GetRxFifoFillLevel(handle, CAN_RX_FIFO0) > 0u) &&
           (HAL_CAN_GetRxMessage(handle, CAN_RX_FIFO0, &header, data) == HAL_OK)) {
        bool extended = (header.IDE == CAN_ID_EXT);
        if (header.RTR == CAN_RTR_DATA) {
            keep(extended ? header.ExtId : header.StdId, extended, false, data,
                 (uint8_t)((header.DLC > 8u) ? 8u : header.DLC));
        }
    }
}

/* Let the ids base .. base + 16#7F through: bxCAN receives nothing without a filter. */
static bool open_bus(void)
{
    CAN_FilterTypeDef filter = {0};
    filter.FilterIdHigh = HRI_DEFAULT_BASE_ID << 5;
    filter.FilterMaskIdHigh = 0x780u << 5;
    filter.FilterFIFOAssignment = CAN_RX_FIFO0;
    filter.FilterMode = CAN_FILTERMODE_IDMASK;
    filter.FilterScale = CAN_FILTERSCALE_32BIT;
    filter.FilterActivation = CAN_FILTER_ENABLE;
    filter.SlaveStartFilterBank = 14u;
    return (HAL_CAN_ConfigFilter(&hcan, &filter) == HAL_OK) && (HAL_CAN_Start(&hcan) == HAL_OK) &&
           (HAL_CAN_ActivateNotification(&hcan, CAN_IT_RX_FIFO0_MSG_PENDING) == HAL_OK);
}

/* False if there is no room now. */
static bool sent(hri_unit *unit)
{
    CAN_TxHeaderTypeDef header = {0};
    uint32_t mailbox;
    header.StdId = unit->id;
    header.IDE = CAN_ID_STD;
    header.RTR = CAN_RTR_DATA;
    header.DLC = unit->length;
    return (HAL_CAN_GetTxMailboxesFreeLevel(&hcan) > 0u) &&
           (HAL_CAN_AddTxMessage(&hcan, &header, unit->data, &mailbox) == HAL_OK);
}

#define LINK HRI_CLASSIC
#endif

bool hri_start(uint16_t first_state_counter)
{
    const hri_settings settings = {
        .link = LINK,
        .robot = 0u,
        .base_id = HRI_DEFAULT_BASE_ID,
        .silence_timeout_ms = 60u,  /* the link's silence_timeout_s */
        .max_age_ms = 204u,         /* what `hri-predict check` prints for controllers */
        .tolerated_errors = 0u,
        .error_window_ms = 500u,
        .first_state_counter = first_state_counter,
    };
    state_ms = HAL_GetTick() - HRI_STATE_PERIOD_MS;
    return hri_init(&hri, &settings) && open_bus();
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

/* A state is due, or an acknowledge after one that has left. What has not left is too old. */
static void prepare(uint32_t now)
{
    if ((now - state_ms) >= HRI_STATE_PERIOD_MS) {
        late += (uint32_t)count - next;
        next = 0u;
        count = hri_send_robot_state(&hri, &hri_state, now, units);
        state_ms = now;
    } else if ((next == count) && (ack_left > 0u)) {
        next = 0u;
        count = (latch_id != 0u) ? hri_acknowledge(&hri, latch_id, ack_id, units)
                                 : hri_released(&hri, ack_id, units);
        ack_left--;
    } else {
        /* nothing to send, or still sending */
    }
}

uint16_t hri_cycle(void)
{
    uint32_t now = HAL_GetTick();
    uint32_t until = came;
    __DMB(); /* the index before the frames */
    while (taken != until) {
        const frame *f = &queue[taken % QUEUE];
        (void)hri_receive_can(&hri, f->id, f->extended, f->fd, f->data, f->length, now);
        __DMB(); /* the frame is read before its place is free */
        taken++;
    }
    prepare(now);
    hri_lost = overrun + late;
    while ((next < count) && sent(&units[next])) {
        next++;
    }
    return hri_permitted_speed(&hri, now);
}
