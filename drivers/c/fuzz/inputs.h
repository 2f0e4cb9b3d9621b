/* What fuzz.c and errors.c share: seeds, dice, and a second implementation of the protection. */
#ifndef HRI_INPUTS_H
#define HRI_INPUTS_H

#include "hri_predict.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SEEDS 256
#define ROOM 256 /* bytes of an input at most */

typedef struct {
    uint8_t link;
    uint32_t id;
    unsigned length;
    uint8_t data[ROOM];
} input;

static input seeds[SEEDS];
static unsigned seed_count;
static uint64_t state;

/* xorshift64*: Vigna, "An experimental exploration of Marsaglia's xorshift generators", 2016. */
static inline uint32_t dice(uint32_t sides)
{
    state ^= state >> 12;
    state ^= state << 25;
    state ^= state >> 27;
    return (uint32_t)((state * 0x2545F4914F6CDD1Du) >> 33) % sides;
}

/* CRCs bit by bit: nothing here is shared with the library. */
static inline uint32_t crc_bits(const uint8_t *data, unsigned length, unsigned width, uint32_t polynomial,
                         uint32_t value)
{
    uint32_t top = (uint32_t)1 << (width - 1);
    for (unsigned i = 0; i < length; i++) {
        value ^= (uint32_t)data[i] << (width - 8);
        for (unsigned bit = 0; bit < 8; bit++) {
            value = (value << 1) ^ ((value & top) != 0 ? polynomial : 0);
        }
    }
    return width == 32 ? value : value & ((top << 1) - 1);
}

static inline uint32_t reflected_crc32(const uint8_t *data, unsigned length)
{
    uint32_t value = 0xFFFFFFFFu;
    for (unsigned i = 0; i < length; i++) {
        value ^= data[i];
        for (unsigned bit = 0; bit < 8; bit++) {
            value = (value >> 1) ^ ((value & 1) != 0 ? 0xC8DF352Fu : 0);
        }
    }
    return ~value;
}

/* Put the right CRC into a CAN frame. */
static inline void sign_can(input *in)
{
    uint8_t whole[ROOM + 2];
    uint32_t number = in->id - HRI_DEFAULT_BASE_ID;
    uint32_t crc;
    if (in->length < 4) {
        return;
    }
    memcpy(whole, in->data, in->length);
    whole[in->length] = (uint8_t)(in->link == HRI_FD ? number : number + 1);
    whole[in->length + 1] = 0x48;
    if (in->link == HRI_CLASSIC) {
        in->data[0] = (uint8_t)~crc_bits(whole + 1, in->length, 8, 0x2F, 0xFF);
    } else {
        crc = crc_bits(whole + 2, in->length, 16, 0x1021, 0xFFFF);
        in->data[0] = (uint8_t)crc;
        in->data[1] = (uint8_t)(crc >> 8);
    }
}

/* COBS, with the zero that ends it; inputs are shorter than 254 bytes. */
static inline unsigned stuff(uint8_t *out, const uint8_t *in, unsigned length)
{
    unsigned code = 0, at = 1;
    for (unsigned i = 0; i < length; i++) {
        if (in[i] == 0) {
            out[code] = (uint8_t)(at - code);
            code = at++;
        } else {
            out[at++] = in[i];
        }
    }
    out[code] = (uint8_t)(at - code);
    out[at++] = 0;
    return at;
}

static inline unsigned unstuff(uint8_t *out, const uint8_t *in, unsigned length)
{
    unsigned at = 0, i = 0;
    while (i + 1 < length && in[i] != 0) {
        unsigned code = in[i++];
        for (unsigned k = 1; k < code && i + 1 < length; k++) {
            out[at++] = in[i++];
        }
        if (i + 1 < length) {
            out[at++] = 0;
        }
    }
    return at;
}

/* Mutate what is protected, then protect it again. */
static inline void sign_serial(input *in, const uint8_t *frame, unsigned length)
{
    uint8_t whole[ROOM];
    uint8_t body[ROOM];
    uint32_t crc;
    memcpy(whole, frame, length);
    if (length >= 12) {
        whole[0] = 0;
        whole[1] = (uint8_t)length;
        memcpy(body, whole, 8);
        memcpy(body + 8, whole + 12, length - 12);
        crc = reflected_crc32(body, length - 4);
        for (unsigned i = 0; i < 4; i++) {
            whole[8 + i] = (uint8_t)(crc >> (24 - 8 * i));
        }
    }
    in->length = stuff(in->data, whole, length);
}

static inline unsigned parse(const char *text, uint8_t *bytes)
{
    unsigned length = 0, value;
    while (length < ROOM && sscanf(text + 2 * length, "%2x", &value) == 1) {
        bytes[length++] = (uint8_t)value;
    }
    return length;
}

static inline void load(const char *path)
{
    char kind[16], first[2 * ROOM + 2], second[2 * ROOM + 2], line[1200];
    FILE *file = fopen(path, "r");
    if (file == NULL) {
        perror(path);
        exit(2);
    }
    while (seed_count < SEEDS && fgets(line, sizeof line, file) != NULL) {
        input *in = &seeds[seed_count];
        int words = sscanf(line, "%15s %513s %513s", kind, first, second);
        if (words < 2 || kind[0] == '#') {
            continue;
        }
        in->link = kind[0] == 'c' ? HRI_CLASSIC : kind[0] == 'f' ? HRI_FD : HRI_SERIAL;
        in->id = in->link == HRI_SERIAL ? 0 : (uint32_t)strtoul(first, NULL, 16);
        in->length = parse(in->link == HRI_SERIAL ? first : second, in->data);
        seed_count++;
    }
    fclose(file);
    if (seed_count == 0) {
        fprintf(stderr, "%s: no seeds\n", path);
        exit(2);
    }
}

#endif
