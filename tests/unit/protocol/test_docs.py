"""What is written for people is held to what the code says."""

import re
import xml.etree.ElementTree as xml
from pathlib import Path

import pytest

import sidestep
from plant.world import file as world_file
from protocol import docs
from protocol.topics import Role, Service, Topic
from protocol.wire.message import Message
from protocol.wire.messages import SonarScan
from robot import cli as robot_cli
from robot.core.safety import failsafe
from robot.parameters.table import SPECS
from runtime import config
from runtime.cli.verb_table import VERBS

ROOT = Path(__file__).parents[3]
README = (ROOT / "README.md").read_text()
TOML = re.findall(r"```toml\n(.*?)```", README, re.DOTALL)
SHELL = "\n".join(re.findall(r"```sh\n(.*?)```", README, re.DOTALL))
DIALECT = xml.fromstring(
    """<mavlink><enums><enum name="LAMP"><description>A lamp.</description>
    <entry value="1" name="LAMP_ON"><description>On | lit.</description></entry></enum></enums>
    <messages><message id="7" name="LIGHT"><description>Says.</description>
    <field type="uint8_t" name="lamp" enum="LAMP">Which.</field></message></messages></mavlink>"""
)


def test_the_committed_protocol_page_is_the_generated_one() -> None:
    page = ROOT / "docs" / "reference" / "protocol.md"
    assert page.read_text() == docs.generate(), "run make generate-docs"


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
    lines = docs.page([stream, event], [service], DIALECT).splitlines()
    assert "| `a/b` | SONAR_SCAN | plant | 20 Hz | 250 ms | data | Light. |" in lines
    assert "| `c` | SONAR_SCAN | robot | event, 0 kept | never | data | Now. |" in lines
    assert "| `q` | nothing | robot | Ask. |" in lines
    assert "| `lamp` | uint8 |  | Which. (LAMP) |" in lines
    assert "| 1 | `ON` | On \\| lit. |" in lines


def test_every_verb_in_the_readme_is_there_and_every_verb_there_is_in_the_readme() -> None:
    table = re.search(r"\| verb \|.*?\n\n", README, re.DOTALL)
    assert table
    first_cells = [row.split("|")[1] for row in table[0].splitlines()[2:] if row]
    in_table = {verb.split()[0] for cell in first_cells for verb in re.findall(r"`([^`]+)`", cell)}
    assert in_table == set(VERBS)
    in_shell = set(re.findall(r"^sidestep (\S+)", SHELL, re.MULTILINE))
    assert in_shell <= set(VERBS)


def test_every_make_command_in_the_readme_has_its_target() -> None:
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = set(re.findall(r"(?:`|^)make ([a-z]+)", README, re.MULTILINE))
    assert {"up", "test", "setup"} <= named <= targets


@pytest.mark.parametrize("verb", list(VERBS))
def test_every_verb_explains_itself(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    code: object = None
    try:
        code = sidestep.main([verb, "--help"])
    except SystemExit as left:
        code = left.code or 0
    assert code == 0
    assert "usage:" in capsys.readouterr().out


def test_every_link_of_the_readme_leads_somewhere() -> None:
    links = re.findall(r"\]\(([^)#]+?)\)", README)
    assert links
    missing = [link for link in links if "://" not in link and not (ROOT / link).exists()]
    assert missing == []


def test_every_folder_of_the_readme_s_tree_is_there() -> None:
    tree = re.search(r"## What is where\n\n```\n(.*?)```", README, re.DOTALL)
    assert tree
    top = re.findall(r"^([a-z]\S+) ", tree[1], re.MULTILINE)
    assert [name for name in top if not (ROOT / name).exists()] == []
    packages = {f"{path.parent.name}/" for path in ROOT.glob("*/__init__.py")}
    assert packages <= set(top)


def test_the_world_in_the_readme_is_one_the_plant_accepts(tmp_path: Path) -> None:
    (world,) = [text for text in TOML if "[[obstacle]]" in text]
    file = tmp_path / "door.toml"
    file.write_text(world)
    assert world_file.load(str(file)).name == "door"


def test_the_configuration_in_the_readme_is_one_the_robot_accepts(tmp_path: Path) -> None:
    (text,) = [text for text in TOML if "[network]" in text]
    file = tmp_path / "stack.toml"
    file.write_text(text)
    settings = config.load_shared(file, robot_cli.Settings)
    assert settings.robot == "r1"
    assert settings.network is not None
    assert set(settings.parameters) <= set(SPECS)


def test_the_readme_has_a_row_for_each_failsafe() -> None:
    table = re.search(r"\| what happened \|.*?\n\n", README, re.DOTALL)
    assert table
    rows = table[0].strip().splitlines()[2:]
    the_motor_driver = 2  # stops by itself when the robot is gone, or its loop hangs
    assert len(rows) == len(failsafe.ROWS) + the_motor_driver


def test_the_readme_sums_up_the_outcomes_as_they_were_generated() -> None:
    outcomes = (ROOT / "docs" / "evidence" / "outcomes.md").read_text(encoding="utf-8")
    summary = outcomes.partition("## Summary\n\n")[2].partition("\n\n")[0]
    assert summary.startswith("| navigator |")
    assert summary in README
