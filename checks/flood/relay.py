"""A relay between a session and the hub that passes on the hub's bytes slowly."""

import socket
import threading
from contextlib import ExitStack, suppress
from typing import Final, Self

from checks.harness.tcp_proxy import address_of, close_socket

CHUNK: Final = 1024
BUFFER: Final = 4096
"""Size of the receive buffer: the system grants at least this."""


class SlowRelay:
    """Forwards bytes both ways, those from the hub at `bytes_per_s`; clients dial `endpoint`."""

    def __init__(self, endpoint: str, bytes_per_s: float) -> None:
        self._far = address_of(endpoint)
        self._pause_s = CHUNK / bytes_per_s
        self._closing = threading.Event()
        self._sockets = ExitStack()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._sockets.callback(close_socket, self._listener)
        self.endpoint = f"{endpoint.partition('/')[0]}/127.0.0.1:{self._listener.getsockname()[1]}"
        threading.Thread(target=self._accept_connections, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._sockets.close()

    def _accept_connections(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._listener.accept()
                far = socket.socket()
                far.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
                for end in (near, far):
                    self._sockets.callback(close_socket, end)
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
