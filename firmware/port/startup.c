// Reset, the vector table, and the handlers of faults, which all end in a reset by the watchdog.
#include "startup.h"
#include "clock.h"
#include "uart.h"

extern uint32_t _sstack, _estack, _sidata, _sdata, _edata, _sbss, _ebss;
int main(void);

#define STACK_PATTERN 0x5AA5C33Cu
#define CAUSE_KNOWN 0x51DE0000u

static uint32_t noted_cause __attribute__((section(".noinit")));
static uint32_t cause;

__attribute__((used, noreturn)) void prepare(void) {
    for (uint32_t *from = &_sidata, *to = &_sdata; to < &_edata;) {
        *to++ = *from++;
    }
    for (uint32_t *to = &_sbss; to < &_ebss;) {
        *to++ = 0;
    }
    cause = (noted_cause & 0xFFFF0000u) == CAUSE_KNOWN ? noted_cause & 0xFFFFu : RESET_POWER;
    noted_cause = CAUSE_KNOWN | RESET_EXTERNAL;
    main();
    reset_for(RESET_EXCEPTION);
}

// Fill the whole stack, before anything uses it, so that its high-water mark can be found.
__attribute__((naked)) void Reset_Handler(void) {
    __asm volatile (
        "ldr r0, =_sstack\n"
        "ldr r1, =_estack\n"
        "ldr r2, =0x5AA5C33C\n"
        "1: str r2, [r0], #4\n"
        "cmp r0, r1\n"
        "blo 1b\n"
        "mov sp, r1\n"
        "b prepare\n");
}

uint32_t reset_cause(void) {
    return cause;
}

uint32_t stack_bytes(void) {
    return (uint32_t)((char *)&_estack - (char *)&_sstack);
}

uint32_t stack_peak(void) {
    const uint32_t *lowest = &_sstack;
    while (lowest + 4 < &_estack && ((lowest[0] ^ STACK_PATTERN) | (lowest[1] ^ STACK_PATTERN) |
        (lowest[2] ^ STACK_PATTERN) | (lowest[3] ^ STACK_PATTERN)) == 0) {
        lowest += 4;
    }
    while (lowest < &_estack && *lowest == STACK_PATTERN) {
        lowest++;
    }
    return (uint32_t)((char *)&_estack - (char *)lowest);
}

// The watchdog interrupts first and resets one period later. If the host does not schedule the
// emulator for a while, the time jumps while the processor sleeps. This is not a hang.
void NMI_Handler(void) {
    if (clock_was_waiting()) {
        watchdog_clear();
        return;
    }
    noted_cause = CAUSE_KNOWN | RESET_WATCHDOG;
    for (;;) {
    }
}

void reset_for(uint32_t why) {
    noted_cause = CAUSE_KNOWN | why;
    *(volatile uint32_t *)0xE000ED0C = 0x05FA0004u; // AIRCR: system reset
    for (;;) {
    }
}

void Fault_Handler(void) {
    reset_for(RESET_FAULT);
}

void *const isr_vector[] __attribute__((section(".isr_vector"), used)) = {
    &_estack, Reset_Handler, NMI_Handler, Fault_Handler, Fault_Handler, Fault_Handler,
    Fault_Handler, 0, 0, 0, 0, Fault_Handler, Fault_Handler, 0, Fault_Handler, Fault_Handler,
    [16 + 0] = UART_Handler,
    [16 + 9] = Alarm_Handler,
};
