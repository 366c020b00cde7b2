// The module `board`: the hardware, for the frozen main loop.
#include "py/binary.h"
#include "py/objarray.h"
#include "py/objstr.h"
#include "py/runtime.h"
#include "clock.h"
#include "heap.h"
#include "link.h"
#include "startup.h"
#include "uart.h"
#include "image.h" // generated: CORE_HASH, CORE_VERSION

extern uint32_t _flash_used, _static_used;

static mp_obj_t board_receive(mp_obj_t ms) {
    return MP_OBJ_NEW_SMALL_INT(link_receive(mp_obj_get_int(ms)));
}
static MP_DEFINE_CONST_FUN_OBJ_1(receive_obj, board_receive);

static mp_obj_t board_send(mp_obj_t id, mp_obj_t size) {
    return mp_obj_new_bool(link_send(mp_obj_get_int(id), mp_obj_get_int(size)));
}
static MP_DEFINE_CONST_FUN_OBJ_2(send_obj, board_send);

// Counts up at 25 MHz, modulo 2^30, so that it needs no memory.
static mp_obj_t board_clock(void) {
    return MP_OBJ_NEW_SMALL_INT(clock_now() & 0x3FFFFFFF);
}
static MP_DEFINE_CONST_FUN_OBJ_0(clock_obj, board_clock);

static mp_obj_t board_busy(void) {
    return MP_OBJ_NEW_SMALL_INT(link_counts.busy & 0x3FFFFFFF);
}
static MP_DEFINE_CONST_FUN_OBJ_0(busy_obj, board_busy);

static mp_obj_t board_skipped(void) {
    return MP_OBJ_NEW_SMALL_INT((link_counts.skipped + uart_lost()) & 0x3FFFFFFF);
}
static MP_DEFINE_CONST_FUN_OBJ_0(skipped_obj, board_skipped);

static mp_obj_t board_refused(void) {
    return MP_OBJ_NEW_SMALL_INT(link_counts.refused & 0x3FFFFFFF);
}
static MP_DEFINE_CONST_FUN_OBJ_0(refused_obj, board_refused);

static mp_obj_t board_unsent(void) {
    return MP_OBJ_NEW_SMALL_INT(link_counts.unsent & 0x3FFFFFFF);
}
static MP_DEFINE_CONST_FUN_OBJ_0(unsent_obj, board_unsent);

static mp_obj_t board_heap_used(void) {
    return MP_OBJ_NEW_SMALL_INT(heap_used());
}
static MP_DEFINE_CONST_FUN_OBJ_0(heap_used_obj, board_heap_used);

static mp_obj_t board_settle(void) {
    heap_settle();
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_0(settle_obj, board_settle);

static mp_obj_t board_stack_peak(void) {
    return MP_OBJ_NEW_SMALL_INT(stack_peak());
}
static MP_DEFINE_CONST_FUN_OBJ_0(stack_peak_obj, board_stack_peak);

static mp_obj_t board_stack_bytes(void) {
    return MP_OBJ_NEW_SMALL_INT(stack_bytes());
}
static MP_DEFINE_CONST_FUN_OBJ_0(stack_bytes_obj, board_stack_bytes);

static mp_obj_t board_static_bytes(void) {
    return MP_OBJ_NEW_SMALL_INT((uint32_t)&_static_used - HEAP_BYTES);
}
static MP_DEFINE_CONST_FUN_OBJ_0(static_bytes_obj, board_static_bytes);

static mp_obj_t board_flash_bytes(void) {
    return MP_OBJ_NEW_SMALL_INT((uint32_t)&_flash_used);
}
static MP_DEFINE_CONST_FUN_OBJ_0(flash_bytes_obj, board_flash_bytes);

static mp_obj_t board_reset_cause(void) {
    return MP_OBJ_NEW_SMALL_INT(reset_cause());
}
static MP_DEFINE_CONST_FUN_OBJ_0(reset_cause_obj, board_reset_cause);

static mp_obj_t board_restart(void) {
    reset_for(RESET_EXTERNAL);
}
static MP_DEFINE_CONST_FUN_OBJ_0(restart_obj, board_restart);

static const mp_obj_array_t inbox_obj = {
    {&mp_type_bytearray}, BYTEARRAY_TYPECODE, 0, PAYLOAD_BYTES, link_in,
};
static const mp_obj_array_t outbox_obj = {
    {&mp_type_bytearray}, BYTEARRAY_TYPECODE, 0, PAYLOAD_BYTES, link_out,
};
static const mp_obj_str_t core_hash_obj = {
    {&mp_type_bytes}, 0, sizeof(CORE_HASH) - 1, (const byte *)CORE_HASH,
};
static const mp_obj_str_t core_version_obj = {
    {&mp_type_bytes}, 0, sizeof(CORE_VERSION) - 1, (const byte *)CORE_VERSION,
};

static const mp_rom_map_elem_t board_names[] = {
    {MP_ROM_QSTR(MP_QSTR___name__), MP_ROM_QSTR(MP_QSTR_board)},
    {MP_ROM_QSTR(MP_QSTR_HEAP_BYTES), MP_ROM_INT(HEAP_BYTES)},
    {MP_ROM_QSTR(MP_QSTR_FLOAT_BITS), MP_ROM_INT(FLOAT_BITS)},
    {MP_ROM_QSTR(MP_QSTR_CORE_HASH), MP_ROM_PTR(&core_hash_obj)},
    {MP_ROM_QSTR(MP_QSTR_CORE_VERSION), MP_ROM_PTR(&core_version_obj)},
    {MP_ROM_QSTR(MP_QSTR_inbox), MP_ROM_PTR(&inbox_obj)},
    {MP_ROM_QSTR(MP_QSTR_outbox), MP_ROM_PTR(&outbox_obj)},
    {MP_ROM_QSTR(MP_QSTR_receive), MP_ROM_PTR(&receive_obj)},
    {MP_ROM_QSTR(MP_QSTR_send), MP_ROM_PTR(&send_obj)},
    {MP_ROM_QSTR(MP_QSTR_clock), MP_ROM_PTR(&clock_obj)},
    {MP_ROM_QSTR(MP_QSTR_busy), MP_ROM_PTR(&busy_obj)},
    {MP_ROM_QSTR(MP_QSTR_skipped), MP_ROM_PTR(&skipped_obj)},
    {MP_ROM_QSTR(MP_QSTR_refused), MP_ROM_PTR(&refused_obj)},
    {MP_ROM_QSTR(MP_QSTR_unsent), MP_ROM_PTR(&unsent_obj)},
    {MP_ROM_QSTR(MP_QSTR_heap_used), MP_ROM_PTR(&heap_used_obj)},
    {MP_ROM_QSTR(MP_QSTR_settle), MP_ROM_PTR(&settle_obj)},
    {MP_ROM_QSTR(MP_QSTR_stack_peak), MP_ROM_PTR(&stack_peak_obj)},
    {MP_ROM_QSTR(MP_QSTR_stack_bytes), MP_ROM_PTR(&stack_bytes_obj)},
    {MP_ROM_QSTR(MP_QSTR_static_bytes), MP_ROM_PTR(&static_bytes_obj)},
    {MP_ROM_QSTR(MP_QSTR_flash_bytes), MP_ROM_PTR(&flash_bytes_obj)},
    {MP_ROM_QSTR(MP_QSTR_reset_cause), MP_ROM_PTR(&reset_cause_obj)},
    {MP_ROM_QSTR(MP_QSTR_restart), MP_ROM_PTR(&restart_obj)},
};
static MP_DEFINE_CONST_DICT(board_globals, board_names);

const mp_obj_module_t board_module = {
    .base = {&mp_type_module},
    .globals = (mp_obj_dict_t *)&board_globals,
};
MP_REGISTER_MODULE(MP_QSTR_board, board_module);
