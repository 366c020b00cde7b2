// Faster implementations of the most frequent operations of native code: names, attributes,
// floating-point operators, small objects. All others call MicroPython; the results are the same.
#include <string.h>
#include "py/gc.h"
#include "py/mpstate.h"
#include "py/objtype.h"
#include "py/runtime.h"

#define PLACES 512u // power of 2

static uint16_t places[PLACES]; // where a name was found last, in any map

static inline mp_map_elem_t *find(mp_map_t *map, qstr name) {
    uint16_t *place = &places[name % PLACES];
    mp_obj_t key = MP_OBJ_NEW_QSTR(name);
    if (*place < map->alloc && map->table[*place].key == key) {
        return &map->table[*place];
    }
    mp_map_elem_t *found = mp_map_lookup(map, key, MP_MAP_LOOKUP);
    if (found != NULL) {
        *place = found - map->table;
    }
    return found;
}

mp_obj_t __real_mp_load_global(qstr name);
mp_obj_t __wrap_mp_load_global(qstr name) {
    mp_map_elem_t *found = find(&mp_globals_get()->map, name);
    return found != NULL ? found->value : __real_mp_load_global(name);
}

// Return an object as an instance of a Python class, else NULL.
static inline mp_obj_instance_t *instance(mp_obj_t object) {
    if (mp_obj_is_obj(object)) {
        mp_obj_instance_t *found = MP_OBJ_TO_PTR(object);
        if (mp_obj_is_instance_type(found->base.type)) {
            return found;
        }
    }
    return NULL;
}

mp_obj_t __real_mp_load_attr(mp_obj_t object, qstr name);
mp_obj_t __wrap_mp_load_attr(mp_obj_t object, qstr name) {
    mp_obj_instance_t *self = instance(object);
    mp_map_elem_t *found = self == NULL ? NULL : find(&self->members, name);
    return found != NULL ? found->value : __real_mp_load_attr(object, name);
}

void __real_mp_store_attr(mp_obj_t object, qstr name, mp_obj_t value);
void __wrap_mp_store_attr(mp_obj_t object, qstr name, mp_obj_t value) {
    mp_obj_instance_t *self = instance(object);
    if (self != NULL && !(self->base.type->flags & MP_TYPE_FLAG_HAS_SPECIAL_ACCESSORS)) {
        mp_map_elem_t *found = find(&self->members, name);
        if (found != NULL) {
            found->value = value;
            return;
        }
    }
    __real_mp_store_attr(object, name, value);
}

mp_obj_t __real_mp_binary_op(mp_binary_op_t op, mp_obj_t left, mp_obj_t right);
mp_obj_t __wrap_mp_binary_op(mp_binary_op_t op, mp_obj_t left, mp_obj_t right) {
    if (mp_obj_is_float(left) && mp_obj_is_float(right)) {
        mp_float_t a = mp_obj_float_get(left), b = mp_obj_float_get(right);
        switch (op) {
            case MP_BINARY_OP_ADD:
            case MP_BINARY_OP_INPLACE_ADD:
                return mp_obj_new_float(a + b);
            case MP_BINARY_OP_SUBTRACT:
            case MP_BINARY_OP_INPLACE_SUBTRACT:
                return mp_obj_new_float(a - b);
            case MP_BINARY_OP_MULTIPLY:
            case MP_BINARY_OP_INPLACE_MULTIPLY:
                return mp_obj_new_float(a * b);
            case MP_BINARY_OP_LESS:
                return mp_obj_new_bool(a < b);
            case MP_BINARY_OP_MORE:
                return mp_obj_new_bool(a > b);
            case MP_BINARY_OP_LESS_EQUAL:
                return mp_obj_new_bool(a <= b);
            case MP_BINARY_OP_MORE_EQUAL:
                return mp_obj_new_bool(a >= b);
            default: // others, and those that may raise an exception
                break;
        }
    }
    return __real_mp_binary_op(op, left, right);
}

// An object of one block takes the first free one, as it does in gc_alloc.
void *__real_gc_alloc(size_t size, unsigned int flags);
void *__wrap_gc_alloc(size_t size, unsigned int flags) {
    mp_state_mem_area_t *area = &MP_STATE_MEM(area);
    if (size - 1u < MICROPY_BYTES_PER_GC_BLOCK && MP_STATE_THREAD(gc_lock_depth) == 0) {
        byte *table = area->gc_alloc_table_start;
        for (size_t i = area->gc_last_free_atb_index; i < area->gc_alloc_table_byte_len; i++) {
            uint32_t bits = table[i], free = ~(bits | bits >> 1) & 0x55;
            if (free != 0) {
                uint32_t bit = __builtin_ctz(free);
                size_t block = i * 4u + bit / 2u;
                table[i] = bits | 1u << bit; // the head of an object
                area->gc_last_free_atb_index = (block + 1u) / 4u;
                if (block > area->gc_last_used_block) {
                    area->gc_last_used_block = block;
                }
                uint32_t *words = (uint32_t *)(area->gc_pool_start + block * MICROPY_BYTES_PER_GC_BLOCK);
                words[0] = words[1] = words[2] = words[3] = 0;
                return words;
            }
        }
    }
    return __real_gc_alloc(size, flags);
}
