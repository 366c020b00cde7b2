"""Open a serial line: 8 data bits, no parity, 1 stop bit, and no other process may open it."""

import errno
import fcntl
import os
import termios
from typing import Final

from runtime.errors import UserError

SERIAL_EXAMPLE: Final = "serial:/dev/ttyUSB0:57600"
_SPEEDS: Final = {
    int(name[1:]): value
    for name, value in vars(termios).items()
    if name[0] == "B" and name[1:].isdecimal() and int(name[1:]) > 0
}
"""The speeds that this system supports, with their codes."""
_ADVICE: Final = {
    errno.ENOENT: "no such device: list them with `ls /dev/tty* /dev/serial/by-id`",
    errno.ENXIO: "no such device: list them with `ls /dev/tty* /dev/serial/by-id`",
    errno.EACCES: "missing rights: join the group `dialout`, then log in again",
    errno.EBUSY: "another process uses this line: end it",
    errno.ENOTTY: "this file is not a serial line",
}


def open_line(device: str, baud: int) -> int:
    """Open a device and return its descriptor, which does not block; OSError if that fails."""
    descriptor = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        speed = _SPEEDS[baud]
        *_, characters = termios.tcgetattr(descriptor)
        control = termios.CS8 | termios.CREAD | termios.CLOCAL
        raw = [0, 0, control, 0, speed, speed, characters]
        termios.tcsetattr(descriptor, termios.TCSANOW, raw)
        fcntl.ioctl(descriptor, termios.TIOCEXCL)
    except BaseException as error:
        os.close(descriptor)
        if isinstance(error, termios.error):
            raise OSError(*error.args) from error
        raise
    return descriptor


def open_first(text: str, device: str, baud: int) -> int:
    """Open the device of an endpoint; UserError names the error and the fix."""
    if baud not in _SPEEDS:
        usual = "9600, 57600, 115200 or 921600"
        raise UserError(f"{text}: {baud} baud is not possible here: give {usual}")
    try:
        return open_line(device, baud)
    except OSError as error:
        raise UserError(f"{text}: {_ADVICE.get(error.errno or 0, str(error))}") from error
