/* The CRCs of the three kinds of link, four bits at a time. */
#include "hri_bytes.h"
#include "hri_internal.h"

static uint8_t crc8(uint8_t start, const uint8_t *data, uint32_t length)
{
    static const uint8_t table[16] = {0x00u, 0x2Fu, 0x5Eu, 0x71u, 0xBCu, 0x93u, 0xE2u, 0xCDu,
                                      0x57u, 0x78u, 0x09u, 0x26u, 0xEBu, 0xC4u, 0xB5u, 0x9Au};
    uint8_t crc = start;
    for (uint32_t i = 0u; i < length; i++) {
        crc = (uint8_t)(crc ^ data[i]);
        crc = (uint8_t)(((uint32_t)crc << 4) ^ table[crc >> 4]);
        crc = (uint8_t)(((uint32_t)crc << 4) ^ table[crc >> 4]);
    }
    return crc;
}

static uint16_t crc16(uint16_t start, const uint8_t *data, uint32_t length)
{
    static const uint16_t table[16] = {0x0000u, 0x1021u, 0x2042u, 0x3063u, 0x4084u, 0x50A5u,
                                       0x60C6u, 0x70E7u, 0x8108u, 0x9129u, 0xA14Au, 0xB16Bu,
                                       0xC18Cu, 0xD1ADu, 0xE1CEu, 0xF1EFu};
    uint16_t crc = start;
    for (uint32_t i = 0u; i < length; i++) {
        crc = (uint16_t)(crc ^ ((uint32_t)data[i] << 8));
        crc = (uint16_t)(((uint32_t)crc << 4) ^ table[crc >> 12]);
        crc = (uint16_t)(((uint32_t)crc << 4) ^ table[crc >> 12]);
    }
    return crc;
}

static uint32_t crc32(uint32_t start, const uint8_t *data, uint32_t length)
{
    static const uint32_t table[16] = {
        0x00000000u, 0x2B2C2BEEu, 0x565857DCu, 0x7D747C32u, 0xACB0AFB8u, 0x879C8456u,
        0xFAE8F864u, 0xD1C4D38Au, 0xC8DF352Fu, 0xE3F31EC1u, 0x9E8762F3u, 0xB5AB491Du,
        0x646F9A97u, 0x4F43B179u, 0x3237CD4Bu, 0x191BE6A5u};
    uint32_t crc = start;
    for (uint32_t i = 0u; i < length; i++) {
        crc ^= data[i];
        crc = (crc >> 4) ^ table[crc & 15u];
        crc = (crc >> 4) ^ table[crc & 15u];
    }
    return crc;
}

uint8_t hri_lib_crc_classic(const uint8_t *frame, uint32_t number)
{
    uint8_t data_id = (uint8_t)(number + 1u);
    return crc8(crc8(0xFFu, &frame[1], CLASSIC_BYTES - 1u), &data_id, 1u) ^ 0xFFu;
}

uint16_t hri_lib_crc_fd(const uint8_t *frame, uint32_t length, uint32_t number)
{
    uint8_t data_id[2];
    put_u16(data_id, HRI_DATA_ID_16 + number);
    return crc16(crc16(0xFFFFu, &frame[2], length - 2u), data_id, 2u);
}

uint32_t hri_lib_crc_serial(const uint8_t *frame, uint32_t length)
{
    uint32_t crc = crc32(0xFFFFFFFFu, frame, 8u);
    return crc32(crc, &frame[HEADER_SERIAL], length - HEADER_SERIAL) ^ 0xFFFFFFFFu;
}
