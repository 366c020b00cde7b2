// Faster implementations of the most frequent operations of native code: names, attributes, items,
// operators of small integers and floats, calls, small objects. All others call MicroPython; the
// results are the same.
#include <string.h>
#include "py/bc.h"
#include "py/cstack.h"
#include "py/gc.h"
#include "py/mpstate.h"
#include "py/objarray.h"
#include "py/objfun.h"
#include "py/objlist.h"
#include "py/objnamedtuple.h"
#include "py/objtype.h"
#include "py/runtime.h"
#include "py/smallint.h"

#define GLOBALS 512u // powers of 2
#define MEMBERS 1024u

// Where a name was found last: in the globals, or in the members of any object with as many of them.
static uint16_t globals[GLOBALS];
static uint8_t members[MEMBERS];

static inline uint8_t *place_of(qstr name, size_t size) {
    return &members[(name + 67u * size) % MEMBERS];
}

static inline mp_map_elem_t *find(mp_map_t *map, qstr name) {
    uint8_t *place = place_of(name, map->alloc);
    mp_obj_t key = MP_OBJ_NEW_QSTR(name);
    if (*place < map->alloc && map->table[*place].key == key) {
        return &map->table[*place];
    }
    mp_map_elem_t *found = mp_map_lookup(map, key, MP_MAP_LOOKUP);
    if (found != NULL) {
        *place = (uint8_t)(found - map->table);
    }
    return found;
}

mp_obj_t __real_mp_load_global(qstr name);
mp_obj_t __wrap_mp_load_global(qstr name) {
    mp_map_t *map = &mp_globals_get()->map;
    uint16_t *place = &globals[name % GLOBALS];
    if (*place < map->alloc && map->table[*place].key == MP_OBJ_NEW_QSTR(name)) {
        return map->table[*place].value;
    }
    mp_map_elem_t *found = mp_map_lookup(map, MP_OBJ_NEW_QSTR(name), MP_MAP_LOOKUP);
    if (found == NULL) {
        return __real_mp_load_global(name);
    }
    *place = (uint16_t)(found - map->table);
    return found->value;
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

// Return the value of a field of a named tuple, the only type of MicroPython made from `tuple`.
static inline mp_obj_t field(mp_obj_t object, qstr name) {
    mp_obj_tuple_t *self = MP_OBJ_TO_PTR(object);
    const mp_obj_type_t *type = self->base.type;
    if (MP_OBJ_TYPE_GET_SLOT_OR_NULL(type, parent) != &mp_type_tuple) {
        return MP_OBJ_NULL;
    }
    const mp_obj_namedtuple_type_t *fields = (const mp_obj_namedtuple_type_t *)type;
    uint8_t *place = place_of(name, fields->n_fields);
    if (*place >= fields->n_fields || fields->fields[*place] != name) {
        size_t found = mp_obj_namedtuple_find_field(fields, name);
        if (found == (size_t)-1) {
            return MP_OBJ_NULL;
        }
        *place = (uint8_t)found;
    }
    return self->items[*place];
}

mp_obj_t __real_mp_load_attr(mp_obj_t object, qstr name);
mp_obj_t __wrap_mp_load_attr(mp_obj_t object, qstr name) {
    mp_obj_instance_t *self = instance(object);
    if (self != NULL) {
        mp_map_elem_t *found = find(&self->members, name);
        if (found != NULL) {
            return found->value;
        }
    } else if (mp_obj_is_obj(object)) {
        mp_obj_t found = field(object, name);
        if (found != MP_OBJ_NULL) {
            return found;
        }
    }
    return __real_mp_load_attr(object, name);
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

// Return a free block of zeros, the first one as in gc_alloc, or NULL.
static inline uint32_t *free_block(void) {
    mp_state_mem_area_t *area = &MP_STATE_MEM(area);
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
    return NULL;
}

void *__real_gc_alloc(size_t size, unsigned int flags);
void *__wrap_gc_alloc(size_t size, unsigned int flags) {
    if (size - 1u < MICROPY_BYTES_PER_GC_BLOCK && MP_STATE_THREAD(gc_lock_depth) == 0) {
        uint32_t *words = free_block();
        if (words != NULL) {
            return words;
        }
    }
    return __real_gc_alloc(size, flags);
}

struct real { // as in objfloat.c
    mp_obj_base_t base;
    mp_float_t value;
};

mp_obj_t __real_mp_obj_new_float(mp_float_t value);
mp_obj_t __wrap_mp_obj_new_float(mp_float_t value) {
    struct real *made = NULL;
    if (MP_STATE_THREAD(gc_lock_depth) == 0) {
        made = (struct real *)free_block();
    }
    if (made == NULL) {
        return __real_mp_obj_new_float(value);
    }
    made->base.type = &mp_type_float;
    made->value = value;
    return MP_OBJ_FROM_PTR(made);
}

// Return a result of two small integers, or MP_OBJ_NULL for an operator that is not handled here.
static inline mp_obj_t of_integers(mp_binary_op_t op, mp_obj_t left, mp_obj_t right) {
    mp_int_t a = MP_OBJ_SMALL_INT_VALUE(left), b = MP_OBJ_SMALL_INT_VALUE(right);
    switch (op) {
        case MP_BINARY_OP_ADD:
        case MP_BINARY_OP_INPLACE_ADD:
            a += b;
            break;
        case MP_BINARY_OP_SUBTRACT:
        case MP_BINARY_OP_INPLACE_SUBTRACT:
            a -= b;
            break;
        case MP_BINARY_OP_MULTIPLY:
        case MP_BINARY_OP_INPLACE_MULTIPLY: {
            long long product = (long long)a * b;
            a = (mp_int_t)product;
            if (product != a) {
                return MP_OBJ_NULL;
            }
            break;
        }
        case MP_BINARY_OP_AND:
        case MP_BINARY_OP_INPLACE_AND:
            a &= b;
            break;
        case MP_BINARY_OP_OR:
        case MP_BINARY_OP_INPLACE_OR:
            a |= b;
            break;
        case MP_BINARY_OP_RSHIFT:
        case MP_BINARY_OP_INPLACE_RSHIFT:
            if ((mp_uint_t)b >= 32u) {
                return MP_OBJ_NULL;
            }
            a >>= b;
            break;
        case MP_BINARY_OP_FLOOR_DIVIDE:
        case MP_BINARY_OP_INPLACE_FLOOR_DIVIDE:
            if (b == 0) {
                return MP_OBJ_NULL;
            }
            a = a / b - (a % b != 0 && (a ^ b) < 0);
            break;
        case MP_BINARY_OP_MODULO:
        case MP_BINARY_OP_INPLACE_MODULO:
            if (b == 0) {
                return MP_OBJ_NULL;
            }
            a %= b;
            a += a != 0 && (a ^ b) < 0 ? b : 0; // the sign of the divisor
            break;
        case MP_BINARY_OP_LESS:
            return mp_obj_new_bool(a < b);
        case MP_BINARY_OP_MORE:
            return mp_obj_new_bool(a > b);
        case MP_BINARY_OP_LESS_EQUAL:
            return mp_obj_new_bool(a <= b);
        case MP_BINARY_OP_MORE_EQUAL:
            return mp_obj_new_bool(a >= b);
        case MP_BINARY_OP_EQUAL:
        case MP_BINARY_OP_IS:
            return mp_obj_new_bool(a == b);
        case MP_BINARY_OP_NOT_EQUAL:
            return mp_obj_new_bool(a != b);
        default: // others, and those that may raise an exception
            return MP_OBJ_NULL;
    }
    return MP_SMALL_INT_FITS(a) ? MP_OBJ_NEW_SMALL_INT(a) : MP_OBJ_NULL;
}

// The same of two floats.
static inline mp_obj_t of_reals(mp_binary_op_t op, mp_float_t a, mp_float_t b) {
    switch (op) {
        case MP_BINARY_OP_ADD:
        case MP_BINARY_OP_INPLACE_ADD:
            return __wrap_mp_obj_new_float(a + b);
        case MP_BINARY_OP_SUBTRACT:
        case MP_BINARY_OP_INPLACE_SUBTRACT:
            return __wrap_mp_obj_new_float(a - b);
        case MP_BINARY_OP_MULTIPLY:
        case MP_BINARY_OP_INPLACE_MULTIPLY:
            return __wrap_mp_obj_new_float(a * b);
        case MP_BINARY_OP_TRUE_DIVIDE:
        case MP_BINARY_OP_INPLACE_TRUE_DIVIDE:
            return b == 0 ? MP_OBJ_NULL : __wrap_mp_obj_new_float(a / b);
        case MP_BINARY_OP_LESS:
            return mp_obj_new_bool(a < b);
        case MP_BINARY_OP_MORE:
            return mp_obj_new_bool(a > b);
        case MP_BINARY_OP_LESS_EQUAL:
            return mp_obj_new_bool(a <= b);
        case MP_BINARY_OP_MORE_EQUAL:
            return mp_obj_new_bool(a >= b);
        case MP_BINARY_OP_EQUAL:
            return mp_obj_new_bool(a == b);
        case MP_BINARY_OP_NOT_EQUAL:
            return mp_obj_new_bool(a != b);
        default: // others, and those that may raise an exception
            return MP_OBJ_NULL;
    }
}

static inline bool is_real(mp_obj_t object) {
    return mp_obj_is_obj(object) && ((mp_obj_base_t *)MP_OBJ_TO_PTR(object))->type == &mp_type_float;
}

static inline mp_float_t real_of(mp_obj_t object) {
    return ((struct real *)MP_OBJ_TO_PTR(object))->value;
}

mp_obj_t __real_mp_binary_op(mp_binary_op_t op, mp_obj_t left, mp_obj_t right);
static __attribute__((noinline)) mp_obj_t of_others(mp_binary_op_t op, mp_obj_t left, mp_obj_t right) {
    mp_obj_t result = MP_OBJ_NULL;
    if (is_real(left)) {
        if (is_real(right)) {
            result = of_reals(op, real_of(left), real_of(right));
        } else if (mp_obj_is_small_int(right)) {
            result = of_reals(op, real_of(left), (mp_float_t)MP_OBJ_SMALL_INT_VALUE(right));
        }
    } else if (mp_obj_is_small_int(left) && is_real(right)) {
        result = of_reals(op, (mp_float_t)MP_OBJ_SMALL_INT_VALUE(left), real_of(right));
    }
    return result != MP_OBJ_NULL ? result : __real_mp_binary_op(op, left, right);
}

mp_obj_t __wrap_mp_binary_op(mp_binary_op_t op, mp_obj_t left, mp_obj_t right) {
    if ((mp_uint_t)left & (mp_uint_t)right & 1u) { // two small integers
        mp_obj_t result = of_integers(op, left, right);
        return result != MP_OBJ_NULL ? result : __real_mp_binary_op(op, left, right);
    }
    return of_others(op, left, right);
}

// Items of lists, tuples and bytearrays at an index from 0 on.
mp_obj_t __real_mp_obj_subscr(mp_obj_t base, mp_obj_t index, mp_obj_t value);
mp_obj_t __wrap_mp_obj_subscr(mp_obj_t base, mp_obj_t index, mp_obj_t value) {
    if (mp_obj_is_small_int(index) && mp_obj_is_obj(base) && value != MP_OBJ_NULL) {
        const mp_obj_type_t *type = ((mp_obj_base_t *)MP_OBJ_TO_PTR(base))->type;
        size_t i = (size_t)MP_OBJ_SMALL_INT_VALUE(index);
        if (type == &mp_type_list) {
            mp_obj_list_t *list = MP_OBJ_TO_PTR(base);
            if (i < list->len) {
                if (value == MP_OBJ_SENTINEL) {
                    return list->items[i];
                }
                list->items[i] = value;
                return mp_const_none;
            }
        } else if (type == &mp_type_tuple) {
            mp_obj_tuple_t *tuple = MP_OBJ_TO_PTR(base);
            if (i < tuple->len && value == MP_OBJ_SENTINEL) {
                return tuple->items[i];
            }
        } else if (type == &mp_type_bytearray) {
            mp_obj_array_t *array = MP_OBJ_TO_PTR(base);
            if (i < array->len) {
                if (value == MP_OBJ_SENTINEL) {
                    return MP_OBJ_NEW_SMALL_INT(((uint8_t *)array->items)[i]);
                }
                if (mp_obj_is_small_int(value)) {
                    ((uint8_t *)array->items)[i] = (uint8_t)MP_OBJ_SMALL_INT_VALUE(value);
                    return mp_const_none;
                }
            }
        }
    }
    return __real_mp_obj_subscr(base, index, value);
}

mp_obj_t __real_mp_call_function_n_kw(mp_obj_t function, size_t n_args, size_t n_kw, const mp_obj_t *args);
mp_obj_t __wrap_mp_call_function_n_kw(mp_obj_t function, size_t n_args, size_t n_kw, const mp_obj_t *args) {
    if (mp_obj_is_obj(function)) {
        mp_obj_fun_bc_t *self = MP_OBJ_TO_PTR(function);
        if (self->base.type == &mp_type_fun_native) {
            mp_uint_t used = MP_STATE_THREAD(stack_top) - (char *)__builtin_frame_address(0);
            if (used >= MP_STATE_THREAD(stack_limit)) {
                mp_raise_recursion_depth();
            }
            mp_call_fun_t start = (mp_call_fun_t)mp_obj_fun_native_get_function_start(self);
            return start(function, n_args, n_kw, args);
        }
    }
    return __real_mp_call_function_n_kw(function, n_args, n_kw, args);
}

// The arguments of a function without optional keywords, from the end of its locals downwards.
void __real_mp_setup_code_state_native(
    mp_code_state_native_t *state, size_t n_args, size_t n_kw, const mp_obj_t *args);
void __wrap_mp_setup_code_state_native(
    mp_code_state_native_t *state, size_t n_args, size_t n_kw, const mp_obj_t *args) {
    mp_obj_fun_bc_t *self = state->fun_bc;
    const byte *ip = mp_obj_fun_native_get_prelude_ptr(self);
    MP_BC_PRELUDE_SIG_DECODE(ip);
    MP_BC_PRELUDE_SIZE_DECODE(ip);
    const size_t special = MP_SCOPE_FLAG_VARARGS | MP_SCOPE_FLAG_VARKEYWORDS | MP_SCOPE_FLAG_DEFKWARGS;
    size_t n_needed = n_pos_args - n_def_pos_args;
    if ((n_kw | n_cell | n_kwonly_args | (scope_flags & special)) != 0 || n_args > n_pos_args ||
        n_args < n_needed) {
        __real_mp_setup_code_state_native(state, n_args, n_kw, args);
        return;
    }
    state->ip = ip + n_info;
    state->sp = &state->state[0] - 1;
    state->exc_sp_idx = 0;
    mp_obj_t *local = state->state + state->n_state;
    for (size_t i = 0; i < n_args; i++) {
        *--local = args[i];
    }
    for (size_t i = n_args; i < n_pos_args; i++) {
        *--local = self->extra_args[i - n_needed];
    }
    while (local > state->state) {
        *--local = MP_OBJ_NULL;
    }
}
