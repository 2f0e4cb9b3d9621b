/* What the files of the library share. A controller's program needs hri_predict.h only.
 *
 * These functions begin with hri_lib_, so that they clash with none of the program's.
 */
#ifndef HRI_INTERNAL_H
#define HRI_INTERNAL_H

#include "hri_predict.h"

#define HEADER_CLASSIC 2u /* bytes of protection before the payload */
#define HEADER_FD 3u
#define HEADER_SERIAL 12u
#define CLASSIC_BYTES 8u
#define MASK_CAN 0xFFu /* counters advance modulo 256 on CAN, modulo 65536 on serial lines */
#define MASK_SERIAL 0xFFFFu

/* hri_crc.c: the CRC that a frame must have. The bytes of the CRC itself do not count. */
uint8_t hri_lib_crc_classic(const uint8_t *frame, uint32_t number);
uint16_t hri_lib_crc_fd(const uint8_t *frame, uint32_t length, uint32_t number);
uint32_t hri_lib_crc_serial(const uint8_t *frame, uint32_t length);

/* hri_decode.c: decode a payload into the newest message of its kind; false if it is impossible. */
bool hri_lib_decode(hri_message *message, uint8_t kind, const uint8_t *p, uint32_t length);

/* hri_decode.c: kind of the frame of this number; HRI_NOTHING if it is not for this robot. */
uint8_t hri_lib_kind(uint32_t number, uint32_t robot, bool wide);

/* hri_rule.c: judge a payload with a right CRC; return its kind, or HRI_NOTHING. */
uint8_t hri_lib_accept(hri_receiver *r, uint8_t kind, uint16_t counter, const uint8_t *payload,
                       uint32_t length, uint32_t now_ms);

/* hri_rule.c: forget what is too old. Whoever gets a time calls it first. */
void hri_lib_watch(hri_receiver *r, uint32_t now_ms);

/* hri_rule.c: how many errors there were so far, and a note if there are more than before. */
uint32_t hri_lib_error_count(const hri_counts *c);
void hri_lib_note_errors(hri_receiver *r, uint32_t before, uint32_t now_ms);

#endif
