/* A board that is none: it runs an STM32 example by the lines of standard input.
 *
 *   at MS             the tick from now on
 *   rx ID BYTES       a CAN frame comes, with its interrupt (a UART: the bytes)
 *   full              nothing leaves any more;   free: it does again
 *   error             a UART's error interrupt
 *   press ID          the button goes down;   up: it is released
 *   cycle             prints "tx ID:BYTES ..." of what was sent, then "SPEED VERDICT LOST"
 */
#include "hri_stm32.h"
#include "main.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static uint32_t tick;
static int full;

uint32_t HAL_GetTick(void)
{
    return tick;
}

static void show(uint32_t id, const uint8_t *data, unsigned length)
{
    printf(" %lx:", (unsigned long)id);
    for (unsigned i = 0; i < length; i++) {
        printf("%02x", data[i]);
    }
}

#ifdef HAL_UART_MODULE_ENABLED
UART_HandleTypeDef huart2 = {HAL_UART_STATE_READY};
static uint8_t *ring;
static uint16_t ring_size, position;

HAL_StatusTypeDef HAL_UARTEx_ReceiveToIdle_DMA(UART_HandleTypeDef *handle, uint8_t *data,
                                               uint16_t size)
{
    (void)handle;
    ring = data;
    ring_size = size;
    position = 0;
    return HAL_OK;
}

HAL_StatusTypeDef HAL_UART_Transmit_DMA(UART_HandleTypeDef *handle, const uint8_t *data,
                                        uint16_t size)
{
    (void)handle;
    if (full) {
        return HAL_BUSY;
    }
    show(0, data, size);
    return HAL_OK;
}

static void arrive(uint32_t id, const uint8_t *data, unsigned length)
{
    (void)id;
    for (unsigned i = 0; i < length && ring != NULL; i++) {
        ring[position++] = data[i];
        if (position == ring_size) { /* transfer complete: the HAL gives the whole size */
            HAL_UARTEx_RxEventCallback(&huart2, position);
            position = 0;
        }
    }
    if (position > 0) {
        HAL_UARTEx_RxEventCallback(&huart2, position);
    }
}

static void fail(void)
{
    ring = NULL; /* the HAL has aborted its DMA */
    HAL_UART_ErrorCallback(&huart2);
}
#else
static uint32_t came_id;
static unsigned came_length, level, mailboxes;
static uint8_t came[64];

static void fail(void)
{
}
#endif

#ifdef HAL_FDCAN_MODULE_ENABLED
FDCAN_HandleTypeDef hfdcan1;
static const unsigned sizes[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};

HAL_StatusTypeDef HAL_FDCAN_Start(FDCAN_HandleTypeDef *handle)
{
    (void)handle;
    return HAL_OK;
}

HAL_StatusTypeDef HAL_FDCAN_ActivateNotification(FDCAN_HandleTypeDef *handle, uint32_t its,
                                                 uint32_t buffers)
{
    (void)handle;
    (void)buffers;
    return its == FDCAN_IT_RX_FIFO0_NEW_MESSAGE ? HAL_OK : HAL_ERROR;
}

uint32_t HAL_FDCAN_GetRxFifoFillLevel(const FDCAN_HandleTypeDef *handle, uint32_t fifo)
{
    (void)handle;
    return fifo == FDCAN_RX_FIFO0 ? level : 0;
}

HAL_StatusTypeDef HAL_FDCAN_GetRxMessage(FDCAN_HandleTypeDef *handle, uint32_t fifo,
                                         FDCAN_RxHeaderTypeDef *header, uint8_t *data)
{
    (void)handle;
    (void)fifo;
    memset(header, 0, sizeof *header);
    header->Identifier = came_id;
    header->FDFormat = FDCAN_FD_CAN;
    for (unsigned i = 0; i < 16; i++) {
        header->DataLength = sizes[i] == came_length ? DLC(i) : header->DataLength;
    }
    memcpy(data, came, came_length);
    level = 0;
    return HAL_OK;
}

uint32_t HAL_FDCAN_GetTxFifoFreeLevel(const FDCAN_HandleTypeDef *handle)
{
    (void)handle;
    return full ? 0 : mailboxes;
}

HAL_StatusTypeDef HAL_FDCAN_AddMessageToTxFifoQ(FDCAN_HandleTypeDef *handle,
                                                const FDCAN_TxHeaderTypeDef *header,
                                                const uint8_t *data)
{
    unsigned length = 0;
    (void)handle;
    for (unsigned i = 0; i < 16; i++) {
        length = header->DataLength == DLC(i) ? sizes[i] : length;
    }
    mailboxes--;
    show(header->Identifier, data, length);
    return header->FDFormat == FDCAN_FD_CAN ? HAL_OK : HAL_ERROR;
}
#endif

#ifdef HAL_CAN_MODULE_ENABLED
CAN_HandleTypeDef hcan;
static CAN_FilterTypeDef filter;

HAL_StatusTypeDef HAL_CAN_ConfigFilter(CAN_HandleTypeDef *handle, const CAN_FilterTypeDef *wanted)
{
    (void)handle;
    filter = *wanted;
    return filter.FilterActivation == CAN_FILTER_ENABLE ? HAL_OK : HAL_ERROR;
}

HAL_StatusTypeDef HAL_CAN_Start(CAN_HandleTypeDef *handle)
{
    (void)handle;
    return HAL_OK;
}

HAL_StatusTypeDef HAL_CAN_ActivateNotification(CAN_HandleTypeDef *handle, uint32_t its)
{
    (void)handle;
    return its == CAN_IT_RX_FIFO0_MSG_PENDING ? HAL_OK : HAL_ERROR;
}

uint32_t HAL_CAN_GetRxFifoFillLevel(const CAN_HandleTypeDef *handle, uint32_t fifo)
{
    uint32_t high = came_id << 5; /* a standard id stands in the upper bits of the filter */
    (void)handle;
    return fifo == CAN_RX_FIFO0 && ((high ^ filter.FilterIdHigh) & filter.FilterMaskIdHigh) == 0
               ? level
               : 0;
}

HAL_StatusTypeDef HAL_CAN_GetRxMessage(CAN_HandleTypeDef *handle, uint32_t fifo,
                                       CAN_RxHeaderTypeDef *header, uint8_t *data)
{
    (void)handle;
    (void)fifo;
    memset(header, 0, sizeof *header);
    header->StdId = came_id;
    header->DLC = came_length;
    memcpy(data, came, 8);
    level = 0;
    return HAL_OK;
}

uint32_t HAL_CAN_GetTxMailboxesFreeLevel(const CAN_HandleTypeDef *handle)
{
    (void)handle;
    return full ? 0 : mailboxes;
}

HAL_StatusTypeDef HAL_CAN_AddTxMessage(CAN_HandleTypeDef *handle, const CAN_TxHeaderTypeDef *header,
                                       const uint8_t *data, uint32_t *mailbox)
{
    (void)handle;
    *mailbox = 1;
    mailboxes--;
    show(header->StdId, data, header->DLC);
    return HAL_OK;
}
#endif

#ifndef HAL_UART_MODULE_ENABLED
static void arrive(uint32_t id, const uint8_t *data, unsigned length)
{
    came_id = id;
    came_length = length;
    memcpy(came, data, length <= sizeof came ? length : sizeof came);
    level = 1;
#ifdef HAL_CAN_MODULE_ENABLED
    HAL_CAN_RxFifo0MsgPendingCallback(&hcan);
#else
    HAL_FDCAN_RxFifo0Callback(&hfdcan1, FDCAN_IT_RX_FIFO0_NEW_MESSAGE);
#endif
}
#endif

static void receive(void)
{
    uint32_t id = (uint32_t)strtoul(strtok(NULL, " \n"), NULL, 16);
    const char *text = strtok(NULL, " \n");
    static uint8_t data[2048];
    unsigned length = 0, value;
    while (text != NULL && length < sizeof data && sscanf(text + 2 * length, "%2x", &value) == 1) {
        data[length++] = (uint8_t)value;
    }
    arrive(id, data, length);
}

static void cycle(void)
{
    unsigned speed;
    printf("tx");
#ifndef HAL_UART_MODULE_ENABLED
    mailboxes = 3;
#endif
    speed = hri_cycle();
    printf("\n%u %lu %s\n", speed, (unsigned long)hri_lost, hri_verdict_name(hri.verdict));
}

int main(void)
{
    static char line[8192];
    setvbuf(stdout, NULL, _IOLBF, BUFSIZ);
    if (!hri_start(65530)) {
        return 2;
    }
    while (fgets(line, sizeof line, stdin) != NULL) {
        const char *command = strtok(line, " \n");
        if (command == NULL || strcmp(command, "cycle") == 0) {
            cycle();
        } else if (strcmp(command, "at") == 0) {
            tick = (uint32_t)strtoul(strtok(NULL, " \n"), NULL, 0);
        } else if (strcmp(command, "rx") == 0) {
            receive();
        } else if (strcmp(command, "press") == 0) {
            hri_press((uint32_t)strtoul(strtok(NULL, " \n"), NULL, 0));
        } else if (strcmp(command, "up") == 0) {
            hri_release();
        } else if (strcmp(command, "error") == 0) {
            fail();
        } else {
            full = strcmp(command, "full") == 0;
        }
    }
    return 0;
}
