// Start MicroPython and run the frozen main loop for ever.
#include "py/builtin.h"
#include "py/compile.h"
#include "py/gc.h"
#include "py/lexer.h"
#include "py/mperrno.h"
#include "py/runtime.h"
#include "py/stackctrl.h"
#include "clock.h"
#include "hardware.h"
#include "heap.h"
#include "startup.h"
#include "uart.h"

#define STACK_RESERVE 512 // for C functions below the check, and interrupts
#define WATCHDOG_MS 1000

int main(void) {
    clock_start();
    uart_start();
    mp_stack_ctrl_init();
    mp_stack_set_limit(stack_bytes() - STACK_RESERVE);
    heap_start();
    mp_init();
    watchdog_start(WATCHDOG_MS);
    nlr_buf_t context;
    if (nlr_push(&context) == 0) {
        mp_import_name(MP_QSTR_main, mp_const_none, MP_OBJ_NEW_SMALL_INT(0));
        nlr_pop();
    } else {
        mp_obj_t raised = MP_OBJ_FROM_PTR(context.ret_val);
        mp_obj_print_exception(&mp_plat_print, raised);
        bool memory = mp_obj_is_subclass_fast(
            MP_OBJ_FROM_PTR(mp_obj_get_type(raised)), MP_OBJ_FROM_PTR(&mp_type_MemoryError));
        reset_for(memory ? RESET_MEMORY : RESET_EXCEPTION);
    }
    reset_for(RESET_EXCEPTION);
}

void nlr_jump_fail(void *raised) {
    (void)raised;
    reset_for(RESET_EXCEPTION);
}

// Texts of exceptions go to the second serial line, which nothing else uses.
void mp_hal_stdout_tx_strn_cooked(const char *text, size_t size) {
    DEBUG_CONTROL = UART_TX_ENABLE;
    for (size_t i = 0; i < size; i++) {
        DEBUG_DATA = (uint8_t)text[i];
    }
}

mp_uint_t mp_hal_stdout_tx_strn(const char *text, size_t size) {
    mp_hal_stdout_tx_strn_cooked(text, size);
    return size;
}

// There is no file system: only frozen modules can be imported.
mp_import_stat_t mp_import_stat(const char *path) {
    (void)path;
    return MP_IMPORT_STAT_NO_EXIST;
}

mp_lexer_t *mp_lexer_new_from_file(qstr filename) {
    (void)filename;
    mp_raise_OSError(MP_ENOENT);
}

mp_obj_t mp_builtin_open(size_t n_args, const mp_obj_t *args, mp_map_t *kwargs) {
    (void)n_args; (void)args; (void)kwargs;
    mp_raise_OSError(MP_ENOENT);
}
MP_DEFINE_CONST_FUN_OBJ_KW(mp_builtin_open_obj, 1, mp_builtin_open);
