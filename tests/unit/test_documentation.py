"""Pages and help: they agree with the code, and their commands are run and renewed."""

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from checks.site import reference as protocol_page
from ground import robot as client
from ground.client.emergency_stop import HELD_NS, REPEAT_NS
from ground.client.parameter_rows import NAME, NAME_RULE
from ground.client.teleop_sender import TTL_MS
from ground.commands.stop import StopNow
from ground.map import pen
from ground.missions import files as mission_file
from ground.robot import Robot
from plant.robot_link import MAX_AGE_TICKS
from plant.world import file as world_file
from protocol.topics import DRIVE, OPERATOR, SONAR, STOP, TELEOP, WHEELS, Role, Service, Topic
from protocol.wire.limits import (
    MAX_LEASE_MS,
    MAX_OPERATOR_NAME_BYTES,
    MAX_PARAMETER_NAME_BYTES,
    MAX_TELEOP_TTL_MS,
    MAX_WHEEL_TTL_MS,
    OPERATOR_LOST_MS,
    SCAN_LOST_MS,
    TICKS_LOST_MS,
)
from protocol.wire.message import LAYOUT, Message
from protocol.wire.messages import SonarScan
from protocol.wire.reasons import Reason, reason_text
from robot import run as robot_cli
from robot.core.parameters import DEFAULTS
from robot.core.safety import failsafe
from robot.core.safety.failsafe import ROWS
from robot.lease import IDLE_NS, IDLE_S, LAPSE_NS, LAPSE_S
from robot.parameter_table import SPECS
from robot.process import OVERRUNS_IN_A_ROW
from robot.senses import MAX_EXTRA_NS
from runtime import config
from runtime.cli.packages import PACKAGES
from runtime.cli.verb_table import VERBS, command_of, find
from runtime.units import CONTROL_HZ, NS_PER_MS, NS_PER_S, PERIOD_MS
from runtime.watchdog import HUNG_S
from sidestep.__main__ import main as executable
from study.cli.study_run import parser
from study.intervals import CONFIDENCE, CONFIDENT
from study.report.world_map import ellipse
from study.runner.plan import DETOUR_FACTOR, MIN_TIMEOUT_S, UNREACHABLE_TIMEOUT_S
from tests.support.each import each
from tests.support.pages import ROOT as SESSION_ROOT
from tests.support.pages import Command, File, Stop, matches, renewed, steps, steps_of
from tests.support.refresh import main

PAGE = """\
Text.

```toml title="a.toml"
x = 1
```

<!-- console: exit 1 -->
```console
$ one \\
    two
out
$ three
```

<!-- console: stop -->

<!-- console: run by tests/a.py -->
```console
$ four
```
""".splitlines()


def test_page_is_read_in_order() -> None:
    assert list(steps(PAGE)) == [
        File("a.toml", "x = 1\n"),
        Command(9, "one two", ("out",), "exit 1"),
        Command(12, "three", (), "exit 1"),
        Stop(),
        Command(19, "four", (), "run by tests/a.py"),
    ]


def test_directive_sets_exit_code_and_runner() -> None:
    _, first, *_, last = (step for step in steps(PAGE) if not isinstance(step, Stop))
    assert isinstance(first, Command)
    assert isinstance(last, Command)
    assert (first.exit_code, first.runner) == (1, None)
    assert (last.exit_code, last.runner) == (0, "tests/a.py")


@each(
    ("expected", "printed"),
    [
        (["reached after 1.7 s"], ["reached after 12 s"]),
        (["pose  0.5 -3"], [" pose -0.51   4.0 "]),
        (["a ... b"], ["a x y b"]),
        (["...", "b", "..."], ["a", "b"]),
        (["a", "", "b"], ["a", "b", ""]),
        ([], []),
    ],
)
def test_output_matches(expected: list[str], printed: list[str]) -> None:
    assert matches(expected, printed)


@each(
    ("expected", "printed"),
    [
        (["reached after 1.7 s"], ["reached after - s"]),
        (["reached"], ["reached", "more"]),
        (["a", "b"], ["a"]),
        (["a ... b"], ["a", "b"]),
        ([], ["a"]),
        (["a.b"], ["axb"]),
    ],
)
def test_other_output_does_not_match(expected: list[str], printed: list[str]) -> None:
    assert not matches(expected, printed)


def test_exact_numbers_must_be_equal() -> None:
    assert matches(["5.25 m"], ["5.25 m"], is_exact=True)
    assert not matches(["5.25 m"], ["5.26 m"], is_exact=True)


@each(
    ("expected", "printed", "lines"),
    [
        (["a 1", "b 2"], ["a 7", "c 3"], ["a 1", "c 3"]),
        (["a", "...", "z 1"], ["b", "x", "y", "z 2"], ["b", "...", "z 1"]),
        (["a", "", "z"], ["a", "", "m"], ["a", "", "m"]),
        (["a", "b", "c"], ["a", "c"], ["a", "c"]),
        ([], ["  a", "", "b"], ["  a", "", "b"]),
        (["..."], [], ["..."]),
    ],
)
def test_renewed_output_keeps_the_lines_that_match(
    expected: list[str], printed: list[str], lines: list[str]
) -> None:
    assert renewed(expected, printed) == lines


LINES = st.lists(st.sampled_from(["", "...", "a", "a 1", "a 2.5", "b", "b ... c", "1 try"]))
PRINTED = st.lists(st.sampled_from(["", "a", "  a 2", "a -3.5", "b", "b x c", "2 tries", "1e5."]))


@given(expected=LINES, printed=PRINTED, is_exact=st.booleans())
def test_renewed_output_matches(expected: list[str], printed: list[str], is_exact: bool) -> None:
    lines = renewed(expected, printed, is_exact=is_exact)
    assert matches(lines, printed, is_exact=is_exact)
    if matches(expected, printed, is_exact=is_exact) and any(map(str.strip, expected)):
        assert lines == expected


def test_page_is_read_from_its_file(tmp_path: Path) -> None:
    (tmp_path / "page.md").write_text("\n".join(PAGE))
    assert len(steps_of(tmp_path / "page.md")) == 5


PAGE_TEXT = """\
# A page

```console
$ echo from 7; echo an apple
from 3
a pear
$ printf 'same %s\\n' \\
    1
same 2
```

1. A step:

    ```console
    $ printf 'a\\n  b\\n'; pwd
    old
    ```

<!-- console: run by tests/unit/test_documentation.py -->
```console
$ false
old
```
"""
RENEWED = PAGE_TEXT.replace("from 3\na pear", "from 3\nan apple").replace(
    "    old\n", "    a\n      b\n    ...\n"
)
FAILING = """\
```console
$ echo new
old
$ echo a reason; exit 3
```
"""


@pytest.fixture
def written_page(tmp_path: Path) -> Path:
    path = tmp_path / "page.md"
    path.write_text(PAGE_TEXT)
    return path


def test_only_outputs_that_differ_are_renewed(
    written_page: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main([str(written_page)], root=written_page.parent) == 0
    assert written_page.read_text() == RENEWED
    assert [path.name for path in written_page.parent.iterdir()] == ["page.md"]
    printed = capfd.readouterr().out
    assert "page.md: 2 of 3 outputs renewed; others, not renewed, are run by " in printed
    assert "1 file changed, 4 insertions(+), 2 deletions(-)" in printed
    assert "\n-a pear\n+an apple\n" in printed
    assert main([str(written_page)], root=written_page.parent) == 0
    assert written_page.read_text() == RENEWED
    printed = capfd.readouterr().out
    assert printed.startswith("page.md: 0 of 3 outputs renewed")
    assert printed.endswith("nothing has changed\n")


def test_page_with_a_failing_command_is_left_alone(
    written_page: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    failing = written_page.with_name("failing.md")
    failing.write_text(FAILING)
    assert main([str(written_page.parent)], root=written_page.parent) == 1
    assert failing.read_text() == FAILING
    assert written_page.read_text() == RENEWED
    printed = capfd.readouterr()
    words = "line 4: $ echo a reason; exit 3\na reason\nexit code 3, not 0\n"
    assert f"failing.md: FAILED\n{words}" in printed.out
    assert "FAILED: failing.md" in printed.err


def test_output_that_would_be_a_command_is_not_written(
    written_page: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    text = "```console\n$ echo '$ rm file'\n```\n"
    written_page.write_text(text)
    assert main([str(written_page)], root=written_page.parent) == 1
    assert written_page.read_text() == text
    assert "begins with `$ `" in capfd.readouterr().out


def test_part_that_is_no_page_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([str(tmp_path)], root=tmp_path)
    assert "no page with commands" in capsys.readouterr().err


ROOT = Path(__file__).parents[2]
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
    targets = set(re.findall(r"^([a-z0-9-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    text = "\n".join(PAGES.values())
    named = set(re.findall(r"(?:`|^|\$ )make ([a-z0-9-]+)", text, re.MULTILINE))
    assert {"up", "test", "setup"} <= named <= targets


@each("verb", list(VERBS))
def test_every_verb_explains_itself(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    code: object = None
    try:
        code = executable([*command_of(verb).split(), "--help"])
    except SystemExit as left:
        code = left.code or 0
    assert code == 0
    assert "usage:" in capsys.readouterr().out


@each("page", PAGES)
def test_every_link_has_a_target(page: str) -> None:
    """Cover the pages read as files; the site checks its own links."""
    text = re.sub(r"```.*?```", "", PAGES[page], flags=re.DOTALL)
    links = [link for link in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", text) if "://" not in link]
    made = ("pictures/findings/",)  # by the site
    missing = [
        link
        for link in links
        if not any(folder in link for folder in made)
        and not (ROOT / page).parent.joinpath(link).exists()
    ]
    assert missing == []


ROOMS = {path.parent.name for path in ROOT.glob("*/__init__.py")}


def rooms_imported_by(room: str) -> set[str]:
    """Return the other rooms that the modules of a room name in their imports."""
    text = "\n".join(path.read_text() for path in (ROOT / room).rglob("*.py"))
    found = re.findall(r"^ *(?:from|import) (\w+)[. ]", text, re.MULTILINE)
    return set(found) & ROOMS - {room}


def test_every_room_has_a_row_with_what_it_imports() -> None:
    page = PAGES["docs/concepts/where-things-live.md"]
    rows = dict(re.findall(r"^\| `(\w+)/` \| .* \|(.*)\|$", page, re.MULTILINE))
    assert rows.keys() == ROOMS
    free = {room for room, imports in rows.items() if imports.strip() == "any room"}
    assert free == {"checks", "tests", "examples"}
    named = {room: set(re.findall(r"`(\w+)`", rows[room])) for room in ROOMS - free}
    assert named == {room: rooms_imported_by(room) for room in named}


def test_pages_name_only_files_that_exist() -> None:
    made = {"runtime/compiled.json"}
    rooms = "|".join(ROOMS - {"sidestep"})  # the keys of the bus begin with it
    path = re.compile(rf"`((?:{rooms}|docs|docker)/[\w/.-]*)`")
    missing = {
        f"{page}: {name}"
        for page, text in PAGES.items()
        for name in path.findall(text)
        if page != "CHANGELOG.md" and name not in made and not (ROOT / name).exists()
    }
    assert missing == set()


def test_installation_names_what_the_wheel_brings() -> None:
    page = PAGES["docs/tutorial/index.md"]
    listed = re.search(r"top-level names (.*?), so", page, re.DOTALL)
    assert listed
    assert set(re.findall(r"`(\w+)`", listed[1])) == set(PACKAGES)


def test_the_plant_accepts_the_world_of_the_reference(tmp_path: Path) -> None:
    world = toml_of("docs/reference/world-files.md")
    file = tmp_path / "door.toml"
    file.write_text(world)
    assert world_file.load(str(file)).name == "door"


def test_the_robot_accepts_the_configuration_of_the_reference(tmp_path: Path) -> None:
    text = toml_of("docs/reference/configuration.md")
    file = tmp_path / "stack.toml"
    file.write_text(text)
    settings = config.load_shared(file, robot_cli.RobotSettings)
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


S = 1000
IN_WORDS = ("zero", "one", "two", "three", "four", "five", "six")


def page(name: str) -> str:
    """Return a page of the documentation as one line."""
    return " ".join((ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8").split())


@each(
    ("reason", "words"),
    [
        (Reason.TICKS_LOST, f"for {TICKS_LOST_MS} ms"),
        (Reason.SCAN_LOST, f"for {SCAN_LOST_MS} ms"),
    ],
)
def test_the_text_of_a_failsafe_shows_its_limit(reason: Reason, words: str) -> None:
    assert reason_text(reason).endswith(words)


@each(
    ("topic", "limit_ms"),
    [
        (WHEELS, TICKS_LOST_MS),
        (SONAR, SCAN_LOST_MS),
        (OPERATOR, OPERATOR_LOST_MS),
        (DRIVE, MAX_WHEEL_TTL_MS),
        (TELEOP, MAX_TELEOP_TTL_MS),
    ],
)
def test_a_topic_is_stale_when_its_limit_is_over(topic: Topic[Message], limit_ms: int) -> None:
    assert topic.stale_after_ns == limit_ms * NS_PER_MS


def test_the_sizes_of_names_are_those_of_the_wire() -> None:
    sizes = {field.name: field.length for field in LAYOUT["LeaseRequest"].fields}
    assert sizes["name"] == MAX_OPERATOR_NAME_BYTES
    sizes = {field.name: field.length for field in LAYOUT["ParamSet"].fields}
    assert sizes["param_id"] == MAX_PARAMETER_NAME_BYTES
    assert NAME.match("p" * MAX_PARAMETER_NAME_BYTES)
    assert not NAME.match("p" * (MAX_PARAMETER_NAME_BYTES + 1))
    assert str(MAX_PARAMETER_NAME_BYTES) in NAME_RULE


def test_the_core_and_the_lease_use_the_limits_of_the_wire() -> None:
    assert DEFAULTS.op_lost_ms == OPERATOR_LOST_MS
    assert LAPSE_NS < IDLE_NS == MAX_LEASE_MS * NS_PER_MS
    assert DEFAULTS.period_s * S == PERIOD_MS


@each(
    ("name", "words"),
    [
        ("concepts/architecture", f"wheel speeds, valid for {MAX_WHEEL_TTL_MS} ms"),
        ("concepts/architecture", f'"control loop, {CONTROL_HZ:g} Hz"'),
        ("concepts/architecture", f"accepts the command for {MAX_WHEEL_TTL_MS} ms"),
        ("concepts/clocks", f"on a fixed grid of {PERIOD_MS} ms"),
        ("concepts/safety", f"| no fresh wheel ticks | {TICKS_LOST_MS} ms |"),
        ("concepts/safety", f"| no fresh sonar scan | {SCAN_LOST_MS} ms |"),
        ("concepts/safety", f"lost in GUIDED or MANUAL | {OPERATOR_LOST_MS / S:g} s after"),
        ("concepts/safety", f"| its loop hangs | {MAX_WHEEL_TTL_MS} ms |"),
        ("concepts/safety", f"after {HUNG_S:g} s it ends itself"),
        ("concepts/safety", f"over a period late | {OVERRUNS_IN_A_ROW} in a row; one |"),
        ("concepts/safety", f"a tenth of it for {DEFAULTS.wheel_time_ms / S:g} s, checked"),
        ("concepts/safety", f"| the robot itself is gone | {MAX_WHEEL_TTL_MS} ms |"),
        ("concepts/safety", f"repeat it every {REPEAT_NS // NS_PER_MS} ms"),
        ("concepts/safety", f"without this id for {IN_WORDS[HELD_NS // NS_PER_S]} second"),
        ("concepts/safety", f"more than {MAX_EXTRA_NS // NS_PER_MS} ms later than usual"),
        ("concepts/safety", f"a time-to-live of at most {MAX_TELEOP_TTL_MS / S:g} s"),
        ("concepts/safety", f"all its programs were silent for {LAPSE_S:g} s"),
        ("concepts/safety", f"after {IDLE_S:g} s in which the person has neither driven"),
        ("concepts/safety", f"one of the last {IN_WORDS[MAX_AGE_TICKS + 1]} ticks"),
        ("concepts/safety", f"ends it {MAX_WHEEL_TTL_MS} ms after that tick"),
        ("how-to/missions", f"{LAPSE_S:g} s after the last sign of life"),
        ("how-to/real-robot", f"time-to-live, {MAX_WHEEL_TTL_MS} ms at most"),
        ("how-to/real-robot", f"one of the last {IN_WORDS[MAX_AGE_TICKS + 1]} ticks"),
    ],
)
def test_pages_show_the_limits(name: str, words: str) -> None:
    assert words in page(name)


@each(
    ("documented", "words"),
    [
        (client, f"by itself after its `op_lost_ms`, by default {OPERATOR_LOST_MS / S:g} s"),
        (Robot.drive, f"Each speed expires after {TTL_MS} ms"),
        (Robot.emergency_stop, f"repeat every {REPEAT_NS // NS_PER_MS} ms until"),
        (StopNow, f"repeat every {REPEAT_NS // NS_PER_MS} ms until"),
    ],
)
def test_documented_operations_show_the_limits(documented: object, words: str) -> None:
    assert words in " ".join((documented.__doc__ or "").split())


def test_the_failsafe_of_the_budget_shows_its_overruns() -> None:
    (row,) = (row for row in ROWS if row.reason == Reason.BUDGET)
    assert row.limit.startswith(f"{OVERRUNS_IN_A_ROW} overruns in a row")


def test_the_table_of_topics_shows_how_often_a_stop_is_repeated() -> None:
    assert re.search(rf"\b{REPEAT_NS // NS_PER_MS} ms\b", STOP.doc)


def test_texts_about_confidence_take_it_from_its_constant() -> None:
    """Require the constant: a literal number would stay when it changes."""
    literal = re.compile(r"\d %\)? (intervals?|ellipse|inside|bounds)|(intervals? of|\() ?\d+ %")
    files = [*(ROOT / "study").rglob("*.py"), *(ROOT / "ground").rglob("*.py")]
    found = [f.name for f in files if literal.search(f.read_text(encoding="utf-8"))]
    assert found == []


def test_the_confidence_of_both_ellipses_is_the_same() -> None:
    """Draw in the ground station the ellipse that the study evaluates."""
    covariance = 0.04, 0.01, 0.02
    assert pen.ellipse(covariance) == pytest.approx(ellipse(covariance))
    assert f"{100 * CONFIDENCE:g} %" == CONFIDENT


def test_helps_show_the_defaults_in_force() -> None:
    study_help = " ".join(parser().format_help().split())
    for words in (
        f"{DETOUR_FACTOR:g} times",
        f"at least {MIN_TIMEOUT_S:g} s",
        f"{UNREACHABLE_TIMEOUT_S:g} s where",
    ):
        assert words in study_help


DOCS_FOLDER = SESSION_ROOT / "docs"
CONSOLE_PAGES = sorted(
    [*(DOCS_FOLDER / "tutorial").glob("*.md"), *(DOCS_FOLDER / "how-to").glob("*.md")]
)
COMMANDS = {
    page: [step for step in steps_of(page) if isinstance(step, Command)] for page in CONSOLE_PAGES
}


@each("page", CONSOLE_PAGES)
def test_commands_that_another_file_runs_name_that_file(page: Path) -> None:
    named = {command.runner for command in COMMANDS[page] if command.runner is not None}
    assert [name for name in named if not (SESSION_ROOT / name).is_file()] == []


@each("page", CONSOLE_PAGES)
def test_blocks_with_commands_are_of_the_language_console(page: Path) -> None:
    """Reject blocks of other languages: they would not be run."""
    fences = [
        line.strip() for line in page.read_text(encoding="utf-8").splitlines() if "```" in line
    ]
    assert {"```sh", "```shell", "```bash", "```"}.isdisjoint(fences[::2])
