/* The controller's side of hri-predict, for PLCs and microcontrollers, in C99.
 *
 * It receives the node's messages over classic CAN, CAN FD or a serial line, checks them (CRC,
 * counter, length, schema, age) and answers one question: how fast may the robot move now? Silence,
 * stale, corrupt or out-of-order messages, an unknown schema, and any level but clear, warn or slow
 * mean stop. ../PROTOCOL.md describes the wire byte by byte.
 *
 * No allocation, no recursion, no globals, no floating point; one hri_receiver (some 600 bytes) per
 * link and robot, used by one task at a time. Time is any free-running millisecond tick that the
 * caller passes; it may wrap.
 *
 * The node advises; it is not a safety function, and neither is this library.
 */
#ifndef HRI_PREDICT_H
#define HRI_PREDICT_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" { /* the sources are C; an Arduino sketch or a C++ program links them */
#endif

/* generated: begin constants (renew: hri-predict protocol files) */
#define HRI_SCHEMA_VERSION 3u
#define HRI_SCHEMA_HASH 0x85D20FC9u
#define HRI_DEFAULT_BASE_ID 0x680u
#define HRI_LAST_NUMBER 0x5Fu
#define HRI_MAX_ROBOTS 8u
#define HRI_ROBOT_STRIDE 8u
#define HRI_MAX_JOINTS 9u
#define HRI_MAX_DELTA 5u
#define HRI_RESYNC 3u
#define HRI_FORGET_MS 1000u
#define HRI_DATA_ID_16 0x4800u
#define HRI_DATA_ID_32 0x48520000u
#define HRI_PART_BYTES 6u
#define HRI_PARTS_ADVICE 3u
#define HRI_PARTS_STATE 9u
#define HRI_PARTS_STATE_ALWAYS 5u
#define HRI_BASE_ROBOTS 4u
#define HRI_EXTRA_STRIDE 2u
#define HRI_NUMBER_STATE_PART_5 0x48u
#define HRI_NUMBER_STATE_PART_6 0x49u
#define HRI_NUMBER_STATE_PART_7 0x58u
#define HRI_NUMBER_STATE_PART_8 0x59u
#define HRI_ZONE_ITEMS 3u
#define HRI_POSE_ITEMS 7u
#define HRI_ITEM_BYTES_ZONE 15u
#define HRI_ITEM_BYTES_POSE 7u
#define HRI_SERIAL_BYTES 72u
#define HRI_NUMBER_ADVICE 0x00u
#define HRI_BYTES_ADVICE 18u
#define HRI_NUMBER_ROBOT_STATE 0x03u
#define HRI_BYTES_ROBOT_STATE 54u
#define HRI_NUMBER_STATUS 0x40u
#define HRI_BYTES_STATUS 6u
#define HRI_NUMBER_ACKNOWLEDGE 0x41u
#define HRI_BYTES_ACKNOWLEDGE 6u
#define HRI_NUMBER_SCHEMA 0x42u
#define HRI_BYTES_SCHEMA 6u
#define HRI_NUMBER_ZONE 0x44u
#define HRI_BYTES_ZONE 10u
#define HRI_NUMBER_POSE 0x45u
#define HRI_BYTES_POSE 10u
#define HRI_LEVEL_UNKNOWN 0u
#define HRI_LEVEL_CLEAR 1u
#define HRI_LEVEL_WARN 2u
#define HRI_LEVEL_SLOW 3u
#define HRI_LEVEL_STOP 4u
#define HRI_LEVEL_FAULT 5u
#define HRI_REASON_NONE 0u
#define HRI_REASON_PERSON_NEAR 1u
#define HRI_REASON_PERSON_APPROACHING 2u
#define HRI_REASON_ZONE_OCCUPIED 3u
#define HRI_REASON_ZONE_ENTRY_PREDICTED 4u
#define HRI_REASON_OUT_OF_VIEW 5u
#define HRI_REASON_PERSON_LOST 6u
#define HRI_REASON_LATCHED 7u
#define HRI_REASON_RELEASE_PENDING 8u
#define HRI_REASON_PERSON_FAST 9u
#define HRI_REASON_SPEED_UNKNOWN 10u
#define HRI_REASON_CONTACT_POSSIBLE 11u
#define HRI_REASON_NO_INPUT 20u
#define HRI_REASON_INPUT_STALE 21u
#define HRI_REASON_INPUT_FROZEN 22u
#define HRI_REASON_INPUT_IMPOSSIBLE 23u
#define HRI_REASON_SOURCE_BLIND 24u
#define HRI_REASON_CLOCK_JUMP 25u
#define HRI_REASON_ROOM_NOT_SEEN_EMPTY 26u
#define HRI_REASON_TOO_MANY_PEOPLE 27u
#define HRI_REASON_PERSON_NOT_LOCATED 28u
#define HRI_REASON_BODY_NOT_UPRIGHT 29u
#define HRI_REASON_ROBOT_STATE_STALE 30u
#define HRI_REASON_ROBOT_NOT_AUTOMATIC 31u
#define HRI_REASON_ROBOT_STATE_INVALID 32u
#define HRI_REASON_ROBOT_VELOCITY_WRONG 33u
#define HRI_REASON_ROBOT_STATE_JUMPED 34u
#define HRI_REASON_ROBOT_TOO_FAST 35u
#define HRI_REASON_ROBOT_STOPS_LATE 36u
#define HRI_REASON_ROBOT_BASE_UNKNOWN 37u
#define HRI_REASON_ROBOT_STATE_FROZEN 38u
#define HRI_REASON_ROBOT_STATES_CONTRADICT 39u
#define HRI_REASON_PREDICTOR_FAILED 40u
#define HRI_REASON_PREDICTOR_LATE 41u
#define HRI_REASON_NODE_FAULT 42u
#define HRI_REASON_SHADOW_MODE 43u
#define HRI_REASON_STARTING 44u
#define HRI_REASON_STOPPING 45u
#define HRI_REASON_HORIZON_TOO_SHORT 46u
#define HRI_REASON_ZONES_WIDENED 47u
#define HRI_REASON_MOTION_UNLIKE 48u
#define HRI_REASON_SECOND_SENDER 49u
#define HRI_REASON_CLOCK_DRIFT 50u
#define HRI_REASON_CALIBRATION_DRIFT 51u
#define HRI_REASON_LOAD_SHED 52u
#define HRI_REASON_ACKNOWLEDGE_REPEATED 53u
#define HRI_REASON_STATE_UNTRUSTED 54u
#define HRI_REASON_INPUT_REPEATS 55u
#define HRI_REASON_INPUT_RELATIVE 56u
#define HRI_REASON_SENSOR_SILENT 57u
#define HRI_REASON_SENSORS_DISAGREE 58u
#define HRI_REASON_SET_UNKNOWN 59u
#define HRI_REASON_TEACH 60u
#define HRI_REASON_RECOVERY 61u
#define HRI_REASON_MUTED 62u
#define HRI_REASON_SENSOR_MOVED 63u
#define HRI_NODE_STATE_UNKNOWN 0u
#define HRI_NODE_STATE_STARTING 1u
#define HRI_NODE_STATE_RUNNING 2u
#define HRI_NODE_STATE_DEGRADED 3u
#define HRI_NODE_STATE_FAULT 4u
#define HRI_NODE_STATE_STOPPING 5u
#define HRI_MODE_UNKNOWN 0u
#define HRI_MODE_AUTOMATIC 1u
#define HRI_MODE_MANUAL 2u
#define HRI_MODE_MAINTENANCE 3u
#define HRI_MODE_DRIVES_OFF 4u
#define HRI_OPERATING_MODE_AUTOMATIC 0u
#define HRI_OPERATING_MODE_TEACH 1u
#define HRI_OPERATING_MODE_RECOVERY 2u
#define HRI_OPERATING_MODE_MUTED 3u
/* generated: end */

/* How the node is connected (hri_settings.link). */
#define HRI_CLASSIC 0u /* classic CAN: E2E profile 2, messages in parts of six bytes */
#define HRI_FD 1u      /* CAN FD: E2E profile 5 */
#define HRI_SERIAL 2u  /* serial line: COBS, E2E profile 4 */

/* Kinds of message that hri_receive_... returns; hri_receiver.message then holds the message. */
/* generated: begin kinds (renew: hri-predict protocol files) */
#define HRI_NOTHING 0u
#define HRI_ADVICE 1u
#define HRI_STATUS 2u
#define HRI_SCHEMA 3u
#define HRI_ZONE 4u
#define HRI_POSE 5u
#define HRI_KINDS 6u
/* generated: end */

/* Codes of "not available": never 0, never "far away". */
/* generated: begin codes (renew: hri-predict protocol files) */
#define HRI_NO_I16 (-32767 - 1)
#define HRI_NO_U12 0xFFFu
#define HRI_NO_U16 0xFFFFu
#define HRI_NO_U6 0x3Fu
#define HRI_NO_U8 0xFFu
/* generated: end */
#define HRI_NO_I32 INT32_MIN /* in hri_robot_state */

/* What determines the permitted speed (hri_receiver.verdict); all but the first mean stop. */
#define HRI_BY_ADVICE 0u       /* the newest Advice does; it may be a stop as well */
#define HRI_NOT_CONFIGURED 1u  /* hri_init refused the settings */
#define HRI_STARTING 2u        /* no Advice yet */
#define HRI_SILENT 3u          /* no fresh Advice within silence_timeout_ms */
#define HRI_NO_SCHEMA 4u       /* no Schema yet */
#define HRI_OTHER_SCHEMA 5u    /* another version or hash: see message.schema of the last one */
#define HRI_ERRORS 6u          /* more than tolerated_errors corrupt, lost or repeated messages */
#define HRI_NO_AGE 7u          /* AGE or ECHO not available, or no such RobotState sent lately */
#define HRI_STALE 8u           /* older than max_age_ms, delay of the link included */

/* Send times kept of RobotStates: (max_age_ms + silence_timeout_ms) / period + 1, at most 255. */
#ifndef HRI_SENT_KEPT
#define HRI_SENT_KEPT 32u
#endif
#define HRI_UNIT_BYTES 68u  /* longest frame that a controller sends */

typedef struct {
    uint8_t link;                /* HRI_CLASSIC, HRI_FD or HRI_SERIAL */
    uint8_t robot;               /* index of the robot in the node's configuration, 0..7 */
    bool extended;               /* CAN: 29-bit ids */
    uint32_t base_id;            /* CAN: the link's base_id, HRI_DEFAULT_BASE_ID by default */
    uint16_t silence_timeout_ms; /* the link's silence_timeout_s, 60 by default */
    uint16_t max_age_ms;         /* printed by `hri-predict check` for controllers */
    uint16_t tolerated_errors;   /* more bad or missing messages than this stop the robot: 0, ... */
    uint16_t error_window_ms;    /* ... until none comes for this time; 0: forever */
    uint16_t first_state_counter; /* from a clock or random: different after each start */
} hri_settings;

/* generated: begin structures (renew: hri-predict protocol files) */
typedef struct {
    uint8_t level; /* requested level; any value but 1, 2 or 3 means stop; HRI_LEVEL_... */
    uint8_t operating_mode; /* operating mode in force; HRI_OPERATING_MODE_... */
    uint8_t reason; /* reason for the level; HRI_REASON_... */
    /* limit for the robot's fastest point; not available means 0; HRI_NO_U16: not available */
    uint16_t speed_limit_mm_s;
    /* smallest distance between a body and the robot now; HRI_NO_I16: not available */
    int16_t separation_mm;
    /* smallest distance until the robot can have stopped; HRI_NO_I16: not available */
    int16_t predicted_separation_mm;
    /* STATE_COUNTER of the last RobotState that the node received; HRI_NO_U16: not available */
    uint16_t echo;
    /* age of the underlying capture when the frame was encoded; add the time since receipt;
     * HRI_NO_U16: not available */
    uint16_t age_ms;
    /* id that an Acknowledge must carry now; 0: there is nothing to acknowledge */
    uint16_t latch_id;
    uint8_t tool; /* number of the tool set that the node assumes; HRI_NO_U8: not available */
    /* time until the separation may be violated; 0 if it already is; HRI_NO_U12: not available */
    uint16_t time_to_breach_ms;
    uint8_t body_part; /* index of the deciding body segment; HRI_NO_U6: not available */
    uint8_t robot_link; /* index of the deciding robot capsule; HRI_NO_U6: not available */
} hri_advice;

typedef struct {
    uint8_t node_state; /* life cycle of the node; HRI_NODE_STATE_... */
    uint8_t people; /* number of people; 15 means 15 or more */
    uint8_t reason; /* the worst active condition; HRI_REASON_... */
    uint8_t predictor; /* index of the active predictor */
    uint8_t cycle; /* number of the node's cycle, modulo 256 */
    /* age of the underlying capture when the frame was encoded; add the time since receipt;
     * HRI_NO_U16: not available */
    uint16_t age_ms;
} hri_status;

typedef struct {
    uint16_t version; /* protocol version */
    uint32_t hash; /* hash of the definitions */
} hri_schema;

typedef struct {
    uint8_t segment; /* index of the body segment */
    int16_t a_mm[3]; /* first end of its capsule */
    int16_t b_mm[3]; /* second end of its capsule */
    uint16_t radius_mm; /* radius of its capsule */
} hri_capsule;

typedef struct {
    uint8_t joint; /* index of the joint */
    int16_t position_mm[3]; /* position in the room */
} hri_joint;

/* One frame of a Zone (capsules) or of a Pose (joints): items first .. first + count - 1. */
typedef struct {
    uint16_t person; /* id of the person, modulo 65536 */
    uint8_t step; /* horizon step; 0 is the body as captured */
    uint16_t horizon_ms; /* time ahead of the capture */
    /* age of the underlying capture when the frame was encoded; add the time since receipt;
     * HRI_NO_U16: not available */
    uint16_t age_ms;
    uint8_t first; /* index of this frame's first item among all items of this person and step */
    uint8_t total; /* number of items of this person and step */
    uint8_t count; /* number of items in this frame */
    hri_capsule capsules[HRI_ZONE_ITEMS];
    hri_joint joints[HRI_POSE_ITEMS];
} hri_body;

/* The newest message of each kind; no union (MISRA C:2012, rule 19.2). */
typedef struct {
    hri_advice advice;
    hri_status status;
    hri_schema schema;
    hri_body body;
} hri_message;
/* generated: end */

/* Counts since hri_init. Show them: a line with errors every day needs repair. */
typedef struct {
    uint32_t received;       /* fresh messages */
    uint32_t crc_errors;     /* frames with a wrong CRC */
    uint32_t counter_errors; /* messages repeated, out of order, or missing between two others */
    uint32_t malformed;      /* right CRC but wrong length or values, or bytes without a frame */
    uint32_t incomplete;     /* multi-frame messages with frames missing */
    uint32_t ignored;        /* frames of other senders or for other robots */
} hri_counts;

typedef struct {
    bool started;
    bool following; /* candidate belongs to a run */
    uint8_t run;
    uint16_t last;
    uint16_t candidate;
} hri_sequence;

typedef struct {
    hri_settings settings;
    hri_message message; /* the newest of each kind */
    hri_counts counts;
    uint8_t verdict; /* of the last hri_permitted_speed */

    /* The rest is internal to the library. */
    bool configured;
    bool schema_heard;
    bool schema_matches;
    uint32_t heard_ms;   /* when the newest Schema or fresh Advice arrived */
    uint8_t phase;       /* of the Advice: starting, advised, silent */
    uint32_t advised_ms; /* when the newest valid one arrived, */
    uint8_t level;       /* its level, */
    uint16_t speed_mm_s;
    bool age_bounded; /* and the largest age of its data at that time */
    uint32_t age_at_receipt_ms;
    uint32_t errors;
    uint32_t error_ms; /* when the last of them arrived */
    hri_sequence sequences[HRI_KINDS];
    uint8_t part_counter; /* classic CAN: of the incomplete Advice */
    uint8_t part_mask;    /* bit p: part p has arrived */
    bool part_started;
    uint8_t parts[HRI_BYTES_ADVICE];
    uint8_t line[HRI_SERIAL_BYTES]; /* serial: the current frame */
    uint8_t line_length;
    bool line_skipping;
    uint16_t state_counter; /* of the newest RobotState */
    uint16_t state_sequence;
    uint16_t ack_sequence;
    uint32_t sent_ms[HRI_SENT_KEPT]; /* ring: send times of the newest RobotStates */
    uint8_t sent_newest;
    uint8_t sent_kept;
} hri_receiver;

/* The state of the robot. Positions in microradians, velocities in microradians per second; of
 * prismatic joints in micrometres and micrometres per second. Velocities saturate. A position beyond
 * what the wire can hold, or HRI_NO_I32, means not available, which voids the message. */
typedef struct {
    uint8_t mode;   /* HRI_MODE_... */
    uint8_t joints; /* at most HRI_MAX_JOINTS */
    int32_t position_urad[HRI_MAX_JOINTS];
    int32_t velocity_urad_s[HRI_MAX_JOINTS];
    uint8_t request;     /* HRI_OPERATING_MODE_... that the operator asks for */
    bool enabling;       /* the enabling device is held */
    uint8_t tool;        /* number of the tool set in use, HRI_NO_U8: not said */
    bool tool_confirmed; /* the controller has checked it */
    bool base_moves;     /* on classic CAN robots 0 to HRI_BASE_ROBOTS - 1 only */
    int32_t base_um[2];  /* x and y of the base in the room */
    int32_t base_yaw_urad;
    int32_t base_um_s[2];
    int32_t base_yaw_urad_s;
} hri_robot_state;

/* One frame to send: CAN with its id, or serial with its delimiter. */
typedef struct {
    uint32_t id;
    uint8_t length;
    uint8_t data[HRI_UNIT_BYTES];
} hri_unit;

/* Start or restart. False for invalid settings: the receiver then says stop forever. */
bool hri_init(hri_receiver *r, const hri_settings *settings);

/* Take one CAN frame; return the kind of the fresh message that it completes, or HRI_NOTHING. */
uint8_t hri_receive_can(hri_receiver *r, uint32_t id, bool extended, bool fd, const uint8_t *data,
                        uint8_t length, uint32_t now_ms);

/* Take one byte of a serial line; return the same. */
uint8_t hri_receive_serial_byte(hri_receiver *r, uint8_t byte, uint32_t now_ms);

/* Return how fast the fastest point of the robot may move now, in mm/s; 0 means stop. Call it in
 * the fastest task, at least every silence_timeout_ms / 10, even if nothing arrives. The reason is
 * in r->verdict and, for HRI_BY_ADVICE, in r->message.advice. */
uint16_t hri_permitted_speed(hri_receiver *r, uint32_t now_ms);

/* A word for a verdict, for display. */
const char *hri_verdict_name(uint8_t verdict);

/* Encode a RobotState; return how many units to send now, in order (at most HRI_PARTS_STATE), or 0
 * for too many joints, or a moving base of a robot that has none on classic CAN. The library keeps
 * the time, which bounds the age of the echoing Advice. */
uint8_t hri_send_robot_state(hri_receiver *r, const hri_robot_state *state, uint32_t now_ms,
                             hri_unit units[HRI_PARTS_STATE]);

/* A person has pressed the button: encode an Acknowledge of the latch_id that was shown then, as one
 * unit; return 1, or 0 if not configured or if latch_id is 0, since there is nothing to acknowledge.
 * Repeat it a few times within 1 s with the same ack_id, not 0; use a new ack_id, also after a start
 * of yours, for the next press. Only a press counts that comes 12 s or more after the one before. */
uint8_t hri_acknowledge(hri_receiver *r, uint16_t latch_id, uint32_t ack_id, hri_unit *unit);

/* The button of that press has been released: one unit, to be repeated likewise; return 0 if not
 * configured or if ack_id is 0. A supervised restart needs it; otherwise it does no harm. */
uint8_t hri_released(hri_receiver *r, uint32_t ack_id, hri_unit *unit);

#ifdef __cplusplus
}
#endif

#endif
