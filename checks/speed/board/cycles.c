// Plugin of qemu 7.2: counts instructions and models the cycles of an LPC1768 at 96 MHz.
//
// Every instruction is charged the upper figure of ARM's table (DDI 0337, section 3.3.1): loads and
// stores 2, multiple ones 1 + registers, long multiplications 5, divisions 12, a taken branch 1 + 3,
// one more for an address relative to the program counter. Instructions of an IT block count as
// executed. Flash takes 5 clocks an access of 128 bits, behind the accelerator of the LPC176x
// (UM10360, chapter 5): 8 lines in least-recently-used order, and the next line is fetched ahead. A
// data access to flash that misses ends a fetch ahead. The entry and the exit of interrupts are not
// charged. qemu itself models no time.
//
// Arguments: out=FILE, marks=ADDRESS:ADDRESS:... At each execution of the instruction at a marked
// address a record is written: the number of the mark, all instructions, and all cycles so far.
#include <inttypes.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

// The part of qemu-plugin.h, version 1, that is used here; Debian has no package of it.
typedef uint64_t qemu_plugin_id_t;
typedef uint32_t qemu_plugin_meminfo_t;
struct qemu_plugin_tb;
struct qemu_plugin_insn;
typedef struct {
    const char *target_name;
    struct { int min, cur; } version;
    bool system_emulation;
    union { struct { int smp_vcpus, max_vcpus; } system; };
} qemu_info_t;
enum { NO_REGISTERS = 0, READS = 1 };
extern void qemu_plugin_register_vcpu_tb_trans_cb(
    qemu_plugin_id_t, void (*)(qemu_plugin_id_t, struct qemu_plugin_tb *));
extern void qemu_plugin_register_vcpu_tb_exec_cb(
    struct qemu_plugin_tb *, void (*)(unsigned, void *), int, void *);
extern void qemu_plugin_register_vcpu_insn_exec_cb(
    struct qemu_plugin_insn *, void (*)(unsigned, void *), int, void *);
extern void qemu_plugin_register_vcpu_mem_cb(
    struct qemu_plugin_insn *, void (*)(unsigned, qemu_plugin_meminfo_t, uint64_t, void *), int, int,
    void *);
extern size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *);
extern struct qemu_plugin_insn *qemu_plugin_tb_get_insn(const struct qemu_plugin_tb *, size_t);
extern uint64_t qemu_plugin_insn_vaddr(const struct qemu_plugin_insn *);
extern size_t qemu_plugin_insn_size(const struct qemu_plugin_insn *);
extern const void *qemu_plugin_insn_data(const struct qemu_plugin_insn *);
extern void qemu_plugin_register_atexit_cb(
    qemu_plugin_id_t, void (*)(qemu_plugin_id_t, void *), void *);

__attribute__((visibility("default"))) int qemu_plugin_version = 1;

enum { FLASH_CLOCKS = 5, LINE_BYTES = 16, LINES = 8, TAKEN = 3, FLASH_END = 512 * 1024, MARKS = 16 };
static const uint32_t NO_LINE = UINT32_MAX;

struct block {
    uint32_t start, end; // address, and that after the last instruction
    uint32_t instructions, cycles; // without flash and taken branches
    uint64_t runs;
    struct block *next;
};

struct record {
    uint32_t mark, reserved;
    uint64_t instructions, cycles;
};

static FILE *out, *profile;
static uint32_t marks[MARKS], mark_count;
static uint64_t instructions, cycles;
static uint32_t expected; // the address after the last block: any other one is a taken branch
static uint32_t lines[LINES], ahead = NO_LINE;
static uint64_t used[LINES], ahead_ready, clock_of_use;
static struct block *blocks;

static bool has_line(uint32_t line) {
    for (int i = 0; i < LINES; i++) {
        if (lines[i] == line) {
            used[i] = ++clock_of_use;
            return true;
        }
    }
    return false;
}

static void keep_line(uint32_t line) {
    int oldest = 0;
    for (int i = 1; i < LINES; i++) {
        if (used[i] < used[oldest]) {
            oldest = i;
        }
    }
    lines[oldest] = line;
    used[oldest] = ++clock_of_use;
}

// Charge the fetch of a line of instructions, and begin to fetch the next one.
static void fetch(uint32_t line) {
    if (!has_line(line)) {
        if (line == ahead) {
            cycles += ahead_ready > cycles ? ahead_ready - cycles : 0;
        } else {
            cycles += FLASH_CLOCKS;
        }
        keep_line(line);
    }
    ahead = line + 1;
    ahead_ready = cycles + FLASH_CLOCKS;
}

static void read_data(unsigned cpu, qemu_plugin_meminfo_t info, uint64_t address, void *unused) {
    (void)cpu; (void)info; (void)unused;
    if (address < FLASH_END && !has_line((uint32_t)address / LINE_BYTES)) {
        cycles += FLASH_CLOCKS;
        keep_line((uint32_t)address / LINE_BYTES);
        ahead = NO_LINE;
    }
}

static void run_block(unsigned cpu, void *data) {
    (void)cpu;
    struct block *block = data;
    block->runs++;
    if (block->start != expected) {
        cycles += TAKEN;
    }
    expected = block->end;
    instructions += block->instructions;
    uint32_t first = block->start / LINE_BYTES, last = (block->end - 1) / LINE_BYTES;
    uint64_t each = block->cycles / (last - first + 1), rest = block->cycles;
    for (uint32_t line = first; line <= last; line++) {
        if (block->start < FLASH_END) {
            fetch(line);
        }
        uint64_t share = line == last ? rest : each;
        cycles += share;
        rest -= share;
    }
}

static void run_mark(unsigned cpu, void *data) {
    (void)cpu;
    struct record record = {(uint32_t)(uintptr_t)data, 0, instructions, cycles};
    fwrite(&record, sizeof record, 1, out);
}

static unsigned bits(uint32_t set) {
    return (unsigned)__builtin_popcount(set);
}

// Cycles of a 16-bit instruction.
static uint32_t short_cycles(uint16_t code) {
    if ((code & 0xF800) == 0x4800) {
        return 3; // LDR literal
    }
    if ((code & 0xF000) == 0x5000 || (code & 0xE000) == 0x6000 || (code & 0xF000) == 0x8000 ||
        (code & 0xF000) == 0x9000) {
        return 2; // LDR, STR
    }
    if ((code & 0xF600) == 0xB400) { // PUSH, POP; POP of the program counter branches
        return 1 + bits(code & 0x1FF);
    }
    if ((code & 0xF000) == 0xC000) {
        return 1 + bits(code & 0xFF); // LDM, STM
    }
    return 1;
}

// Cycles of a 32-bit instruction.
static uint32_t long_cycles(uint16_t one, uint16_t two) {
    if ((one & 0xFE40) == 0xE800) {
        return 1 + bits(two); // LDM, STM
    }
    if ((one & 0xFFF0) == 0xE8D0 && (two & 0xFFE0) == 0xF000) {
        return 5; // TBB, TBH, with its branch 6 or more
    }
    if ((one & 0xFE40) == 0xE840) {
        return 3; // LDRD, STRD
    }
    if ((one & 0xFE00) == 0xF800) {
        return (one & 0xF) == 0xF ? 3 : 2; // LDR, STR
    }
    if ((one & 0xFF80) == 0xFB80) {
        unsigned kind = one >> 4 & 7;
        return kind == 1 || kind == 3 ? 12 : 5; // SDIV, UDIV; long multiplications
    }
    if ((one & 0xFF80) == 0xFB00) {
        return 2; // MLA, MLS
    }
    return 1;
}

static uint32_t cycles_of(const struct qemu_plugin_insn *instruction) {
    uint16_t half[2] = {0, 0};
    size_t size = qemu_plugin_insn_size(instruction);
    memcpy(half, qemu_plugin_insn_data(instruction), size < 4 ? size : 4);
    return size == 4 ? long_cycles(half[0], half[1]) : short_cycles(half[0]);
}

static void translate(qemu_plugin_id_t id, struct qemu_plugin_tb *translated) {
    (void)id;
    struct block *block = calloc(1, sizeof *block);
    size_t count = qemu_plugin_tb_n_insns(translated);
    for (size_t i = 0; i < count; i++) {
        struct qemu_plugin_insn *instruction = qemu_plugin_tb_get_insn(translated, i);
        uint32_t address = (uint32_t)qemu_plugin_insn_vaddr(instruction);
        if (i == 0) {
            block->start = address;
        }
        block->end = address + (uint32_t)qemu_plugin_insn_size(instruction);
        block->cycles += cycles_of(instruction);
        qemu_plugin_register_vcpu_mem_cb(instruction, read_data, NO_REGISTERS, READS, NULL);
        for (uint32_t mark = 0; mark < mark_count; mark++) {
            if (marks[mark] == address) {
                qemu_plugin_register_vcpu_insn_exec_cb(
                    instruction, run_mark, NO_REGISTERS, (void *)(uintptr_t)mark);
            }
        }
    }
    block->instructions = (uint32_t)count;
    block->next = blocks;
    blocks = block;
    qemu_plugin_register_vcpu_tb_exec_cb(translated, run_block, NO_REGISTERS, block);
}

static void finish(qemu_plugin_id_t id, void *unused) {
    (void)id; (void)unused;
    fclose(out);
    if (profile != NULL) {
        for (const struct block *block = blocks; block != NULL; block = block->next) {
            fprintf(profile, "%" PRIu32 " %" PRIu64 " %" PRIu64 "\n", block->start,
                    block->runs * block->instructions, block->runs * block->cycles);
        }
        fclose(profile);
    }
}

__attribute__((visibility("default"))) int qemu_plugin_install(
    qemu_plugin_id_t id, const qemu_info_t *info, int argc, char **argv) {
    (void)info;
    for (int i = 0; i < argc; i++) {
        if (strncmp(argv[i], "out=", 4) == 0) {
            out = fopen(argv[i] + 4, "wb");
        } else if (strncmp(argv[i], "profile=", 8) == 0) {
            profile = fopen(argv[i] + 8, "w");
        } else if (strncmp(argv[i], "marks=", 6) == 0) {
            for (char *at = argv[i] + 6; *at != '\0' && mark_count < MARKS; at += *at == ':') {
                marks[mark_count++] = (uint32_t)strtoul(at, &at, 0);
            }
        }
    }
    if (out == NULL) {
        fprintf(stderr, "cycles: cannot write the file of out=\n");
        return 1;
    }
    memset(lines, 0xFF, sizeof lines);
    qemu_plugin_register_vcpu_tb_trans_cb(id, translate);
    qemu_plugin_register_atexit_cb(id, finish, NULL);
    return 0;
}
