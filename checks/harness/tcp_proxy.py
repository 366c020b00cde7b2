"""A TCP proxy between a client and the hub whose connection can be cut silently."""

import socket
import threading
from contextlib import ExitStack, suppress
from typing import Self


class TcpProxy:
    """Forwards bytes both ways; once cut it forwards nothing and accepts no connections."""

    def __init__(self, endpoint: str) -> None:
        protocol = endpoint.partition("/")[0]
        self._far = address_of(endpoint)
        self._sockets = ExitStack()
        self._fillers = ExitStack()
        self._whole = threading.Event()
        self._whole.set()
        self._listener = self._listening(0, backlog=5)
        self._port = self._listener.getsockname()[1]
        self.endpoint = f"{protocol}/127.0.0.1:{self._port}"
        threading.Thread(target=self._accept_connections, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._fillers.close()
        close_socket(self._listener)
        self._sockets.close()

    def cut(self) -> None:
        """Forward nothing from now on; with its backlog full, connection attempts time out."""
        self._whole.clear()
        close_socket(self._listener)
        self._listener = self._listening(self._port, backlog=0)
        for _ in range(4):
            filler = self._fillers.enter_context(socket.socket())
            filler.setblocking(False)
            with suppress(BlockingIOError):
                filler.connect(("127.0.0.1", self._port))

    def redirect(self, endpoint: str) -> None:
        """Close all connections, and connect clients to `endpoint` from now on."""
        self._far = address_of(endpoint)
        self._sockets.close()

    def restore(self) -> None:
        """Forward and accept connections again."""
        self._fillers.close()
        close_socket(self._listener)
        self._listener = self._listening(self._port, backlog=5)
        self._whole.set()
        threading.Thread(target=self._accept_connections, daemon=True).start()

    @staticmethod
    def _listening(port: int, *, backlog: int) -> socket.socket:
        listener = socket.socket()
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(("127.0.0.1", port))
        listener.listen(backlog)
        return listener

    def _accept_connections(self) -> None:
        listener = self._listener
        with suppress(OSError):
            while True:
                near, _ = listener.accept()
                try:
                    far = socket.create_connection(self._far)
                except OSError:  # the far end refuses, so the client is refused too
                    close_socket(near)
                    continue
                for end in (near, far):
                    self._sockets.callback(close_socket, end)
                for pair in ((near, far), (far, near)):
                    threading.Thread(target=self._forward, args=pair, daemon=True).start()

    def _forward(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(65_536):
                if self._whole.is_set():
                    sink.sendall(data)
            sink.shutdown(socket.SHUT_RDWR)


def address_of(endpoint: str) -> tuple[str, int]:
    """Return host and port of an endpoint such as tcp/127.0.0.1:7447."""
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    return host, int(port)


def close_socket(end: socket.socket) -> None:
    """Close a socket and wake the threads that wait on it."""
    with suppress(OSError):
        end.shutdown(socket.SHUT_RDWR)
    end.close()
