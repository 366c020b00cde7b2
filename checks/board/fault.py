"""The faults of an emulated board, as data without behaviour."""

from enum import Enum, auto


class BoardFault(Enum):
    """A fault of the emulated board that runs the control core, or of its serial line."""

    HANG = auto()
    """Its program loops for ever, until its watchdog resets it."""
    SUSPEND = auto()
    """Its emulator is suspended."""
    RESET = auto()
    """It is reset."""
    KILL = auto()
    """Its emulator is killed."""
    CUT = auto()
    """Its line is cut."""
    OUTPUT_LOST = auto()
    """Its line loses all bytes to the host."""
    INPUT_LOST = auto()
    """Its line loses all bytes to the board."""
    GARBAGE = auto()
    """Its line carries bytes that belong to no frame, between the frames."""
