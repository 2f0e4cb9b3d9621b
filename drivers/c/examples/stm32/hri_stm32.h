/* A controller on an STM32: what your program calls. Link hri_can.c or hri_uart.c, not both.
 *
 * Call hri_start once after the MX_..._Init functions, then hri_cycle every millisecond, from the
 * main loop or from one task. It returns the permitted speed: yours to enforce.
 */
#ifndef HRI_STM32_H
#define HRI_STM32_H

#include "hri_predict.h"

#define HRI_STATE_PERIOD_MS 20u /* RobotState at 50 Hz */
#define HRI_ACK_REPEATS 3u      /* a press of the button is sent so often */

extern hri_receiver hri;          /* its verdict, newest Advice and counts, for display */
extern hri_robot_state hri_state; /* yours to fill before each call of hri_cycle */
extern uint32_t hri_lost;         /* frames or bytes that came too fast or could not leave: show it */

/* Start receiving; false if the peripheral refuses. first_state_counter: different after each
 * start, from a clock or a random number generator. */
bool hri_start(uint16_t first_state_counter);

/* Take what came, send what is due; return the permitted speed in mm/s, 0: stop. */
uint16_t hri_cycle(void);

/* A person has pressed the button: acknowledge what the newest Advice shows, if it shows anything.
 * Call it once, when the button goes down. press_id: a new one for each press, also after a start,
 * not 0. */
void hri_press(uint32_t press_id);

/* The button was released: a supervised restart (risk.restart) counts the press only now. */
void hri_release(void);

#endif
