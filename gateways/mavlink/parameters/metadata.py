"""Component metadata: descriptions of all parameters for ground stations (row 23 of the list).

COMPONENT_METADATA names the general file, which names the file of the parameters. QGroundControl
reads only version 1 of both.
"""

import json
import lzma
from typing import Any, Final, NamedTuple

from gateways.mavlink.dialect import ComponentMetadata, MavMessage
from gateways.mavlink.files.checksum import checksum
from gateways.mavlink.parameters.table import MavParameter, MavTable
from ground.client.vocabulary import NAMED_VALUES

GENERAL_NAME: Final = "general.json.xz"
PARAMETERS_NAME: Final = "parameters.json.xz"
SCHEME: Final = "mftp:///"
VERSION: Final = 1
PARAMETER_KIND: Final = 1
FILTERS: Final = ({"id": lzma.FILTER_LZMA2, "preset": 1, "dict_size": 1 << 16},)
"""A small dictionary keeps the memory of the compression small."""
OWN_GROUP, FIXED_GROUP = "Sidestep", "ArduPilot"


class Metadata(NamedTuple):
    """The two compressed files."""

    general: bytes
    parameters: bytes


def metadata_of(table: MavTable) -> Metadata:
    """Return the files that describe the parameters of a table, whatever their values are."""
    rows = [described(one) for one in table.parameters]
    parameters = _compressed({"version": VERSION, "parameters": rows})
    entry = {
        "type": PARAMETER_KIND,
        "uri": SCHEME + PARAMETERS_NAME,
        "fileCrc": checksum(parameters),
    }
    general = {"version": VERSION, "vendorName": "Sidestep", "metadataTypes": [entry]}
    return Metadata(_compressed(general), parameters)


def component_metadata(metadata: Metadata, time_ms: int) -> MavMessage:
    """Return the message that names the general file."""
    uri = (SCHEME + GENERAL_NAME).encode()
    return ComponentMetadata(time_ms, checksum(metadata.general), uri)


def described(one: MavParameter) -> dict[str, Any]:
    """Return the description of one parameter."""
    own = one.own
    row: dict[str, Any] = {
        "name": one.name,
        "type": "Int32" if own.integer else "Float",
        "shortDesc": own.doc or own.name,
        "longDesc": _long(one),
        "units": own.unit,
        "default": own.default,
        "min": own.minimum,
        "max": own.maximum,
        "group": FIXED_GROUP if one.is_fixed else OWN_GROUP,
        "category": "Safety" if own.direction else "Standard",
        "values": _choices(one),
        "readOnly": True if one.is_fixed else None,
    }
    return {key: value for key, value in row.items() if value not in (None, "", [])}


def _long(one: MavParameter) -> str:
    if one.is_fixed:
        return one.own.doc
    safer = f" Safety group; safer is {one.own.direction}." if one.own.direction else ""
    return f"{one.own.doc} ({one.own.name} in `sidestep param list`).{safer}"


def _choices(one: MavParameter) -> list[dict[str, Any]]:
    """Return the values that have names."""
    named = NAMED_VALUES.get(one.own.name, {})
    return [{"value": int(value), "description": name} for name, value in named.items()]


def _compressed(content: dict[str, Any]) -> bytes:
    text = json.dumps(content, separators=(",", ":")).encode()
    return lzma.compress(text, check=lzma.CHECK_CRC32, filters=[dict(one) for one in FILTERS])
