// Why the board was reset, and how deep its stack has been.
#include <stdint.h>

enum { RESET_POWER = 0, RESET_EXTERNAL = 1, RESET_WATCHDOG = 2, RESET_FAULT = 3, RESET_MEMORY = 4, RESET_EXCEPTION = 5 };

uint32_t reset_cause(void);
uint32_t stack_bytes(void);
uint32_t stack_peak(void);
void reset_for(uint32_t why) __attribute__((noreturn));
