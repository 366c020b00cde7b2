// The serial line: an interrupt fills a ring, from which the link reads.
#include "uart.h"
#include "clock.h"
#include "hardware.h"

#define RING 512u // the inputs of a tick and a request
#define STUCK_MS 500u // shorter than the watchdog waits

static volatile uint8_t ring[RING];
static volatile uint32_t head, tail; // bytes ever written, ever read
static uint32_t lost;

void uart_start(void) {
    UART_DIVIDER = 16;
    UART_CONTROL = UART_TX_ENABLE | UART_RX_ENABLE | UART_RX_INTERRUPT_ENABLE;
    INTERRUPT_ENABLE = 1u << UART_RX_IRQ;
}

void UART_Handler(void) {
    UART_INTERRUPT = UART_RX_INTERRUPT;
    while (UART_STATE & UART_RX_FULL) {
        uint8_t byte = (uint8_t)UART_DATA;
        if (head - tail < RING) {
            ring[head % RING] = byte;
            head++;
        } else {
            lost++;
        }
    }
}

bool uart_has_bytes(void) {
    return head != tail;
}

int uart_read(void) {
    if (head == tail) {
        return -1;
    }
    uint8_t byte = ring[tail % RING];
    tail++;
    return byte;
}

bool uart_write(const uint8_t *bytes, uint32_t count) {
    uint32_t deadline = clock_now() + STUCK_MS * TICKS_PER_MS;
    for (uint32_t i = 0; i < count; i++) {
        while (UART_STATE & UART_TX_FULL) {
            if ((int32_t)(deadline - clock_now()) < 0) {
                return false;
            }
        }
        UART_DATA = bytes[i];
    }
    return true;
}

uint32_t uart_lost(void) {
    return lost;
}
