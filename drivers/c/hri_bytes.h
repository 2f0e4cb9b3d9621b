/* Numbers as bytes. Payloads and frames of CAN have the low byte first, headers of serial lines the
 * high byte. */
#ifndef HRI_BYTES_H
#define HRI_BYTES_H

#include <stdint.h>

static inline uint16_t get_u16(const uint8_t *p)
{
    return (uint16_t)(p[0] | ((uint32_t)p[1] << 8));
}

static inline int16_t get_i16(const uint8_t *p)
{
    uint16_t raw = get_u16(p);
    return (raw < 0x8000u) ? (int16_t)raw : (int16_t)((int32_t)raw - 0x10000);
}

static inline uint32_t get_u32(const uint8_t *p)
{
    return get_u16(p) | ((uint32_t)get_u16(&p[2]) << 16);
}

/* A number of up to 25 bits that may begin and end inside a byte; bit 0 is the lowest of p[0]. */
static inline uint32_t get_bits(const uint8_t *p, uint32_t first, uint32_t bits)
{
    uint32_t value = 0u;
    for (uint32_t i = first / 8u; i <= ((first + bits - 1u) / 8u); i++) {
        value |= (uint32_t)p[i] << (8u * (i - (first / 8u)));
    }
    return (value >> (first % 8u)) & (((uint32_t)1u << bits) - 1u);
}

static inline uint32_t get_big_u32(const uint8_t *p)
{
    return ((uint32_t)p[0] << 24) | ((uint32_t)p[1] << 16) | ((uint32_t)p[2] << 8) | p[3];
}

static inline void put_u16(uint8_t *p, uint32_t value)
{
    p[0] = (uint8_t)(value & 0xFFu);
    p[1] = (uint8_t)((value >> 8) & 0xFFu);
}

static inline void put_big_u32(uint8_t *p, uint32_t value)
{
    for (uint32_t i = 0u; i < 4u; i++) {
        p[i] = (uint8_t)((value >> (24u - (8u * i))) & 0xFFu);
    }
}

#endif
