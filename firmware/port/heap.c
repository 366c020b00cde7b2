// The heap of MicroPython. The functions, classes and constants of the loaded program are never
// freed. They leave the collected heap: a collection only reads their words.
#include <string.h>
#include "py/gc.h"
#include "py/mpstate.h"
#include "shared/runtime/gchelper.h"
#include "clock.h"
#include "heap.h"

// The table of blocks has two bits for each block; 0 is free.
#define BLOCKS_PER_BYTE 4u
#define BLOCKS_PER_WORD 16u
#define BYTES_OF(entries) ((entries) * BLOCKS_PER_BYTE * MICROPY_BYTES_PER_GC_BLOCK)
#define FIRST_ENTRIES 96u
#define MORE_ENTRIES 24u

static char heap[HEAP_BYTES] __attribute__((aligned(16)));
static uint8_t *settled, *settled_end;
static uint32_t entries; // of the table for the whole heap

static uint32_t used_entries(void) {
    return MP_STATE_MEM(area).gc_last_used_block / BLOCKS_PER_BYTE + 1;
}

void heap_start(void) {
    gc_init(heap, heap + sizeof heap);
    entries = MP_STATE_MEM(area).gc_alloc_table_byte_len & ~3u;
    MP_STATE_MEM(area).gc_alloc_table_byte_len = FIRST_ENTRIES;
}

void heap_settle(void) {
    gc_collect();
    mp_state_mem_area_t *area = &MP_STATE_MEM(area);
    uint32_t kept = (used_entries() + 3u) & ~3u;
    settled = area->gc_pool_start;
    settled_end = settled + BYTES_OF(kept);
    area->gc_alloc_table_start += kept;
    area->gc_alloc_table_byte_len = entries - kept;
    area->gc_pool_start = settled_end;
    area->gc_last_free_atb_index = 0;
    area->gc_last_used_block = 0;
}

// Mark what the settled objects refer to. Few of their words are addresses in the collected heap.
static void mark_from_settled(void) {
    uintptr_t start = (uintptr_t)MP_STATE_MEM(area).gc_pool_start;
    uintptr_t size = (uintptr_t)MP_STATE_MEM(area).gc_pool_end - start;
    for (uintptr_t *words = (uintptr_t *)settled; words < (uintptr_t *)settled_end; words += 4) {
        uintptr_t a = words[0] - start, b = words[1] - start;
        uintptr_t c = words[2] - start, d = words[3] - start;
        if (a < size || b < size || c < size || d < size) {
            gc_collect_root((void **)words, 4);
        }
    }
}

#define HEADS 0x55555555u // the lower bits of 16 blocks

// Free what is not marked, 16 blocks at once: 0 is free, 1 a head, 2 a tail, 3 a marked head.
static void sweep(void) {
    mp_state_mem_area_t *area = &MP_STATE_MEM(area);
    uint32_t *table = (uint32_t *)area->gc_alloc_table_start;
    uint32_t end = area->gc_last_used_block / BLOCKS_PER_WORD + 1, last = 0, before = 0;
    for (uint32_t i = 0; i < end; i++) {
        uint32_t word = table[i], kept = 0;
        if (word != 0) {
            uint32_t marked = word & word >> 1 & HEADS, tails = word >> 1 & ~word & HEADS;
            kept = marked | (before & tails);
            // Tails behind a kept block, over 1, 2, 4 and 8 of them.
            uint32_t run = tails;
            kept |= run & kept << 2;
            run &= run << 2;
            kept |= run & kept << 4;
            run &= run << 4;
            kept |= run & kept << 8;
            run &= run << 8;
            kept |= run & kept << 16;
            table[i] = marked | (kept & ~marked) << 1;
            if (kept != 0) {
                last = i * BLOCKS_PER_WORD + (31u - __builtin_clz(kept)) / 2u;
            }
        }
        before = kept >> 30;
    }
    area->gc_last_used_block = last;
    area->gc_last_free_atb_index = 0;
    MP_STATE_THREAD(gc_lock_depth) &= ~GC_COLLECT_FLAG;
}

// While the program is loaded, the heap grows by small steps: objects that are kept lie together.
void gc_collect(void) {
    gc_collect_start();
    mark_from_settled();
    gc_helper_collect_regs_and_stack();
    if (settled != NULL && !MP_STATE_MEM(gc_stack_overflow)) {
        sweep();
        return;
    }
    gc_collect_end();
    if (settled == NULL) {
        uint32_t grown = used_entries() + MORE_ENTRIES;
        MP_STATE_MEM(area).gc_alloc_table_byte_len = grown < entries ? grown : entries;
        watchdog_clear();
    }
}

uint32_t heap_used(void) {
    const uint8_t *table = MP_STATE_MEM(area).gc_alloc_table_start;
    uint32_t used = 0, end = used_entries();
    for (uint32_t i = 0; i < end; i += sizeof(uint32_t)) {
        uint32_t bits;
        memcpy(&bits, table + i, sizeof bits);
        bits = (bits | bits >> 1) & 0x55555555u;
        bits = (bits & 0x33333333u) + (bits >> 2 & 0x33333333u);
        bits = (bits + (bits >> 4)) & 0x0F0F0F0Fu;
        used += bits * 0x01010101u >> 24;
    }
    return used * MICROPY_BYTES_PER_GC_BLOCK + (settled_end - settled);
}

static bool is_settled(const void *pointer) {
    return (const uint8_t *)pointer >= settled && (const uint8_t *)pointer < settled_end;
}

// A settled object can be neither freed nor made larger.
void __real_gc_free(void *pointer);
void __wrap_gc_free(void *pointer) {
    if (!is_settled(pointer)) {
        __real_gc_free(pointer);
    }
}

void *__real_gc_realloc(void *pointer, size_t size, bool allow_move);
void *__wrap_gc_realloc(void *pointer, size_t size, bool allow_move) {
    return is_settled(pointer) ? NULL : __real_gc_realloc(pointer, size, allow_move);
}
