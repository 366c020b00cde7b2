"""Writes the generated modules of the dialect from sidestep.xml and pymavlink's own common.xml.

`python -m protocol.dialect.generate` is deterministic: the same pymavlink gives the same bytes. Of
common.xml only the messages named here are read, at generation time; no text of it is kept.
"""

import contextlib
import importlib.util
import os
import sys
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import Final

HERE: Final = Path(__file__).parent
COMMON_MESSAGES: Final = (
    "HEARTBEAT",
    "SYSTEM_TIME",
    "PARAM_REQUEST_READ",
    "PARAM_REQUEST_LIST",
    "PARAM_VALUE",
    "PARAM_SET",
    "MISSION_SET_CURRENT",
    "MISSION_CURRENT",
    "MISSION_REQUEST_LIST",
    "MISSION_COUNT",
    "MISSION_CLEAR_ALL",
    "MISSION_ITEM_REACHED",
    "MISSION_ACK",
    "MISSION_REQUEST_INT",
    "MANUAL_CONTROL",
    "MISSION_ITEM_INT",
    "COMMAND_INT",
    "COMMAND_LONG",
    "COMMAND_ACK",
    "TIMESYNC",
    "STATUSTEXT",
)
COMMON_COMMANDS: Final = (
    "MAV_CMD_NAV_WAYPOINT",
    "MAV_CMD_NAV_RETURN_TO_LAUNCH",
    "MAV_CMD_DO_SET_MODE",
    "MAV_CMD_DO_FLIGHTTERMINATION",
    "MAV_CMD_DO_REPOSITION",
    "MAV_CMD_DO_PAUSE_CONTINUE",
    "MAV_CMD_DO_SET_MISSION_CURRENT",
    "MAV_CMD_MISSION_START",
    "MAV_CMD_COMPONENT_ARM_DISARM",
    "MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION",
    "MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION",
)


def upstream_definitions() -> list[Path]:
    """The installed common.xml and what it includes, innermost last."""
    package = importlib.util.find_spec("pymavlink")
    assert package is not None
    assert package.submodule_search_locations is not None
    folder = Path(next(iter(package.submodule_search_locations))) / "dialects" / "v20"
    return [folder / name for name in ("common.xml", "standard.xml", "minimal.xml")]


def enums_of(messages: Iterable[ET.Element]) -> set[str]:
    return {field.get("enum", "") for message in messages for field in message.iter("field")}


def copied(element: ET.Element, keep: set[str]) -> ET.Element:
    """A copy of an enum or message; of MAV_CMD only the commands in use."""
    if element.get("name") != "MAV_CMD":
        return element
    command = ET.Element("enum", element.attrib)
    command.extend(e for e in element.iter("entry") if e.get("name") in keep)
    return command


def subset() -> ET.Element:
    """The part of common.xml in use, ids and layouts untouched."""
    roots = [ET.parse(path).getroot() for path in upstream_definitions()]
    messages = [m for root in roots for m in root.iter("message")]
    messages = [m for m in messages if m.get("name") in COMMON_MESSAGES]
    wanted = enums_of(messages)
    mavlink = ET.Element("mavlink")
    ET.SubElement(mavlink, "version").text = "3"
    enums = ET.SubElement(mavlink, "enums")
    for root in roots:
        found = (enum for enum in root.iter("enum") if enum.get("name") in wanted)
        enums.extend(copied(enum, set(COMMON_COMMANDS)) for enum in found)
    ET.SubElement(mavlink, "messages").extend(messages)
    return mavlink


def run_mavgen(definition: Path, output: Path) -> None:
    from pymavlink.generator import mavgen, mavparse

    options = mavgen.Opts(
        str(output), wire_protocol=mavparse.PROTOCOL_2_0, language="Python3", validate=True
    )
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
        mavgen.mavgen(options, [str(definition)])


def generated_text() -> str:
    """What generated.py has to be."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        tree = ET.ElementTree(subset())
        tree.write(folder / "common.xml", encoding="utf-8", xml_declaration=True)
        definition = folder / "sidestep.xml"
        definition.write_bytes((HERE / "sidestep.xml").read_bytes())
        output = folder / "generated.py"
        run_mavgen(definition, output)
        return output.read_text(encoding="utf-8")


def loaded(text: str) -> ModuleType:
    """The generated module, without the detour over a file."""
    module = ModuleType("generated")
    # mavgen asks for its own module by name when it looks up message classes
    sys.modules[module.__name__] = module
    try:
        exec(compile(text, "generated.py", "exec"), module.__dict__)
    finally:
        del sys.modules[module.__name__]
    return module


def main() -> None:
    from protocol.dialect.layout_text import layout_text

    text = generated_text()
    (HERE / "generated.py").write_text(text, encoding="utf-8")
    (HERE / "layouts.py").write_text(layout_text(loaded(text)), encoding="utf-8")


if __name__ == "__main__":
    main()
