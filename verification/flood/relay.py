"""A reader that is slow: between a session and the hub, what the hub sends is passed on slowly."""

import socket
import threading
from contextlib import ExitStack, suppress
from typing import Final, Self

from verification.harness.tcp_proxy import hang_up

CHUNK: Final = 1024
BUFFER: Final = 4096
"""Of the system, for what has come and was not taken: as little as it grants."""


class SlowRelay:
    """Passes bytes on both ways, those from the hub at `bytes_per_s`. Dial `endpoint`."""

    def __init__(self, endpoint: str, bytes_per_s: float) -> None:
        protocol, _, address = endpoint.partition("/")
        host, _, port = address.rpartition(":")
        self._far = (host, int(port))
        self._pause_s = CHUNK / bytes_per_s
        self._closing = threading.Event()
        self._sockets = ExitStack()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._sockets.callback(hang_up, self._listener)
        self.endpoint = f"{protocol}/127.0.0.1:{self._listener.getsockname()[1]}"
        threading.Thread(target=self._take_calls, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._sockets.close()

    def _take_calls(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._listener.accept()
                far = socket.socket()
                far.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
                for end in (near, far):
                    self._sockets.callback(hang_up, end)
                far.connect(self._far)
                for pair in ((near, far, 0.0), (far, near, self._pause_s)):
                    threading.Thread(target=self._pass_on, args=pair, daemon=True).start()

    def _pass_on(self, source: socket.socket, sink: socket.socket, pause_s: float) -> None:
        with suppress(OSError):
            while data := source.recv(CHUNK if pause_s else 65_536):
                sink.sendall(data)
                if pause_s:
                    self._closing.wait(pause_s)
            sink.shutdown(socket.SHUT_RDWR)
