"""Row 23: component metadata."""

import json
import lzma
from typing import Any

import pytest

from gateways.mavlink.ftp_messages import Opcode, checksum
from gateways.mavlink.mavlink_dialect import ComponentMetadata
from gateways.mavlink.parameter_table import MavTable, described, table_of
from robot.parameter_table import SPECS
from tests.support.each import each
from tests.support.gateway.fake_port import CLIENT
from tests.support.gateway.file_client import SimulatedLink, asked, client_on, replies
from tests.support.gateway.parameter_bench import ParameterBench, robot_table

TABLE = table_of(robot_table().parameters)
KEYS = {
    "name", "type", "shortDesc", "longDesc", "units", "default", "min", "max", "group", "category",
    "values", "readOnly",
}  # fmt: skip
"""Keys of mavlink's parameter.schema.json, which allows no others."""


def got(client: Any, path: str) -> bytes:
    contents: list[bytes] = []
    client.cmd_get([path], callback=lambda file: contents.append(file.read()))
    client.process_ftp_reply("OpenFileRO", timeout=60)
    return contents[0]


def row(name: str, table: MavTable = TABLE) -> dict[str, Any]:
    index = table.index(name)
    assert index is not None
    return described(table.parameters[index])


def test_client_follows_the_message_to_all_descriptions(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = ParameterBench()
    bench.face.join(CLIENT.client)
    client = client_on(SimulatedLink(bench), monkeypatch, 239)
    assert bench.vehicle.catalogue.build(ComponentMetadata.id, bench.now_ns) == []
    packed = got(client, "/general.json.xz")
    bench.after(0.02)
    (message,) = bench.vehicle.catalogue.build(ComponentMetadata.id, bench.now_ns)
    assert message.uri == b"mftp:///general.json.xz"
    assert message.file_crc == checksum(packed)
    general = json.loads(lzma.decompress(packed))
    assert general["version"] == 1
    (kind,) = general["metadataTypes"]
    assert (kind["type"], kind["uri"]) == (1, "mftp:///parameters.json.xz")
    packed = got(client, kind["uri"].removeprefix("mftp://"))
    assert kind["fileCrc"] == checksum(packed)
    parameters = json.loads(lzma.decompress(packed))
    assert parameters["version"] == 1
    names = {one["name"] for one in parameters["parameters"]}
    assert names == {one.name for one in TABLE.parameters}
    assert all(set(one) <= KEYS for one in parameters["parameters"])


def test_checksum_by_ftp_is_that_of_the_message() -> None:
    bench = ParameterBench()
    (reply,) = replies(bench, asked(Opcode.CHECKSUM, b"general.json.xz"))
    (message,) = bench.vehicle.catalogue.build(ComponentMetadata.id, bench.now_ns)
    assert int.from_bytes(reply.data, "little") == message.file_crc


@each("name", sorted(SPECS))
def test_description_is_that_of_the_robots_table(name: str) -> None:
    spec, found = SPECS[name], row(name.upper())
    assert found["shortDesc"] == spec.doc
    assert found["default"] == pytest.approx(spec.default)
    assert (found["min"], found["max"]) == (spec.minimum, spec.maximum)
    assert found.get("units", "") == spec.unit
    assert found["type"] == ("Int32" if spec.integer else "Float")
    assert name in found["longDesc"]


def test_named_values_and_groups() -> None:
    assert {"value": -1, "description": "right"} in row("SIDE")["values"]
    assert row("RADIUS_M")["category"] == "Safety"
    assert row("D_OBS_M")["category"] == "Standard"
    assert row("RCMAP_ROLL")["readOnly"] is True
    assert "readOnly" not in row("SIDE")


def test_files_stay_the_same_when_values_change() -> None:
    bench = ParameterBench()
    (first,) = replies(bench, asked(Opcode.CHECKSUM, b"parameters.json.xz"))
    bench.values["d_obs_m"] = 0.7
    bench.after(2.0)
    replies(bench, asked(Opcode.OPEN, b"@PARAM/param.pck"))
    (second,) = replies(bench, asked(Opcode.CHECKSUM, b"parameters.json.xz"))
    assert first.data == second.data
