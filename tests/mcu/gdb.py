"""Hang the processor of an emulated board, by the remote protocol of gdb."""

import socket
from pathlib import Path

BRANCH_TO_ITSELF = b"fee7"
RAM = 0x20000000
PROGRAM_COUNTER = 0xF


def hang(path: Path) -> None:
    """Let the processor execute a branch to itself, at the start of unused RAM."""
    place = RAM + 0x100000  # behind the RAM of the image, where the emulated machine has more
    with socket.socket(socket.AF_UNIX) as line:
        line.settimeout(10.0)
        line.connect(str(path))
        ask(line, b"?")
        ask(line, b"qXfer:features:read:target.xml:0,ffb")  # before it, registers are read-only
        assert ask(line, b"M%x,2:%s" % (place, BRANCH_TO_ITSELF)) == b"OK"
        assert ask(line, b"P%x=%s" % (PROGRAM_COUNTER, place.to_bytes(4, "little").hex().encode()))
        send(line, b"D")
        answer(line)


def ask(line: socket.socket, words: bytes) -> bytes:
    """Send a packet and return the answer."""
    send(line, words)
    return answer(line)


def send(line: socket.socket, words: bytes) -> None:
    """Send a packet."""
    line.sendall(b"$" + words + b"#%02x" % (sum(words) % 256))


def answer(line: socket.socket) -> bytes:
    """Return the next packet."""
    received = b""
    while b"#" not in received or len(received) - received.index(b"#") < 3:
        received += line.recv(4096)
    line.sendall(b"+")
    return received.partition(b"$")[2].partition(b"#")[0]
