"""Show the board that runs the control core, if there is one: its modelled time and its memory."""

from typing import Final

from ground.app.panels.aged import aged, live, role_of
from ground.app.widgets.rows import Row, Span, head, row
from ground.station.station import Station
from protocol.topics import MCU
from protocol.wire.messages import McuStatus

US_PER_MS: Final = 1000.0
BYTES_PER_KB: Final = 1000.0


def board_rows(station: Station) -> list[Row]:
    """Return one row for the side panel; none if no board was ever seen."""
    seen = station.seen(MCU)
    if not isinstance(seen.message, McuStatus):
        return []
    return [row(head(f"{name_of(seen.message)} "), aged(seen, short_words))]


def board_details(station: Station) -> list[Row]:
    """Return the rows of the Links screen; none if no board was ever seen."""
    seen = station.seen(MCU)
    if not isinstance(seen.message, McuStatus):
        return []
    status: McuStatus | None = live(seen)
    first = row(head(f" {name_of(seen.message)}  "), aged(seen, time_words))
    if status is None:
        return [first]
    memory = Span(f"         {memory_words(status)}, ", role_of(seen))
    noise = "caution" if status.skipped_bytes else "text"
    return [first, row(memory, Span(f"{status.skipped_bytes} bytes skipped", role_of(seen, noise)))]


def name_of(status: McuStatus) -> str:
    """Return the kind of the board."""
    return "MCU (emulated)" if status.emulated else "MCU"


def short_words(status: McuStatus) -> str:
    """Return the modelled time until the wheel command, and the RAM in use."""
    return f"{ms(status.command_us)} ms  {kilobytes(status.ram_bytes)} kB"


def time_words(status: McuStatus) -> str:
    """Return the modelled times, compared with the control period."""
    command, busy = ms(status.command_us), ms(status.busy_us)
    return f"command after {command} ms, done after {busy} of {ms(status.budget_us)} ms (modelled)"


def memory_words(status: McuStatus) -> str:
    """Return the RAM in use at most, of that which the image has."""
    return f"RAM {kilobytes(status.ram_bytes)} of {kilobytes(status.ram_size_bytes)} kB"


def ms(time_us: int) -> str:
    """Return a time in milliseconds."""
    return f"{time_us / US_PER_MS:.1f}"


def kilobytes(count: int) -> str:
    """Return a number of bytes in kilobytes."""
    return f"{count / BYTES_PER_KB:.1f}"
