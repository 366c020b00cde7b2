"""The names and bytes of rmw_zenoh: keys, liveliness tokens, QoS, attachments and type hashes.

A ROS 2 node with this middleware finds others by their liveliness tokens alone, and takes a sample
only if it comes with an attachment. Nothing here does I/O.
"""

import struct
from dataclasses import dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import xxhash

from ground.ros2.offer import Qos
from runtime.errors import UserError

GRAPH: Final = "@ros2_lv"
"""The first part of each liveliness token."""

HASHES: Final = Path(__file__).with_name("hashes.json")
NO_HASHES: Final = "TypeHashNotSupported"
"""What Humble writes in the place of a type hash."""

HUMBLE: Final = (
    "Humble is not supported: its keys have no type hashes, so its nodes exchange no data with"
    " those of later distributions. Use Jazzy, Kilted or Lyrical"
)
ATTACHMENT: Final = struct.Struct("<qqB16s")
GID_BYTES: Final = 16


class Distro(Enum):
    """The distributions of ROS 2 whose keys this gateway writes."""

    JAZZY = "jazzy"
    KILTED = "kilted"
    LYRICAL = "lyrical"


class EntityKind(Enum):
    """What a liveliness token stands for."""

    NODE = "NN"
    PUBLISHER = "MP"
    SUBSCRIBER = "MS"
    SERVER = "SS"
    CLIENT = "SC"


def distro_named(name: str) -> Distro:
    """Return the distribution; UserError for one that this gateway does not support."""
    if name.lower() == "humble":
        raise UserError(HUMBLE)
    try:
        return Distro(name.lower())
    except ValueError:
        known = ", ".join(distro.value for distro in Distro)
        raise UserError(f"--distro {name}: use one of {known}") from None


class HashTable(msgspec.Struct, frozen=True):
    """RIHS01 hashes by the name of the type: those that all distributions share, and the others."""

    common: dict[str, str]
    nav2: dict[str, dict[str, str]]


@cache
def hash_table() -> HashTable:
    """Return the table of this package."""
    return msgspec.json.decode(HASHES.read_bytes(), type=HashTable)


def hash_of(name: str, distro: Distro) -> str:
    """Return the hash of a type, such as `nav_msgs/msg/Odometry`; KeyError for an unknown one."""
    table = hash_table()
    found = table.common.get(name)
    return table.nav2[distro.value][name] if found is None else found


# Quality of service.


DEFAULT_DEPTH: Final = 42


def qos_text(qos: Qos) -> str:
    """Return the text in a token; a field that has its default is empty."""
    reliability = "" if qos.is_reliable else "2"
    durability = "1" if qos.is_latched else ""
    depth = "" if qos.depth == DEFAULT_DEPTH else str(qos.depth)
    lifespan = f"{qos.lifespan_s},0" if qos.lifespan_s else ","
    return f"{reliability}:{durability}:,{depth}:,:{lifespan}:,,"


# Keys and tokens.


def type_in_key(name: str) -> str:
    """Return a type as keys write it: `nav_msgs::msg::dds_::Odometry_`."""
    package, kind, base = name.split("/")
    return f"{package}::{kind}::dds_::{base}_"


def type_of(in_key: str) -> str:
    """Return a type as people write it, from how keys write it."""
    package, _, rest = in_key.partition("::")
    return f"{package}/{rest.replace('::dds_::', '/').removesuffix('_')}"


def mangled(name: str) -> str:
    """Return a name as tokens write it; an empty one becomes `%`."""
    return name.replace("/", "%") or "%"


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A topic or service with its type: `name` is absolute, such as `/r1/odom`."""

    name: str
    type_name: str
    type_hash: str

    def key(self, domain: int) -> str:
        """Return the key of its samples or queries."""
        return f"{domain}/{self.name.strip('/')}/{type_in_key(self.type_name)}/{self.type_hash}"


@dataclass(frozen=True, slots=True)
class NodeName:
    """A node: `namespace` is absolute, such as `/r1`, or empty; `number` is that in its session."""

    namespace: str
    name: str
    number: int = 0

    def resolve(self, name: str) -> str:
        """Return an absolute name: `odom` is below the namespace, `~/x` below the node."""
        if name.startswith("/"):
            return name
        if name.startswith("~/"):
            return f"{self.namespace}/{self.name}/{name[2:]}"
        return f"{self.namespace}/{name}"

    def token(self, domain: int, zid: str) -> str:
        """Return the liveliness token of the node itself."""
        return self._token(domain, zid, self.number, EntityKind.NODE)

    def endpoint_token(
        self, domain: int, zid: str, number: int, kind: EntityKind, endpoint: Endpoint, qos: Qos
    ) -> str:
        """Return the token of a topic or service of the node; `number` is that in its session."""
        what = f"{mangled(endpoint.name)}/{type_in_key(endpoint.type_name)}/{endpoint.type_hash}"
        return f"{self._token(domain, zid, number, kind)}/{what}/{qos_text(qos)}"

    def _token(self, domain: int, zid: str, number: int, kind: EntityKind) -> str:
        where = f"{GRAPH}/{domain}/{zid}/{self.number}/{number}/{kind.value}"
        return f"{where}/%/{mangled(self.namespace)}/{self.name}"


class TokenParts(NamedTuple):
    """What a token says: topic, type and hash are empty for a node."""

    zid: str
    kind: EntityKind
    node: str
    topic: str = ""
    type_in_key: str = ""
    type_hash: str = ""
    qos: str = ""


def read_token(token: str) -> TokenParts | None:
    """Return the parts of a token; None for what is none. Lyrical may add a last field."""
    parts = token.split("/")
    if parts[0] != GRAPH or len(parts) not in (9, 13, 14):
        return None
    zid, kind, namespace, name = parts[2], parts[5], parts[7], parts[8]
    kinds = [known for known in EntityKind if known.value == kind]
    if not kinds or (kinds[0] is EntityKind.NODE) != (len(parts) == 9):
        return None
    node = f"{namespace.replace('%', '/').rstrip('/')}/{name}"
    if len(parts) == 9:
        return TokenParts(zid, kinds[0], node)
    return TokenParts(zid, kinds[0], node, parts[9].replace("%", "/"), *parts[10:13])


# Attachments.


def gid_of(token: str) -> bytes:
    """Return the id of an entity, which its samples carry: the hash of its token."""
    number = xxhash.xxh3_128_intdigest(token.encode())
    return number.to_bytes(GID_BYTES, "little")


class Attachment(NamedTuple):
    """What each sample, query and reply carries beside its payload."""

    sequence: int
    source_ns: int
    gid: bytes

    def packed(self) -> bytes:
        """Return the 33 bytes."""
        return ATTACHMENT.pack(self.sequence, self.source_ns, GID_BYTES, self.gid)


def read_attachment(data: bytes | None) -> Attachment | None:
    """Return an attachment; None if it is missing or not one."""
    if data is None or len(data) != ATTACHMENT.size:
        return None
    sequence, source_ns, length, gid = ATTACHMENT.unpack(data)
    return Attachment(sequence, source_ns, gid) if length == GID_BYTES else None
