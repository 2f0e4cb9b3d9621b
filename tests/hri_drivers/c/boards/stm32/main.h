/* As much of CubeMX's main.h and of ST's HAL as the examples use, for the tests. */
#ifndef MAIN_H
#define MAIN_H

#include <stdint.h>

typedef enum { HAL_OK, HAL_ERROR, HAL_BUSY, HAL_TIMEOUT } HAL_StatusTypeDef;

#define __DMB() __asm__ volatile("" ::: "memory")

uint32_t HAL_GetTick(void);

#ifdef HAL_FDCAN_MODULE_ENABLED
typedef struct { uint32_t Instance; } FDCAN_HandleTypeDef;
typedef struct {
    uint32_t Identifier, IdType, RxFrameType, DataLength, ErrorStateIndicator, BitRateSwitch;
    uint32_t FDFormat, RxTimestamp, FilterIndex, IsFilterMatchingFrame;
} FDCAN_RxHeaderTypeDef;
typedef struct {
    uint32_t Identifier, IdType, TxFrameType, DataLength, ErrorStateIndicator, BitRateSwitch;
    uint32_t FDFormat, TxEventFifoControl, MessageMarker;
} FDCAN_TxHeaderTypeDef;

#define FDCAN_STANDARD_ID 0x00000000u
#define FDCAN_EXTENDED_ID 0x40000000u
#define FDCAN_DATA_FRAME 0x00000000u
#define FDCAN_ESI_ACTIVE 0x00000000u
#define FDCAN_BRS_ON 0x00100000u
#define FDCAN_CLASSIC_CAN 0x00000000u
#define FDCAN_FD_CAN 0x00200000u
#define FDCAN_NO_TX_EVENTS 0x00000000u
#define FDCAN_RX_FIFO0 0x00000040u
#define FDCAN_IT_RX_FIFO0_NEW_MESSAGE 0x00000001u
#ifdef HRI_TEST_SHIFTED_DLC /* as the H7's HAL had it */
#define DLC(code) ((code) << 16)
#else
#define DLC(code) (code)
#endif
#define FDCAN_DLC_BYTES_0 DLC(0u)
#define FDCAN_DLC_BYTES_1 DLC(1u)
#define FDCAN_DLC_BYTES_2 DLC(2u)
#define FDCAN_DLC_BYTES_3 DLC(3u)
#define FDCAN_DLC_BYTES_4 DLC(4u)
#define FDCAN_DLC_BYTES_5 DLC(5u)
#define FDCAN_DLC_BYTES_6 DLC(6u)
#define FDCAN_DLC_BYTES_7 DLC(7u)
#define FDCAN_DLC_BYTES_8 DLC(8u)
#define FDCAN_DLC_BYTES_12 DLC(9u)
#define FDCAN_DLC_BYTES_16 DLC(10u)
#define FDCAN_DLC_BYTES_20 DLC(11u)
#define FDCAN_DLC_BYTES_24 DLC(12u)
#define FDCAN_DLC_BYTES_32 DLC(13u)
#define FDCAN_DLC_BYTES_48 DLC(14u)
#define FDCAN_DLC_BYTES_64 DLC(15u)

HAL_StatusTypeDef HAL_FDCAN_Start(FDCAN_HandleTypeDef *handle);
HAL_StatusTypeDef HAL_FDCAN_ActivateNotification(FDCAN_HandleTypeDef *handle, uint32_t its,
                                                 uint32_t buffers);
uint32_t HAL_FDCAN_GetRxFifoFillLevel(const FDCAN_HandleTypeDef *handle, uint32_t fifo);
HAL_StatusTypeDef HAL_FDCAN_GetRxMessage(FDCAN_HandleTypeDef *handle, uint32_t fifo,
                                         FDCAN_RxHeaderTypeDef *header, uint8_t *data);
uint32_t HAL_FDCAN_GetTxFifoFreeLevel(const FDCAN_HandleTypeDef *handle);
HAL_StatusTypeDef HAL_FDCAN_AddMessageToTxFifoQ(FDCAN_HandleTypeDef *handle,
                                                const FDCAN_TxHeaderTypeDef *header,
                                                const uint8_t *data);
void HAL_FDCAN_RxFifo0Callback(FDCAN_HandleTypeDef *handle, uint32_t its);
#endif

#ifdef HAL_CAN_MODULE_ENABLED
typedef struct { uint32_t Instance; } CAN_HandleTypeDef;
typedef struct {
    uint32_t StdId, ExtId, IDE, RTR, DLC, Timestamp, FilterMatchIndex;
} CAN_RxHeaderTypeDef;
typedef struct { uint32_t StdId, ExtId, IDE, RTR, DLC, TransmitGlobalTime; } CAN_TxHeaderTypeDef;
typedef struct {
    uint32_t FilterIdHigh, FilterIdLow, FilterMaskIdHigh, FilterMaskIdLow, FilterFIFOAssignment;
    uint32_t FilterBank, FilterMode, FilterScale, FilterActivation, SlaveStartFilterBank;
} CAN_FilterTypeDef;

#define CAN_ID_STD 0x00000000u
#define CAN_ID_EXT 0x00000004u
#define CAN_RTR_DATA 0x00000000u
#define CAN_RX_FIFO0 0x00000000u
#define CAN_FILTERMODE_IDMASK 0x00000000u
#define CAN_FILTERSCALE_32BIT 0x00000001u
#define CAN_FILTER_ENABLE 0x00000001u
#define CAN_IT_RX_FIFO0_MSG_PENDING 0x00000002u

HAL_StatusTypeDef HAL_CAN_ConfigFilter(CAN_HandleTypeDef *handle, const CAN_FilterTypeDef *filter);
HAL_StatusTypeDef HAL_CAN_Start(CAN_HandleTypeDef *handle);
HAL_StatusTypeDef HAL_CAN_ActivateNotification(CAN_HandleTypeDef *handle, uint32_t its);
uint32_t HAL_CAN_GetRxFifoFillLevel(const CAN_HandleTypeDef *handle, uint32_t fifo);
HAL_StatusTypeDef HAL_CAN_GetRxMessage(CAN_HandleTypeDef *handle, uint32_t fifo,
                                       CAN_RxHeaderTypeDef *header, uint8_t *data);
uint32_t HAL_CAN_GetTxMailboxesFreeLevel(const CAN_HandleTypeDef *handle);
HAL_StatusTypeDef HAL_CAN_AddTxMessage(CAN_HandleTypeDef *handle, const CAN_TxHeaderTypeDef *header,
                                       const uint8_t *data, uint32_t *mailbox);
void HAL_CAN_RxFifo0MsgPendingCallback(CAN_HandleTypeDef *handle);
#endif

#ifdef HAL_UART_MODULE_ENABLED
typedef struct { volatile uint32_t gState; } UART_HandleTypeDef;

#define HAL_UART_STATE_READY 0x00000020u
#define HAL_UART_STATE_BUSY_TX 0x00000021u

HAL_StatusTypeDef HAL_UARTEx_ReceiveToIdle_DMA(UART_HandleTypeDef *handle, uint8_t *data,
                                               uint16_t size);
HAL_StatusTypeDef HAL_UART_Transmit_DMA(UART_HandleTypeDef *handle, const uint8_t *data,
                                        uint16_t size);
void HAL_UARTEx_RxEventCallback(UART_HandleTypeDef *handle, uint16_t position);
void HAL_UART_ErrorCallback(UART_HandleTypeDef *handle);
#endif

#endif
