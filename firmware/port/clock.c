// Time of the board, waiting, and the watchdog.
#include "clock.h"
#include "hardware.h"
#include "uart.h"

static volatile bool is_waiting;

bool clock_was_waiting(void) {
    bool was = is_waiting;
    is_waiting = false;
    return was;
}

void clock_start(void) {
    CLOCK_RELOAD = 0xFFFFFFFFu;
    CLOCK_VALUE = 0xFFFFFFFFu;
    CLOCK_CONTROL = TIMER_ENABLE;
    INTERRUPT_ENABLE = 1u << ALARM_IRQ;
}

uint32_t clock_now(void) {
    return 0xFFFFFFFFu - CLOCK_VALUE;
}

// Interrupts stay masked between the check and the wait, so that none is missed; a pending one
// ends the wait nevertheless.
void wait_until(uint32_t deadline) {
    __asm volatile ("cpsid i" ::: "memory");
    int32_t left = (int32_t)(deadline - clock_now());
    if (left > 0 && !uart_has_bytes()) {
        ALARM_CONTROL = 0;
        ALARM_INTERRUPT = 1;
        ALARM_RELOAD = 0;
        ALARM_VALUE = (uint32_t)left;
        ALARM_CONTROL = TIMER_ENABLE | TIMER_INTERRUPT_ENABLE;
        is_waiting = true;
        __asm volatile ("wfi" ::: "memory");
        is_waiting = false;
        ALARM_CONTROL = 0;
        ALARM_INTERRUPT = 1;
    }
    __asm volatile ("cpsie i" ::: "memory");
}

void Alarm_Handler(void) {
    ALARM_CONTROL = 0;
    ALARM_INTERRUPT = 1;
}

void watchdog_start(uint32_t ms) {
    WATCHDOG_LOAD = ms * TICKS_PER_MS;
    WATCHDOG_CONTROL = WATCHDOG_INTERRUPT_ENABLE | WATCHDOG_RESET_ENABLE;
}

void watchdog_clear(void) {
    WATCHDOG_CLEAR = 1;
}
