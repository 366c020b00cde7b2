"""The PARAM protocol, names that clash with no ArduRover name, and component metadata."""

import json
import lzma
import re
from math import inf, nan
from pathlib import Path
from struct import pack, unpack
from typing import Any

import pytest

from gateways.mavlink.ftp_messages import Opcode, checksum
from gateways.mavlink.mav_service import LINE_SHARE
from gateways.mavlink.mavlink_dialect import ComponentMetadata, MavMessage, mavlink
from gateways.mavlink.parameter_protocol import MAX_PENDING, PASSES, VALUE_BYTES
from gateways.mavlink.parameter_table import (
    MAVLINK_NAMES,
    MAX_NAME_BYTES,
    MavTable,
    compatibility_parameters,
    described,
    mavlink_name,
    table_of,
)
from ground.client.outcomes import Refused
from ground.client.parameters import ParameterChanged
from ground.commands.param import SetParameter
from protocol.wire.enums import LeaseAction
from protocol.wire.reasons import Reason
from robot.parameter_table import SPECS
from robot.parameter_table import TABLE as PARAMETER_TABLE_TABLE
from tests.support.each import each
from tests.support.gateway.benches import (
    ParameterBench,
    SimulatedLink,
    asked,
    client_on,
    got,
    of_type,
    replies,
    robot_table,
)
from tests.support.gateway.fake_port import CLIENT, OTHER, performed, status

LIST = mavlink.MAVLink_param_request_list_message(1, 0)
ALL = len(PARAMETER_TABLE_TABLE) + 37
REAL32 = mavlink.MAV_PARAM_TYPE_REAL32


def read(name: str = "", index: int = -1) -> MavMessage:
    return mavlink.MAVLink_param_request_read_message(0, 0, name.encode(), index)


def change(name: str, value: float, kind: int = REAL32) -> MavMessage:
    return mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, kind)


def values_in(messages: list[MavMessage]) -> list[MavMessage]:
    return of_type(messages, "PARAM_VALUE")


def texts_in(messages: list[MavMessage]) -> str:
    return "".join(one.text for one in of_type(messages, "STATUSTEXT"))


def decoded(message: MavMessage) -> MavMessage:
    """Return what arrives, with the values that the wire carries."""
    encoder = mavlink.MAVLink(None, 1, 1)
    (found,) = encoder.parse_buffer(message.pack(encoder))
    return found


def loaded() -> ParameterBench:
    bench = ParameterBench()
    bench.send(read("RADIUS_M"))
    return bench


def test_value_that_another_operator_has_changed_is_read_within_a_second() -> None:
    bench = loaded()
    for value in (0.5, 0.6, 0.7):
        bench.after(1.0)
        bench.values["d_obs_m"] = value
        (one,) = values_in(bench.send(read("D_OBS_M"), OTHER))
        assert one.param_value == value


def test_values_that_are_asked_for_together_need_one_reading() -> None:
    bench = ParameterBench()
    bench.is_answering = False
    for _ in range(200):
        bench.send(read("D_OBS_M"))
    assert len(performed(bench)) == 1
    bench.is_answering = True
    assert len(values_in(bench.answer_lists())) == 200


def test_whole_list_arrives_within_a_second_with_stable_indexes() -> None:
    bench = ParameterBench()
    first = values_in(bench.send(LIST) + bench.after(0.08))
    bench.after(1.0)
    again = values_in(bench.send(LIST) + bench.after(0.08))
    assert [one.param_index for one in first] == list(range(ALL))
    assert {one.param_count for one in first} == {ALL}
    assert [one.param_id for one in again] == [one.param_id for one in first]
    assert all(len(one.param_id) <= 16 for one in first)


def test_list_is_sent_again_for_clients_that_have_lost_some_of_it() -> None:
    bench = ParameterBench()
    found = values_in(bench.send(LIST) + bench.after(1.0))
    assert [one.param_index for one in found] == PASSES * list(range(ALL))


def test_whole_numbers_are_int32_cast_to_float() -> None:
    bench = ParameterBench()
    found = {one.param_id: decoded(one) for one in values_in(bench.send(LIST) + bench.after(1))}
    assert (found["SIDE"].param_type, found["SIDE"].param_value) == (6, 1.0)
    assert found["STUCK_MS"].param_value == float(int(found["STUCK_MS"].param_value))
    assert found["RADIUS_M"].param_type == REAL32
    assert {one.param_type for one in found.values()} == {6, REAL32}


def test_list_is_paced_by_the_line_of_each_client() -> None:
    bench = ParameterBench()
    bench.face.join(CLIENT.client, 5760)
    bench.face.join(OTHER.client)
    bench.send(LIST, CLIENT)
    bench.send(LIST, OTHER)
    counts = {CLIENT.client: 0, OTHER.client: 0}
    for _ in range(10):
        bench.now_ns += 20_000_000
        bench.due()
        for one in bench.vehicle.outbox.take():
            if one.client is not None:
                counts[one.client] += 1
    assert counts[OTHER.client] > ALL
    assert 5 <= counts[CLIENT.client] <= 5760 * LINE_SHARE * 0.26 / VALUE_BYTES + 2


def test_parameter_is_read_by_name_and_by_index() -> None:
    bench = ParameterBench()
    (by_name,) = values_in(bench.send(read("D_OBS_M")))
    (by_index,) = values_in(bench.send(read("IGNORED", by_name.param_index)))
    assert by_name.to_dict() == by_index.to_dict()
    assert by_name.param_id == "D_OBS_M"


@each("request_", [read("NO_SUCH"), read(index=ALL), read(index=-2), read("")])
def test_unknown_parameter_is_refused(request_: MavMessage) -> None:
    found = loaded().send(request_)
    assert values_in(found) == []
    (error,) = of_type(found, "PARAM_ERROR")
    assert error.error == mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
    assert "no such parameter" in texts_in(found)


def test_value_in_force_is_broadcast_after_a_change() -> None:
    bench = loaded()
    bench.send(change("D_OBS_M", 0.4))
    assert bench.port.leases == [(LeaseAction.TAKE, "MAVLink 255")]
    assert bench.port.performed[-1] == SetParameter(name="d_obs_m", value=0.4)
    bench.port.answer(ParameterChanged(name="d_obs_m", asked=0.4, now=0.35, saved=True))
    sent = bench.vehicle.outbox.take()
    assert sent[0].client is None
    assert sent[0].message.param_value == 0.35
    assert "keeps d_obs_m" in texts_in([one.message for one in sent])
    (again,) = values_in(bench.send(read("D_OBS_M")))
    assert again.param_value == 0.35
    assert bench.vehicle.parameters["d_obs_m"] == 0.35


def test_values_are_sent_once_on_a_lossy_line() -> None:
    """A copy would be taken for the answer to the next request."""
    bench = loaded()
    bench.vehicle.lossy = {CLIENT.client}
    assert len(values_in(bench.send(read("D_OBS_M")))) == 1
    bench.send(change("D_OBS_M", 0.4))
    bench.port.answer(ParameterChanged(name="d_obs_m", asked=0.4, now=0.4, saved=True))
    receivers = [one.client for one in bench.vehicle.outbox.take()]
    assert receivers == [None]


def test_refused_change_is_answered_with_the_value_in_force() -> None:
    bench = loaded()
    bench.send(change("D_OBS_M", 99.0))
    refused = ParameterChanged(name="d_obs_m", asked=99, now=None, refusal="allowed: 0.05 to 3 m")
    bench.port.answer(refused)
    found = bench.sent()
    (value,) = values_in(found)
    assert value.param_value == pytest.approx(0.3)
    assert of_type(found, "PARAM_ERROR")[0].error == mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE
    assert [one.get_type() for one in found] == ["PARAM_ERROR", "PARAM_VALUE", "STATUSTEXT"]
    assert texts_in(found) == "D_OBS_M not changed: allowed: 0.05 to 3 m"


def test_client_without_control_changes_nothing() -> None:
    bench = loaded()
    bench.port.holder = "ada"
    found = bench.send(change("D_OBS_M", 0.4))
    assert values_in(found)[0].param_value == pytest.approx(0.3)
    assert "ada" in texts_in(found)
    assert of_type(found, "PARAM_ERROR")[0].error == mavlink.MAV_PARAM_ERROR_PERMISSION_DENIED


@each(
    "value",
    [nan, inf, -inf, unpack("<f", pack("<i", 2))[0], unpack("<f", pack("<i", -1))[0]],
)
def test_values_that_are_not_cast_are_refused(value: float) -> None:
    bench = loaded()
    found = bench.send(change("NAVIGATOR", value, mavlink.MAV_PARAM_TYPE_INT32))
    assert not any(isinstance(one, SetParameter) for one in bench.port.performed)
    assert values_in(found)[0].param_value == 6
    assert "finite number" in texts_in(found)


def test_zero_is_a_value() -> None:
    bench = loaded()
    bench.send(change("GUARD_STOP_M", 0.0))
    assert bench.port.performed[-1] == SetParameter(name="guard_stop_m", value=0.0)


def test_compatible_parameters_are_read_only() -> None:
    bench = loaded()
    found = bench.send(change("RCMAP_ROLL", 2.0))
    assert values_in(found)[0].param_value == 1
    assert "read-only" in texts_in(found)
    assert not any(isinstance(one, SetParameter) for one in bench.port.performed)


def test_repeated_change_is_carried_out_once() -> None:
    bench = loaded()
    for _ in range(3):
        bench.send(change("D_OBS_M", 0.4))
    assert bench.port.performed.count(SetParameter(name="d_obs_m", value=0.4)) == 1


def test_flood_of_changes_is_bounded() -> None:
    bench = loaded()
    for number in range(10_000):
        bench.receive(change("D_OBS_M", 0.1 + number * 1e-5), CLIENT)
    assert len(bench.port.waiting) == MAX_PENDING
    texts = of_type(bench.sent(), "STATUSTEXT")
    assert 0 < len(texts) < 10


def test_silent_robot_is_named_and_asked_again() -> None:
    bench = ParameterBench()
    bench.is_answering = False
    for _ in range(1000):
        bench.send(LIST)
    assert len(bench.port.waiting) == 1
    bench.port.answer(error="r1 does not answer")
    assert "r1 does not answer" in texts_in(bench.sent())
    bench.is_answering = True
    bench.now_ns += 1_000_000_000
    assert len(values_in(bench.send(LIST) + bench.after(0.08))) == ALL


def test_time_out_of_speeds_is_a_parameter_of_the_gateway() -> None:
    bench = loaded()
    (value,) = values_in(bench.send(read("GUID_TIMEOUT")))
    assert (value.param_value, value.param_type) == (1.0, REAL32)
    sent = bench.send(change("GUID_TIMEOUT", 3.0))
    assert [one.param_value for one in values_in(sent)] == [3.0]
    assert bench.vehicle.guided_timeout_s == 3.0
    bench.after(11.0)
    assert values_in(bench.send(read("GUID_TIMEOUT")))[0].param_value == 3.0
    for wrong in (0.5, 3.5, 10.0):
        sent = bench.send(change("GUID_TIMEOUT", wrong))
        assert [one.param_value for one in values_in(sent)] == [3.0]
        assert "1 to 3 s" in texts_in(sent)
        bench.after(1.1)
    sent = bench.send(change("GUID_TIMEOUT", 1.0), OTHER)
    assert "MAVLink 255" in texts_in(sent), "another client is in control"
    assert bench.vehicle.guided_timeout_s == 3.0
    assert not any(isinstance(one, SetParameter) for one in performed(bench))


def test_change_by_others_is_broadcast() -> None:
    bench = ParameterBench()
    bench.face.join(CLIENT.client)
    bench.send(LIST)
    bench.after(1.0)
    bench.port.telemetry["status"] = status()
    bench.values["d_obs_m"] = 0.45
    (value,) = values_in(bench.after(11.0))
    assert (value.param_id, value.param_value) == ("D_OBS_M", 0.45)


def test_robots_list_is_read_rarely_and_only_for_clients() -> None:
    bench = ParameterBench()
    bench.port.telemetry["status"] = status()
    bench.after(30.0)
    assert bench.port.performed == []
    bench.face.join(CLIENT.client)
    bench.after(30.0)
    assert len(bench.port.performed) == 3


def test_list_for_a_client_that_has_gone_ends() -> None:
    bench = ParameterBench()
    bench.face.join(CLIENT.client, 100)
    bench.send(LIST)
    bench.face.forget(CLIENT.client)
    assert bench.after(1.0) == []


def test_refusal_by_the_lease_is_worded() -> None:
    bench = loaded()
    bench.send(change("D_OBS_M", 0.4))
    bench.port.answer(Refused(Reason.DRIVING, 1))
    assert "not changed" in texts_in(bench.sent())


ARDUROVER_LIST = Path("tests/data/ardurover_parameters.txt")
COMPATIBLE = [one.name for one in compatibility_parameters()]


def ardurover() -> set[str]:
    return set(ARDUROVER_LIST.read_text(encoding="ascii").splitlines()[2:])


def numberless(name: str) -> str:
    return re.sub(r"\d+", "#", name)


def test_names_are_unique_reversible_and_short() -> None:
    assert set(MAVLINK_NAMES) == set(SPECS)
    assert len(set(MAVLINK_NAMES.values())) == len(SPECS)
    assert all(0 < len(name) <= MAX_NAME_BYTES for name in MAVLINK_NAMES.values())
    assert all(name.isascii() and name == name.upper() for name in MAVLINK_NAMES.values())


def test_no_name_is_one_of_ardurover() -> None:
    assert len(ardurover()) > 2000
    assert {numberless(name) for name in MAVLINK_NAMES.values()} & ardurover() == set()
    assert not set(MAVLINK_NAMES.values()) & set(COMPATIBLE)


def test_compatible_parameters_have_names_of_ardurover() -> None:
    assert {numberless(name) for name in COMPATIBLE} <= ardurover()
    assert len(set(COMPATIBLE)) == len(COMPATIBLE) == 4 + 12 + 15 + 3 + 2
    assert "FRAME_CLASS" not in COMPATIBLE


def test_radio_and_accelerometer_count_as_calibrated() -> None:
    values = {one.name: one.value for one in compatibility_parameters()}
    assert any(values[f"RC{channel}_MIN"] != 1100 for channel in (1, 2, 3, 4))
    assert all(values[f"INS_ACCOFFS_{axis}"] != 0 for axis in "XYZ")
    assert [values[f"COMPASS_USE{number}"] for number in ("", "2", "3")] == [0, 0, 0]


def test_compatible_parameters_are_not_in_the_robots_list() -> None:
    names = {mavlink_name(one.name) for one in robot_table().parameters}
    assert not names & set(COMPATIBLE)


def test_name_of_a_newer_robot_is_upper_case_or_hidden() -> None:
    assert mavlink_name("brand_new_m") == "BRAND_NEW_M"
    assert mavlink_name("a_name_longer_than_16") == ""


TABLE = table_of(robot_table().parameters)
KEYS = {
    "name", "type", "shortDesc", "longDesc", "units", "default", "min", "max", "group", "category",
    "values", "readOnly",
}  # fmt: skip
"""Keys of mavlink's parameter.schema.json, which allows no others."""


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
