"""The stop datagram: one UDP packet that can stop a robot, and nothing else.

It needs no session, so that nobody who keeps the bus busy can keep an operator out. On a locked bus
it carries an HMAC-SHA256 by a secret that one operator and one robot share; on an open bus anyone
may stop, as there by the bus. A doubtful datagram stops too. The time in it spares only needless
stops: a copy that is sent again after the stop was released is told from a new press.
"""

import hmac
import re
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from pathlib import Path
from struct import Struct
from typing import Final, NamedTuple

from protocol.bus.network import Network, Tls
from protocol.bus.rights import GATEWAY, GROUND, OPEN, OPERATOR
from protocol.topic import ROBOT_NAME
from runtime.config import load
from runtime.errors import ConfigError, KeysError

PRESS: Final = b"SSTP"
ANSWER: Final = b"SSTA"
VERSION: Final = 1
PRESS_BODY: Final = Struct("<4sB16s16sQQ")
"""Magic, version, robot, operator, time of sending in ns of UTC, id of the request."""

ANSWER_BODY: Final = Struct("<4sB16s16sQQB")
"""The same of the press that it answers, and whether that press has stopped the robot."""

MAC_BYTES: Final = 32
PRESS_BYTES: Final = PRESS_BODY.size + MAC_BYTES
ANSWER_BYTES: Final = ANSWER_BODY.size + MAC_BYTES
SECRET_BYTES: Final = 32
SECRET: Final = re.compile(r"[0-9a-f]{64}\Z")
SECRETS: Final = ".stops"
"""Ending of the file of secrets, which lies beside the private key of the same name."""

KNOWN_IDS: Final = 256
"""Presses of one operator whose repetitions are told from new presses; older ones stop anew."""

OPEN_SECRET: Final = b""
ADD_SECRETS: Final = "`sidestep keys stops DIR` adds them to a folder of keys"


@dataclass(frozen=True, kw_only=True)
class SecretsFile:
    """The file `ROLE.stops`, with secrets as hexadecimal digits.

    A robot's file has one for each operator, an operator's file one for each robot.
    """

    secrets: dict[str, str] = field(default_factory=dict)


class Press(NamedTuple):
    """A stop as it was sent: who stops, when, and the id that all repetitions share."""

    operator: str
    stamp_ns: int
    request_id: int


class PressVerdict(Enum):
    """What a packet is: a stop to act on, a copy of one that was acted on, or no stop at all."""

    STOP = auto()
    REPLAY = auto()
    FALSE = auto()


def sealed_press(secret: bytes, robot: str, press: Press) -> bytes:
    """Return the packet of a press."""
    names = robot.encode(), press.operator.encode()
    return _with_mac(
        secret, PRESS_BODY.pack(PRESS, VERSION, *names, press.stamp_ns, press.request_id)
    )


def press_in(packet: bytes, robot: str, secret_of: Callable[[str], bytes | None]) -> Press | None:
    """Return the press in a packet; None unless it is whole, for this robot and authentic."""
    if len(packet) != PRESS_BYTES:
        return None
    magic, version, name, operator, stamp_ns, request_id = PRESS_BODY.unpack_from(packet)
    if magic != PRESS or version != VERSION or name.rstrip(b"\0") != robot.encode():
        return None
    operator = operator.rstrip(b"\0").decode("ascii", "replace")
    secret = secret_of(operator)
    if secret is None or not _is_authentic(secret, packet):
        return None
    return Press(operator, stamp_ns, request_id)


def sealed_answer(secret: bytes, robot: str, press: Press, *, stopped: bool) -> bytes:
    """Return the packet that answers a press."""
    names = robot.encode(), press.operator.encode()
    body = ANSWER_BODY.pack(ANSWER, VERSION, *names, press.stamp_ns, press.request_id, stopped)
    return _with_mac(secret, body)


def stopped_by(packet: bytes, secret: bytes, robot: str, operator: str) -> int | None:
    """Return the id of the press that has stopped the robot, by its answer; else None."""
    if len(packet) != ANSWER_BYTES:
        return None
    magic, version, *names, _, request_id, stopped = ANSWER_BODY.unpack_from(packet)
    expected = [robot.encode(), operator.encode()]
    is_ours = magic == ANSWER and version == VERSION
    is_ours = is_ours and [name.rstrip(b"\0") for name in names] == expected
    if not is_ours or not stopped or not _is_authentic(secret, packet):
        return None
    return int(request_id)


def _with_mac(secret: bytes, body: bytes) -> bytes:
    return body + hmac.digest(secret, body, "sha256")


def _is_authentic(secret: bytes, packet: bytes) -> bool:
    body, mac = packet[:-MAC_BYTES], packet[-MAC_BYTES:]
    return hmac.compare_digest(mac, hmac.digest(secret, body, "sha256"))


class StopJudge:
    """Tell for one robot what a packet is; sans-I/O and without a clock.

    `secrets` are those of its operators; None on an open bus, where anyone may stop.
    """

    def __init__(self, robot: str, secrets: Mapping[str, bytes] | None) -> None:
        self._robot, self._secrets = robot, secrets
        self._known: dict[str, OrderedDict[int, int]] = {}
        """The time of the newest packet of each known press, by operator and id."""

    def secret_of(self, operator: str) -> bytes | None:
        """Return the secret of an operator; None if it has none."""
        if self._secrets is not None:
            return self._secrets.get(operator)
        return OPEN_SECRET if operator == OPEN else None

    def judge(self, packet: bytes) -> tuple[PressVerdict, Press | None]:
        """Return what a packet is, and the press in it unless it is false.

        A press older than the newest one stops too, unless it repeats a known one: after a restart
        or a change of the operator's clock nobody can tell, and a needless stop costs little.
        """
        press = press_in(packet, self._robot, self.secret_of)
        if press is None:
            return PressVerdict.FALSE, None
        known = self._known.setdefault(press.operator, OrderedDict())
        newest_ns = known.get(press.request_id)
        if newest_ns is not None and press.stamp_ns <= newest_ns:
            return PressVerdict.REPLAY, press
        known[press.request_id] = press.stamp_ns
        known.move_to_end(press.request_id)
        if len(known) > KNOWN_IDS:
            known.popitem(last=False)
        return PressVerdict.STOP, press


class StopSecrets(NamedTuple):
    """The secrets in a process's file, by operator or by robot; `missing` is why there are none."""

    by_name: Mapping[str, bytes]
    missing: str = ""


def secrets_path(tls: Tls) -> Path:
    """Return the file of a process's stop secrets: it lies beside its private key."""
    return Path(tls.key).with_suffix(SECRETS)


def load_secrets(tls: Tls) -> StopSecrets:
    """Return the stop secrets of a process; KeysError for a file that is not readable or wrong."""
    path = secrets_path(tls)
    try:
        if not path.exists():
            return StopSecrets({}, f"{path} is missing: {ADD_SECRETS}")
        file = load(path, SecretsFile)
    except OSError as error:
        raise KeysError(f"{path}: {error.strerror}") from error
    except ConfigError as error:
        raise KeysError(str(error)) from error
    for name, digits in file.secrets.items():
        if not (ROBOT_NAME.match(name) and SECRET.match(digits)):
            raise KeysError(
                f"{path}: {name}: not a name with 64 hexadecimal digits:"
                " copy the file again from the folder of the keys"
            )
    return StopSecrets({name: bytes.fromhex(digits) for name, digits in file.secrets.items()})


def role_of(operator: str) -> str:
    """Return the name of an operator's certificate."""
    return operator if operator in (GROUND, GATEWAY) else OPERATOR + operator


def operators_secrets(network: Network) -> StopSecrets | None:
    """Return for a robot the secrets of all operators that are not revoked; None without TLS."""
    if network.tls is None:
        return None
    found = load_secrets(network.tls)
    valid = {name: secret for name, secret in found.by_name.items() if not revoked(network, name)}
    return found._replace(by_name=valid)


def revoked(network: Network, operator: str) -> bool:
    """Return whether the certificate of an operator is revoked, and its stop secret with it."""
    return role_of(operator) in network.revoked


def place_in(address: str) -> tuple[str, int]:
    """Return host and port of `HOST:PORT`, without the brackets of an IPv6 address."""
    host, _, port = address.rpartition(":")
    return host.strip("[]"), int(port)


def places(network: Network, robot: str, endpoints: tuple[str, ...]) -> list[tuple[str, int]]:
    """Return where a robot receives stop datagrams: host and port.

    That is its entry in `stop_at`, else the same host and port as its endpoints of TCP or TLS.
    """
    if robot in network.stop_at:
        return [place_in(network.stop_at[robot])]
    addresses = (endpoint.partition("/") for endpoint in endpoints)
    bare = (
        address.partition("#")[0].partition("?")[0]
        for protocol, _, address in addresses
        if protocol in ("tcp", "tls")
    )
    return [place_in(address) for address in bare]
