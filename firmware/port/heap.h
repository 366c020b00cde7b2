// The heap of MicroPython, whose first part may be settled: its objects are never freed.
#include <stdint.h>

void heap_start(void);
void heap_settle(void);
uint32_t heap_used(void);
