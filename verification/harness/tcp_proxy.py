"""A cable between a client and the hub that can be cut: nothing comes back, not even a no."""

import socket
import threading
from contextlib import ExitStack, suppress
from typing import Self


class Cable:
    """Forwards bytes both ways; once cut it forwards nothing and takes no more calls."""

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
        threading.Thread(target=self._take_calls, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._fillers.close()
        self._shut_listener()
        self._sockets.close()

    def cut(self) -> None:
        """A full backlog lets the system drop further calls: they run into their time limit."""
        self._whole.clear()
        self._shut_listener()
        self._listener = self._listening(self._port, backlog=0)
        for _ in range(4):
            filler = self._fillers.enter_context(socket.socket())
            filler.setblocking(False)
            with suppress(BlockingIOError):
                filler.connect(("127.0.0.1", self._port))

    def plug_in(self, endpoint: str) -> None:
        """Close all connections; from now on connect callers to `endpoint`."""
        self._far = address_of(endpoint)
        self._sockets.close()

    def mend(self) -> None:
        self._fillers.close()
        self._shut_listener()
        self._listener = self._listening(self._port, backlog=5)
        self._whole.set()
        threading.Thread(target=self._take_calls, daemon=True).start()

    def _shut_listener(self) -> None:
        hang_up(self._listener)

    @staticmethod
    def _listening(port: int, *, backlog: int) -> socket.socket:
        listener = socket.socket()
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(("127.0.0.1", port))
        listener.listen(backlog)
        return listener

    def _take_calls(self) -> None:
        listener = self._listener
        with suppress(OSError):
            while True:
                near, _ = listener.accept()
                try:
                    far = socket.create_connection(self._far)
                except OSError:  # nobody is at home: so hears who calls
                    hang_up(near)
                    continue
                for end in (near, far):
                    self._sockets.callback(hang_up, end)
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


def hang_up(end: socket.socket) -> None:
    """A thread that waits on it is let go."""
    with suppress(OSError):
        end.shutdown(socket.SHUT_RDWR)
    end.close()
