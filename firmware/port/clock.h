// Time of the board, waiting, and the watchdog.
#include <stdbool.h>
#include <stdint.h>

void clock_start(void);
uint32_t clock_now(void); // counts up at 25 MHz and wraps after 171 s
void wait_until(uint32_t deadline); // returns at any interrupt, or at the deadline
bool clock_was_waiting(void); // true once in each wait: the processor slept, so it does not hang
void watchdog_start(uint32_t ms);
void watchdog_clear(void);
void Alarm_Handler(void);
