"""Send the stop of one robot by datagrams, without any session of the bus."""

import socket
import time
from ipaddress import ip_address
from itertools import chain
from threading import Event, Thread
from typing import Final, Self, TypeAlias

from protocol.bus.network import Network, Tls
from protocol.bus.rights import operator_name
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

REFRESH_S: Final = 10.0
"""Time between two look-ups of the names of a robot's addresses."""

Address: TypeAlias = tuple[int, tuple[str, int]]
"""Family, host and port."""

MOST_READ: Final = 64
"""Packets read at one look for answers; a flood of false ones must not hold it up."""


class StopDatagrams:
    """Sends the stop to one robot by datagrams and hears its answers; never blocks or raises.

    `holder` is the name in this process's certificate, None on an open bus.
    """

    def __init__(self, network: Network, robot: str, holder: str | None) -> None:
        self._missing = self._unresolved = self._unsent = ""
        self._robot = robot
        self._operator, self._secret = operator_name(holder) or "", OPEN_SECRET
        self._sockets: dict[int, socket.socket] = {}
        self._literal: list[Address] = []
        self._named: dict[tuple[str, int], list[Address]] = {}
        """The addresses by host and port, as they have resolved last."""

        self._closing = Event()
        self._stopped: set[int] = set()
        if network.tls is not None:
            self._take_secret(network.tls)
        if self._missing:
            return
        wanted = places(network, robot, network.connect)
        if not wanted:
            self._missing = (
                f"no address of {robot} for stop datagrams: name it in [network.stop_at]"
            )
        named = [place for place in wanted if not self._add_literal(place)]
        if named:  # a name server may take seconds, and the address of a robot may change
            Thread(target=self._keep_resolving, args=(named,), daemon=True).start()

    @property
    def why(self) -> str:
        """Why no stop can be sent; empty if one can, at least to one address."""
        return self._missing or self._unsent or ("" if self._addresses() else self._unresolved)

    def _addresses(self) -> list[Address]:
        return [*self._literal, *chain.from_iterable(tuple(self._named.values()))]

    def _take_secret(self, tls: Tls) -> None:
        if not self._operator:
            self._missing = "this certificate is not that of an operator"
            return
        try:
            found = load_secrets(tls)
        except KeysError as error:
            self._missing = str(error)
            return
        secret = found.by_name.get(self._robot)
        if secret is None:
            self._missing = found.missing or f"{secrets_path(tls)} has no secret for {self._robot}"
        else:
            self._secret = secret

    def _add_literal(self, place: tuple[str, int]) -> bool:
        """Add an address that needs no name server; return whether it is one."""
        host = "127.0.0.1" if place[0] == "localhost" else place[0]
        try:
            version = ip_address(host).version
        except ValueError:
            return False
        family = socket.AF_INET if version == 4 else socket.AF_INET6
        if self._can_send(family):
            self._literal.append((family, (host, place[1])))
        return True

    def _keep_resolving(self, named: list[tuple[str, int]]) -> None:
        while not self._closing.is_set():
            self._resolve(named)
            self._closing.wait(REFRESH_S)

    def _resolve(self, named: list[tuple[str, int]]) -> None:
        """Look up the names; one that does not resolve now keeps its addresses."""
        why = ""
        for host, port in named:
            try:
                found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
            except (OSError, UnicodeError) as error:
                why = f"the name {host} does not resolve: {error}"
                continue
            if self._closing.is_set():
                return
            self._named[host, port] = [
                (family, (str(address[0]), port))
                for family, _, _, _, address in found
                if self._can_send(family)
            ]
        self._unresolved = why

    def _can_send(self, family: int) -> bool:
        """Open a socket for a family of addresses; return whether there is one."""
        try:
            if family not in self._sockets:
                opened = socket.socket(family, socket.SOCK_DGRAM)
                opened.setblocking(False)
                self._sockets[family] = opened
        except OSError as error:
            self._unsent = f"no datagram can be sent: {error.strerror}"
            return False
        return True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def press(self, request_id: int) -> None:
        """Send the stop once to each address."""
        addresses = self._addresses()
        if not addresses:
            return
        press = Press(self._operator, time.time_ns(), request_id)
        packet = sealed_press(self._secret, self._robot, press)
        sent, why = 0, ""
        for family, address in addresses:
            try:
                sent += self._sockets[family].sendto(packet, address) > 0
            except OSError as error:
                why = f"no datagram could be sent to {address[0]}: {error.strerror}"
        self._unsent = "" if sent else why

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
        self._closing.set()
        for opened in tuple(self._sockets.values()):
            opened.close()
