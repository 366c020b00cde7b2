"""Pages, README and help agree with the code."""

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

import sidestep
from checks.site import protocol_page
from ground.missions import files as mission_file
from plant.world import file as world_file
from protocol.topics import Role, Service, Topic
from protocol.wire.message import Message
from protocol.wire.messages import SonarScan
from robot import run as robot_cli
from robot.core.safety import failsafe
from robot.parameter_table import SPECS
from runtime import config
from runtime.cli.verb_table import VERBS, command_of, find
from tests.support.each import each

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs"
PAGES = {path.relative_to(ROOT).as_posix(): path.read_text() for path in DOCS.rglob("*.md")}
PAGES |= {path.name: path.read_text() for path in ROOT.glob("*.md")}
DIALECT = ElementTree.fromstring(
    """<mavlink><enums><enum name="LAMP"><description>A lamp.</description>
    <entry value="1" name="LAMP_ON"><description>On | lit.</description></entry></enum></enums>
    <messages><message id="7" name="LIGHT"><description>Says.</description>
    <field type="uint8_t" name="lamp" enum="LAMP">Which.</field></message></messages></mavlink>"""
)


def test_the_committed_protocol_page_is_the_generated_one() -> None:
    page = ROOT / "docs" / "reference" / "protocol.md"
    assert page.read_text() == protocol_page.generate(), "run make generate-docs"


def test_a_page_holds_each_stream_question_message_and_name() -> None:
    stream: Topic[Message] = Topic(
        path="a/b",
        messages=(SonarScan,),
        publisher=Role.PLANT,
        rate_hz=20.0,
        stale_after_ns=250_000_000,
        doc="Light.",
    )
    event: Topic[Message] = Topic(
        path="c",
        messages=(SonarScan,),
        publisher=Role.ROBOT,
        rate_hz=0,
        stale_after_ns=0,
        doc="Now.",
    )
    service = Service(path="q", requests=(), server=Role.ROBOT, doc="Ask.")
    lines = protocol_page.page([stream, event], [service], DIALECT).splitlines()
    assert "| `a/b` | SONAR_SCAN | plant | 20 Hz | 250 ms | data | Light. |" in lines
    assert "| `c` | SONAR_SCAN | robot | event, 0 kept | never | data | Now. |" in lines
    assert "| `q` | nothing | robot | Ask. |" in lines
    assert "| `lamp` | uint8 |  | Which. (LAMP) |" in lines
    assert "| 1 | `ON` | On \\| lit. |" in lines


def toml_of(page: str) -> str:
    """Return the first TOML block of a page."""
    found = re.search(r"```toml\n(.*?)```", PAGES[page], re.DOTALL)
    assert found
    return found[1]


def test_every_verb_used_in_a_command_exists() -> None:
    pages = [text for name, text in PAGES.items() if "evidence/" not in name]
    lines = re.findall(r"^(?:\$ )?sidestep ([a-z][a-z-]*(?: .*)?)$", "\n".join(pages), re.MULTILINE)
    calls = {line: find(line.split()) for line in lines}
    assert [line for line, call in calls.items() if call is None or call.is_old] == []
    assert {"up", "goto", "trial", "plot"} <= {call.word for call in calls.values() if call}


def test_every_make_command_has_its_target() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    text = "\n".join(PAGES.values())
    named = set(re.findall(r"(?:`|^|\$ )make ([a-z-]+)", text, re.MULTILINE))
    assert {"up", "test", "setup"} <= named <= targets


@each("verb", list(VERBS))
def test_every_verb_explains_itself(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    code: object = None
    try:
        code = sidestep.main([*command_of(verb).split(), "--help"])
    except SystemExit as left:
        code = left.code or 0
    assert code == 0
    assert "usage:" in capsys.readouterr().out


@each("page", PAGES)
def test_every_link_has_a_target(page: str) -> None:
    """Cover the pages read as files; the site checks its own links."""
    text = re.sub(r"```.*?```", "", PAGES[page], flags=re.DOTALL)
    links = [link for link in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", text) if "://" not in link]
    made = ("pictures/screens/", "pictures/findings/")  # by the site
    missing = [
        link
        for link in links
        if not any(folder in link for folder in made)
        and not (ROOT / page).parent.joinpath(link).exists()
    ]
    assert missing == []


def test_every_folder_is_in_the_architecture() -> None:
    page = PAGES["docs/concepts/architecture.md"]
    named = set(re.findall(r"^\| `([a-z/.]+)` \|", page, re.MULTILINE))
    assert [name for name in named if not (ROOT / name).exists()] == []
    assert {f"{path.parent.name}/" for path in ROOT.glob("*/__init__.py")} <= named


def test_the_plant_accepts_the_world_of_the_reference(tmp_path: Path) -> None:
    world = toml_of("docs/reference/world-files.md")
    file = tmp_path / "door.toml"
    file.write_text(world)
    assert world_file.load(str(file)).name == "door"


def test_the_robot_accepts_the_configuration_of_the_reference(tmp_path: Path) -> None:
    text = toml_of("docs/reference/configuration.md")
    file = tmp_path / "stack.toml"
    file.write_text(text)
    settings = config.load_shared(file, robot_cli.Settings)
    assert settings.robot == "r1"
    assert settings.network is not None
    assert set(settings.parameters) <= set(SPECS)


def test_mission_of_the_reference_is_valid() -> None:
    assert (
        len(mission_file.read_toml(toml_of("docs/reference/mission-files.md"), "").waypoints) == 2
    )


def test_the_page_on_safety_has_a_row_for_each_failsafe() -> None:
    page = PAGES["docs/concepts/safety.md"]
    table = re.search(r"\| what happened \|.*?\n\n", page, re.DOTALL)
    assert table
    rows = table[0].strip().splitlines()[2:]
    the_motor_driver = 2  # stops by itself when the robot is gone, or its loop hangs
    assert len(rows) == len(failsafe.ROWS) + the_motor_driver
