"""Send the stop of one robot by datagrams, without any session of the bus."""

import socket
import time
from collections.abc import Callable
from ipaddress import ip_address
from threading import Thread
from typing import Final, Self

from protocol.bus.network import Network, Tls
from protocol.bus.tls.role_grants import operator_name
from protocol.stop_datagram import (
    ANSWER_BYTES,
    OPEN_SECRET,
    Press,
    load_secrets,
    places,
    sealed_press,
    secrets_path,
    stopped_by,
)
from runtime.errors import KeysError

MOST_READ: Final = 64
"""Packets read at one look for answers; a flood of false ones must not hold it up."""


class StopDatagrams:
    """Sends the stop to one robot by datagrams and hears its answers; never blocks or raises.

    `holder` is the name in this process's certificate, None on an open bus. `why` is the reason why
    no stop can be sent; empty if it can.
    """

    def __init__(
        self,
        network: Network,
        robot: str,
        holder: str | None,
        time_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self.why = ""
        self._robot, self._time_ns = robot, time_ns
        self._operator, self._secret = operator_name(holder) or "", OPEN_SECRET
        self._sockets: dict[int, socket.socket] = {}
        self._addresses: list[tuple[int, tuple[str, int]]] = []
        self._stopped: set[int] = set()
        if network.tls is not None:
            self._take_secret(network.tls)
        if self.why:
            return
        wanted = places(network, robot, network.connect)
        if not wanted:
            self.why = f"no address of {robot} for stop datagrams: name it in [network.stop_at]"
        named = [place for place in wanted if not self._add_literal(place)]
        if named:  # a name server may take seconds
            Thread(target=self._resolve, args=(named,), daemon=True).start()

    def _take_secret(self, tls: Tls) -> None:
        if not self._operator:
            self.why = "this certificate is not that of an operator"
            return
        try:
            found = load_secrets(tls)
        except KeysError as error:
            self.why = str(error)
            return
        secret = found.by_name.get(self._robot)
        if secret is None:
            self.why = found.missing or f"{secrets_path(tls)} has no secret for {self._robot}"
        else:
            self._secret = secret

    def _add_literal(self, place: tuple[str, int]) -> bool:
        """Add an address that needs no name server; return whether it is one."""
        host = "127.0.0.1" if place[0] == "localhost" else place[0]
        try:
            version = ip_address(host).version
        except ValueError:
            return False
        self._add(socket.AF_INET if version == 4 else socket.AF_INET6, (host, place[1]))
        return True

    def _resolve(self, named: list[tuple[str, int]]) -> None:
        for host, port in named:
            try:
                found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
            except (OSError, UnicodeError) as error:
                self.why = f"the name {host} does not resolve: {error}"
                continue
            for family, _, _, _, address in found:
                self._add(family, (str(address[0]), port))

    def _add(self, family: int, address: tuple[str, int]) -> None:
        try:
            if family not in self._sockets:
                opened = socket.socket(family, socket.SOCK_DGRAM)
                opened.setblocking(False)
                self._sockets[family] = opened
            self._addresses.append((family, address))
        except OSError as error:
            self.why = f"no datagram can be sent: {error.strerror}"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def press(self, request_id: int) -> None:
        """Send the stop once to each address."""
        if not self._addresses:
            return
        press = Press(self._operator, self._time_ns(), request_id)
        packet = sealed_press(self._secret, self._robot, press)
        for family, address in tuple(self._addresses):
            try:
                self._sockets[family].sendto(packet, address)
            except OSError as error:
                self.why = f"no datagram could be sent to {address[0]}: {error.strerror}"

    def has_stopped(self, request_id: int) -> bool:
        """Return whether the robot has answered that this press has stopped it."""
        for opened in tuple(self._sockets.values()):
            for _ in range(MOST_READ):
                try:
                    packet = opened.recv(ANSWER_BYTES + 1)
                except OSError:  # nothing there, or no process at that port
                    break
                found = stopped_by(packet, self._secret, self._robot, self._operator)
                if found is not None:
                    self._stopped.add(found)
        return request_id in self._stopped

    def close(self) -> None:
        """Close the sockets."""
        for opened in tuple(self._sockets.values()):
            opened.close()
