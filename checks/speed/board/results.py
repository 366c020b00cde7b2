"""Measured costs of the core on the board, as they are committed, and their ceilings."""

from pathlib import Path
from typing import Final, NamedTuple

import msgspec

ROOT: Final = Path(__file__).resolve().parents[3]
FOLDER: Final = ROOT / "docs" / "evidence" / "microcontroller"
COSTS: Final = FOLDER / "cost.json"


class Cost(msgspec.Struct, frozen=True, kw_only=True):
    """Worst ticks of one drive or scenario: times modelled in milliseconds, memory in bytes.

    `command` is the path from the inputs to the wheel command, `whole` everything since the end of
    the tick before. `heap_peak` and `stack` are the largest since the reset. `equal`: the digest of
    the drive, or every estimated pose of the scenario, is that of the core in this process.
    """

    navigator: str
    world: str
    ticks: int
    equal: bool
    command_instructions: int
    whole_instructions: int
    command_ms: float
    median_ms: float
    whole_ms: float
    cycles_per_instruction: float
    heap_live: int
    heap_peak: int
    allocated: int
    stack: int


class Build(msgspec.Struct, frozen=True, kw_only=True):
    """The measured image; sizes in bytes, hashes are the beginnings of SHA-256."""

    image: str
    core: str
    flash: int
    static: int
    heap: int
    stack: int


class Costs(msgspec.Struct):
    """All measurements with one image; `searched`: ticks that the search ran for each navigator.

    `state_bytes`: the largest state of each navigator on the heap of the board.
    """

    build: Build
    noise: str
    seed: int
    limit_s: float
    drives: list[Cost] = []
    searched: int = 0
    hardest: list[Cost] = []
    state_bytes: dict[str, int] = {}


class Ceiling(NamedTuple):
    """Limits of the worst tick in milliseconds: the target, and the ceilings of the gate."""

    wanted_ms: float
    command_ms: float
    whole_ms: float


CEILINGS: Final = {
    "bug": Ceiling(12.5, 9.5, 14.5),
    "vgm": Ceiling(12.5, 9.5, 14.0),
    "vgm_memory": Ceiling(25.0, 19.5, 23.0),
    "bug1": Ceiling(25.0, 19.0, 22.5),
    "bug2": Ceiling(25.0, 19.0, 22.5),
    "distbug": Ceiling(25.0, 19.0, 22.5),
}
FLASH_BYTES: Final = 512 * 1024
RAM_BYTES: Final = 64 * 1024
WANTED_RAM_BYTES: Final = 32 * 1024
STACK_BYTES: Final = 4 * 1024
HEAP_LIVE_BYTES: Final = 32 * 1024


def excesses(build: Build, cost: Cost) -> list[str]:
    """Return a text about each figure that is above its ceiling."""
    ceiling = CEILINGS[cost.navigator]
    figures = (
        ("command path, ms", cost.command_ms, ceiling.command_ms),
        ("whole tick, ms", cost.whole_ms, ceiling.whole_ms),
        ("live heap, bytes", cost.heap_live, HEAP_LIVE_BYTES),
        ("stack, bytes", cost.stack, STACK_BYTES),
        ("RAM, bytes", ram_bytes(build, cost), RAM_BYTES),
        ("flash, bytes", build.flash, FLASH_BYTES),
    )
    where = f"{cost.navigator} in {cost.world}"
    return [
        f"{where}: {name}: {found:g} > {most:g}" for name, found, most in figures if found > most
    ]


def ram_bytes(build: Build, cost: Cost) -> int:
    """Return static memory, the largest use of the heap and that of the stack."""
    return build.static + cost.heap_peak + cost.stack


def read(path: Path = COSTS) -> Costs:
    """Return the committed measurements."""
    return msgspec.json.decode(path.read_bytes(), type=Costs)


def write(costs: Costs, path: Path = COSTS) -> None:
    """Replace the measurements in a file."""
    costs.drives.sort(key=lambda cost: (cost.navigator, cost.world))
    costs.hardest.sort(key=lambda cost: (cost.navigator, cost.world))
    new = path.with_suffix(".new")
    new.write_bytes(msgspec.json.format(msgspec.json.encode(costs), indent=1) + b"\n")
    new.replace(path)
