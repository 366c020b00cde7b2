"""Cost table of MicroPython operations on a Cortex-M3 without FPU, and its origin.

Instructions were measured on MicroPython 1.25 (port qemu, board MPS2_AN385, soft float, -Os, floats
boxed on the heap) in an emulated Cortex-M3 with `-icount`. Each operation ran eight times in a loop
of fifty, counted with the board's own timer; the loads and stores around it were subtracted. An
assembler loop of 40,000 instructions was counted as 40,000 plus a constant 1.7 thousand for the two
reads.

Cross-checks: the whole step on recorded drives, emulated and by this table (UNCOUNTED_FACTOR
below). SEGGER publishes 34 cycles for an addition of their soft float on Cortex-M (kb.segger.com,
Floating-Point Library): nine tenths of `x + y` is the interpreter and the heap.
"""

from collections.abc import Mapping

CLOCK_HZ = 96_000_000
PERIOD_MS = 50.0

CYCLES_PER_INSTRUCTION = 1.6
"""From the traced mix of instructions while the core ran: half of them arithmetic (1), 12 % loads
(2), 26 % branches (3 when taken, by the Cortex-M3 manual): 1.59. Memory has no wait states: the
flash accelerator of the LPC1768 may add a quarter, computed goto in the interpreter may subtract
one. So the milliseconds are accurate to about 25 %. They compare with 4.3 to 4.6 ms at 96 MHz
modelled for a realistic core on the same emulator."""

INSTRUCTIONS: Mapping[str, float] = {
    # names
    "local": 24,
    "store local": 21,
    "constant": 16,
    "global": 58,
    "attribute": 59,
    "store attribute": 94,
    "attribute of module": 117,
    "field": 99,
    "field, each before it": 7,
    # integers, up to 30 bits; a longer one lives on the heap
    "int": 58,
    "int compare": 53,
    "long int": 900,
    # floats, each result boxed
    "float + - *": 327,
    "float /": 466,
    "float %": 463,
    "float negate": 208,
    "float compare": 170,
    "float of ints /": 403,
    # other operators
    "is": 40,
    "not": 60,
    "in": 200,
    "in, each": 90,
    "compare tuple": 70,
    "compare tuple, each": 65,
    "item": 80,
    "item of array": 100,
    "item, boxed": 244,
    "store item": 88,
    "store item of array": 145,
    "slice": 760,
    # flow
    "jump": 34,
    "range, each": 215,
    "loop": 160,
    "loop, each": 112,
    # calls; the prologue of a function of the core counts the call
    "call": 346,
    "argument": 20,
    "default": 44,
    "keyword": 140,
    "star": 430,
    "abs": 430,
    "min or max": 520,
    "min or max, float": 600,
    "int()": 460,
    "len": 260,
    "other builtin": 700,
    "method": 270,
    "sqrt": 640,
    "sin or cos": 1590,
    "sin or cos, small": 1160,
    "atan2": 1560,
    "tanh": 2110,
    "other of math": 2200,
    # heap
    "make tuple": 200,
    "make tuple, each": 14,
    "make named tuple": 205,
    "make named tuple, each": 34,
    "make list": 450,
    "make list, each": 60,
    "make object": 700,
    "unpack": 36,
    "unpack, each": 20,
    "unpack named tuple": 230,
    "unpack named tuple, each": 45,
}

UNCOUNTED_FACTOR = 1.25
"""Factor for costs outside the table: search in the heap, collisions in maps. Emulated over counted
for the same 299 ticks of u_trap (noise `default`): medians 1.24 to 1.26 for bug, vgm, bug1 and
bug2, single ticks 1.14 to 1.34, lowest for the most expensive ones. Emulated, in thousands of
instructions, median and worst: bug 482 and 567, vgm 466 and 531, bug1 647 and 1190, bug2 648 and
1183. A garbage collection took 470 to 540 thousand more, between the ticks."""


def milliseconds(instructions: float) -> float:
    """Return the time of this many instructions."""
    return instructions * CYCLES_PER_INSTRUCTION / CLOCK_HZ * 1e3


def share_percent(instructions: float) -> float:
    """Return the share of the control period."""
    return 100.0 * milliseconds(instructions) / PERIOD_MS
