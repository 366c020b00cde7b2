// The serial line: an interrupt fills a ring, from which the link reads.
#include <stdbool.h>
#include <stdint.h>

void uart_start(void);
bool uart_has_bytes(void);
int uart_read(void); // the next byte, or -1
bool uart_write(const uint8_t *bytes, uint32_t count); // false if the line is stuck
uint32_t uart_lost(void); // bytes that arrived while the ring was full
void UART_Handler(void);
