"""`python -m checks.evidence`: the age of each page of evidence, and its measurement.

`EVIDENCE` is the table of all pages in docs/evidence and of the data beside them. A measured page
names its commit in a line between two marks. It is stale when more than `LIMIT` commits that touch
its sources follow that commit. Without options this prints one line for each page, with `--mark` it
writes or removes the word "Stale" on the pages and renews the table of docs/evidence/index.md, with
`--brief` it prints what `make gate` shows. These always exit with 0.

`make evidence` measures all pages again (`--measure`), `--list` prints the commands with their
expected minutes, and `--measured` names the present commit on a page that was measured by hand.
"""

import argparse
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from enum import Enum
from pathlib import Path
from shutil import copy2, copytree, rmtree
from typing import Final, NamedTuple

import msgspec

from checks.harness import figures
from runtime.errors import EXIT_INTERRUPTED, EXIT_USAGE
from study.report.page import with_text

ROOT: Final = Path(__file__).resolve().parents[1]
FOLDER: Final = "docs/evidence"
STATE: Final = "build/evidence/state.json"
LIMIT: Final = 300
WRITTEN: Final = ("docs", "README.md")
"""Paths that a measurement may write. What is uncommitted there changes no figure."""

BEGIN: Final = "<!-- begin: python -m checks.evidence -->\n"
END: Final = "<!-- end: python -m checks.evidence -->\n"
LINE: Final = re.compile(
    r"^(?P<how>Measured|Figures added) on (?P<date>\d{4}-\d\d-\d\d) (?:at|by) commit "
    r"`(?P<commit>[0-9a-f]{7,40})`(?P<rest>[,;].*)?\.$",
    re.MULTILINE,
)
STALE: Final = re.compile(r"^\*\*Stale:\*\* more than ([\d,]+) commits .*$", re.MULTILINE)
HEADING: Final = re.compile(r"^# .*\n", re.MULTILINE)
PROMPT: Final = re.compile(r"^\$ ((?:.*\\\n)*.*)$", re.MULTILINE)


class MeasuringStep(NamedTuple):
    """A command of a measurement; `{work}` in its words is a folder that only this one uses.

    `may_miss`: exit code 1 means a missed threshold if the command has written its page.
    """

    words: tuple[str, ...]
    is_compiled: bool = False
    may_miss: bool = False
    in_work: bool = False


def step(line: str, **more: bool) -> MeasuringStep:
    """Return the step of a command line."""
    return MeasuringStep(tuple(line.split()), **more)


class EvidencePage(NamedTuple):
    """A page, the paths whose commits make it old, and how it is measured again.

    A page has either `steps`; or `with_page`, the page whose measurement writes this one, too; or
    `test`, which compares it with the code or data that it is made from; or a person measures it.
    """

    name: str
    title: str
    content: str
    again: str
    sources: tuple[str, ...] = ()
    minutes: float = 0.0
    steps: tuple[MeasuringStep, ...] = ()
    console: tuple[str, str] | None = None
    """A page and its heading, whose commands are the steps."""
    data: tuple[str, ...] = ()
    with_page: str = ""
    test: str = ""
    file: str = ""

    @property
    def path(self) -> str:
        """The path of the page in the repository."""
        return self.file or f"{FOLDER}/{self.name}.md"

    @property
    def is_automatic(self) -> bool:
        """Whether `make evidence` can measure it."""
        return bool(self.steps or self.console)

    def advice(self) -> str:
        """Return what measures the page again."""
        if self.is_automatic or self.with_page:
            return f"`make evidence ARGS={self.with_page or self.name}` measures it again"
        return f"it is measured by hand: {self.again}"


DRIVES: Final = ("runtime", "robot/core", "robot/hosting.py", "plant", "study")
STACK: Final = ("runtime", "protocol", "robot", "plant", "ground")
FORMER: Final = (
    ("checks", "verification"),
    ("checks/endurance", "verification/soak"),
    ("checks/faults", "verification/faults_matrix"),
    ("checks/speed", "benchmarks"),
    ("firmware", "robot/mcu"),
    ("robot/hosting.py", "robot/hosting"),
    ("gateways/mavlink", "ground/gateway"),
    ("vehicle_check", "ground/vehicle_check"),
)
"""Paths of now and of before they moved: what happened to a folder before its move counts, too."""

RATIOS: Final = ("trial", "against", "codec", "latency", "map")
"""Benchmarks that `make speed` measures, with their sections on the page of figures."""
FIGURES: Final = ("trial", "core", "against", "codec", "latency", "jitter", "map", "digest")
LONG_FIGURES: Final = (
    *("robot", "mtls", "nees", "arrival", "soak", "ground", "fleet", "stop_all", "restarts"),
    *("fuzz", "flood", "stop_ways", "simulate", "contradictions"),
)
TICK: Final = ("lockstep", "breakdown")
GATEWAY: Final = ("gateway",)
"""Benchmarks of four pages. `compiled` and `faults` write pages of their own."""


def benched(page: str, names: Sequence[str]) -> tuple[MeasuringStep, ...]:
    """Return one step for each benchmark, so that an interrupted page loses only one."""
    output = ("--output", f"{FOLDER}/{page}.md")
    return tuple(
        MeasuringStep(("python", "-m", "checks.site.figures_page", name, *output)) for name in names
    )


EVIDENCE: Final = (
    EvidencePage(
        "outcomes",
        "Outcomes",
        "each navigator in each shipped world",
        "`python -m checks.site.outcomes_table`",
        (*DRIVES, "checks/site/outcomes_table.py"),
        6,
        (step("python -m checks.site.outcomes_table"),),
    ),
    EvidencePage(
        "lockstep",
        "A tick in lockstep",
        "where the time of a tick over the bus goes",
        "`sidestep bench breakdown`, `sidestep bench lockstep`",
        (*STACK, "checks/speed/lockstep.py"),
        3,
        benched("lockstep", TICK),
    ),
    EvidencePage(
        "compiled",
        "Compiled modules",
        "trials compiled, in pure Python and of ir-sim, stage by stage",
        "`sidestep bench compiled --page FILE`",
        (*DRIVES, "hatch_build.py", "checks/speed/trials.py", "checks/speed/irsim_driver.py"),
        8,
        (step(f"python -m checks compiled --page {FOLDER}/compiled.md", may_miss=True),),
    ),
    EvidencePage(
        "figures",
        "Figures",
        "speed and cost of the programs, ratios with a history",
        "`make speed`, `python -m checks.site.figures_page`",
        (*STACK, "study/trial", "checks/speed"),
        16,
        (
            step("python -m checks.site.speed --record --sections"),
            *benched("figures", [name for name in FIGURES if name not in RATIOS]),
        ),
        data=(f"{FOLDER}/speed.json", f"{FOLDER}/speed.svg"),
    ),
    EvidencePage(
        "published-maps",
        "Published maps",
        "`vgm_memory` in the maps of two other benchmarks",
        "`python -m checks.site.published_maps`",
        (*DRIVES, "checks/site/published_maps.py"),
        15,
        (
            step("make compiled"),
            *(
                step(f"git clone --depth 1 https://github.com/{name}", in_work=True)
                for name in ("Daffan/nav-competition-icra2022", "Kei18/pibt2")
            ),
            step(
                "python -P -m checks.site.published_maps --moving-ai {work}/pibt2/map"
                " --barn {work}/nav-competition-icra2022/jackal_helper/worlds/BARN"
                f" --output {FOLDER}/published-maps.json --page {FOLDER}/published-maps.md",
                is_compiled=True,
            ),
        ),
        data=(f"{FOLDER}/published-maps.json",),
    ),
    EvidencePage(
        "mavlink-rows",
        "MAVLink rows",
        "results of `sidestep mavlink check` on three lines",
        "`make interop`, `make rows-table`",
        ("runtime", "protocol", "gateways/mavlink", "vehicle_check", "robot"),
        12,
        (
            step("python -m pytest -q -m interop --no-skips tests/interop/test_judge.py"),
            step("python -m checks.site.interop_tables rows"),
        ),
        data=(f"{FOLDER}/mavlink",),
        file="docs/reference/mavlink-rows.md",
    ),
    EvidencePage(
        "mavlink-gateway",
        "MAVLink gateway",
        "latency, cost, slow line, forgery, time-outs, readiness, floods",
        "`sidestep bench gateway`",
        ("runtime", "protocol", "robot", "plant", "gateways/mavlink", "checks/speed/gateway"),
        40,
        benched("mavlink-gateway", GATEWAY),
    ),
    EvidencePage(
        "people",
        "Pedestrians",
        "contacts of all navigators in crowds, beside a robot that stands and an omniscient one",
        "`python -m study.people`",
        DRIVES,
        45,
        (
            step("make compiled"),
            step("python -P -m study.people", is_compiled=True),
        ),
        data=(f"{FOLDER}/people.json",),
    ),
    EvidencePage(
        "same-bits",
        "Same bits",
        "digests of a thousand random trials in each variant of processor features, C library,"
        " Python and libraries",
        "`make same-bits`",
        (*DRIVES, "constraints.txt", "checks/same_bits"),
        45,
        (step(f"python -m checks.same_bits --libraries --compiled --page {FOLDER}/same-bits.md"),),
        data=(f"{FOLDER}/same-bits.json",),
    ),
    EvidencePage(
        "study",
        "Study",
        "all navigators in generated worlds, with statistics; also as"
        " [one HTML file](study/report.html)",
        "[all commands](../how-to/studies.md#make-the-committed-report-again)",
        DRIVES,
        75,
        console=("docs/how-to/studies.md", "Make the committed report again"),
        data=(f"{FOLDER}/study", f"{FOLDER}/contacts", "README.md"),
        file=f"{FOLDER}/study/report.md",
    ),
    EvidencePage(
        "contacts",
        "Contacts by own motion",
        "each contact of the study that the robot caused, drawn and explained",
        "`python -m study.report.contacts`",
        DRIVES,
        with_page="study",
    ),
    EvidencePage(
        "microcontroller",
        "Microcontroller",
        "digests, cost, memory and single precision on the emulated board",
        "`make same-bits-mcu`, `python -m checks.speed.board.measure`,"
        " `python -m checks.speed.board.float32`, `make generate-docs`",
        ("robot/core", "firmware", "robot/hosting.py", "plant/sim", "checks/speed/board"),
        90,
        (
            step("make firmware"),
            step("python -m checks.same_bits.on_board"),
            step("python -m checks.speed.board.measure"),
            step("python -m checks.speed.board.float32 --output {work}/float32.json"),
            step(f"cp {{work}}/float32.json {FOLDER}/microcontroller/float32.json"),
            step("make generate-docs"),
        ),
        data=(f"{FOLDER}/microcontroller",),
    ),
    EvidencePage(
        "faults",
        "Fault matrix",
        "reaction of the robot to faults, with times and distances",
        "`sidestep bench faults --page FILE`",
        (*STACK, "checks/faults"),
        110,
        (
            step(
                f"python -m checks faults --keep {{work}}/faults.jsonl --page {FOLDER}/faults.md",
                may_miss=True,
            ),
        ),
    ),
    EvidencePage(
        "long-figures",
        "Figures that take longer",
        "growth, access control, crowds of log lines, floods, restarts, soak, odometry, arrival",
        "`python -m checks.site.figures_page`",
        (*STACK, "checks/speed", "checks/flood", "checks/endurance", "checks/fuzz"),
        190,
        benched("long-figures", LONG_FIGURES),
    ),
    EvidencePage(
        "falsifier",
        "Falsifier",
        "worlds in which a navigator failed, and the last search for more",
        "`sidestep falsify`, `python -m checks.site.findings`",
        DRIVES,
        180,
    ),
    EvidencePage(
        "tutorial",
        "Tutorial in a new container",
        "time and result of README and tutorial, page by page",
        "`python -m tests.support.walk`",
        ("README.md", "docs/tutorial", "Makefile", *STACK),
        10,
    ),
    EvidencePage(
        "long-runs",
        "Long runs and floods",
        "restarts, soak, floods, odometry, arrival, docker",
        "the commands on the page",
        STACK,
        240,
    ),
    EvidencePage(
        "ground-station",
        "Ground station and first drive",
        "defects and habits of a review, with the state of each",
        "the commands on the page",
        ("ground", "runtime/cli"),
        120,
    ),
    EvidencePage(
        "upstream",
        "Findings for upstream",
        "defects of libraries, with programs that show them",
        "the programs on the page",
        ("protocol/bus",),
        5,
    ),
    EvidencePage(
        "state-diagram",
        "State diagrams",
        "all states that the robot's code can reach",
        "`make generate-docs`",
        test="tests/unit/checks/test_mode_model.py",
    ),
    EvidencePage(
        "mutants",
        "Equivalent mutants",
        "changes of the code that no test can detect, with the reasons",
        "`make mutation`, `make generate-docs`",
        test="tests/unit/checks/test_mutation.py",
    ),
)


class MeasuredCommit(NamedTuple):
    """The commit that a page names."""

    date: str
    commit: str
    is_recorded: bool
    """Whether it was measured there. Otherwise the commit added the figures."""


class PageAge(Enum):
    """Whether a page is old."""

    FRESH = "fresh"
    STALE = "stale"
    DERIVED = "derived"
    UNKNOWN = "unknown"


class PageStatus(NamedTuple):
    """The age of a page, in words, too, and the number of commits to its sources."""

    page: EvidencePage
    age: PageAge
    words: str
    commits: int = 0
    is_marked: bool = False


def origin_of(text: str) -> MeasuredCommit | None:
    """Return the commit that a page names; None if it names none."""
    found = LINE.search(block_of(text))
    return found and MeasuredCommit(found["date"], found["commit"], found["how"] == "Measured")


def block_of(text: str) -> str:
    """Return what is between the marks of a page."""
    return text.partition(BEGIN)[2].partition(END)[0]


def with_block(text: str, lines: Sequence[str]) -> str:
    """Return the page with these lines between the marks; a page without gets them at its top."""
    if BEGIN not in text:
        heading = HEADING.search(text)
        at = heading.end() if heading else 0
        text = f"{text[:at]}\n{BEGIN}{END}{text[at:]}"
    return with_text(text, BEGIN, END, "\n" + "\n\n".join(lines) + "\n\n")


def with_origin_of(text: str, old: str) -> str:
    """Return a page that is made again from old data, with the commit that it named before."""
    found = block_of(old)
    return with_block(text, found.strip().split("\n\n")) if found else text


def with_mark(text: str, status: PageStatus) -> str:
    """Return the page with the word "Stale" if it is, else without."""
    line = LINE.search(block_of(text))
    if line is None:
        return text
    if status.age is not PageAge.STALE:
        return with_block(text, [line[0]]) if STALE.search(block_of(text)) else text
    commits = status.commits // 100 * 100
    warning = (
        f"**Stale:** more than {commits:,} commits changed the sources of this page since then;"
        f" {status.page.advice()}."
    )
    return with_block(text, [line[0], warning])


def former_paths(path: str) -> Iterator[str]:
    """Yield where a path was before it moved, and where folders in it were."""
    for new, old in FORMER:
        if f"{path}/".startswith(f"{new}/"):
            yield old + path.removeprefix(new)
        elif new.startswith(f"{path}/"):
            yield old


class CommitHistory:
    """The commits of a checkout, asked of git."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.missing = self._missing()
        """Why there is no complete history; empty if there is."""

    def commits_since(self, commit: str, paths: Sequence[str]) -> int | None:
        """Return how many commits touched the paths since a commit; None if it is not here."""
        if self._git("cat-file", "-e", f"{commit}^{{commit}}") is None:
            return None
        former = [old for path in paths for old in former_paths(path)]
        found = self._git("rev-list", "--count", f"{commit}..HEAD", "--", *paths, *former)
        return None if found is None else int(found)

    def head(self) -> str:
        """Return the short hash of the present commit; raise RuntimeError without git."""
        found = self._git("rev-parse", "--short=8", "HEAD")
        if found is None:
            raise RuntimeError("this is no git checkout, so that no commit can be named")
        return found

    def changes_since(self, commit: str) -> list[str]:
        """Return the paths that differ from a commit and that a figure may depend on."""
        others = tuple(f":(exclude){path}" for path in WRITTEN)
        known = self._git("diff", "--name-only", commit, "--", ".", *others)
        new = self._git("ls-files", "--others", "--exclude-standard", "--", ".", *others)
        return (
            [commit] if known is None or new is None else [*known.splitlines(), *new.splitlines()]
        )

    def _missing(self) -> str:
        shallow = self._git("rev-parse", "--is-shallow-repository")
        if shallow is None:
            return "no git history"
        return "shallow clone" if shallow == "true" else ""

    def _git(self, *words: str) -> str | None:
        try:
            done = subprocess.run(
                ("git", "-C", str(self.root), *words), capture_output=True, text=True, check=False
            )
        except OSError:
            return None
        return done.stdout.strip() if done.returncode == 0 else None


def statuses(root: Path, table: Sequence[EvidencePage] = EVIDENCE) -> Iterator[PageStatus]:
    """Yield the status of each page."""
    history = CommitHistory(root)
    for page in table:
        if page.test:
            yield PageStatus(page, PageAge.DERIVED, f"compared by {page.test}")
            continue
        file = root / page.path
        text = file.read_text(encoding="utf-8") if file.exists() else ""
        yield status_of(page, text, history)


def status_of(page: EvidencePage, text: str, history: CommitHistory) -> PageStatus:
    """Return the status of a measured page with this text."""
    marked = bool(STALE.search(block_of(text)))
    origin = origin_of(text)
    if origin is None:
        return PageStatus(page, PageAge.UNKNOWN, "the page names no commit", is_marked=marked)
    if history.missing:
        return PageStatus(page, PageAge.UNKNOWN, history.missing, is_marked=marked)
    commits = history.commits_since(origin.commit, page.sources)
    if commits is None:
        words = f"commit {origin.commit} is not in the history"
        return PageStatus(page, PageAge.UNKNOWN, words, is_marked=marked)
    age = PageAge.STALE if commits > LIMIT else PageAge.FRESH
    words = f"{commits} commits to its sources since {origin.commit} of {origin.date}"
    return PageStatus(page, age, words, commits, marked)


def brief(found: Sequence[PageStatus]) -> Iterator[str]:
    """Yield what a reader of the gate should know."""

    def names(wanted: Sequence[PageStatus]) -> str:
        return ", ".join(one.page.name for one in wanted)

    stale = [one for one in found if one.age is PageAge.STALE]
    repair = "`python -m checks.evidence --mark` corrects it"
    if stale:
        yield f"evidence: {len(stale)} of {len(found)} pages are stale: {names(stale)}"
    if unmarked := [one for one in stale if not one.is_marked]:
        yield f"evidence: stale and not marked: {names(unmarked)}; {repair}"
    if wrong := [one for one in found if one.is_marked and one.age is PageAge.FRESH]:
        yield f"evidence: marked as stale, but fresh: {names(wrong)}; {repair}"
    unknown = [one for one in found if one.age is PageAge.UNKNOWN]
    for words in dict.fromkeys(one.words for one in unknown):
        same = [one for one in unknown if one.words == words]
        yield f"evidence: of unknown age ({words}): {names(same)}"
    if not (stale or unknown):
        yield f"evidence: none of {len(found)} pages is stale"


def mark(root: Path, table: Sequence[EvidencePage] = EVIDENCE) -> Iterator[str]:
    """Write or remove the word "Stale", renew the index, and yield each page that changed."""
    for one in statuses(root, table):
        file = root / one.page.path
        if one.age in (PageAge.STALE, PageAge.FRESH) and replaced(
            file, with_mark(file.read_text(encoding="utf-8"), one)
        ):
            yield f"{one.page.path}: {one.age.value}"
    if write_index(root, table):
        yield f"{FOLDER}/index.md"


def replaced(file: Path, text: str) -> bool:
    """Write a file unless it has this text; return whether it was written."""
    if file.read_text(encoding="utf-8") == text:
        return False
    file.write_text(text, encoding="utf-8")
    return True


def write_index(root: Path, table: Sequence[EvidencePage] = EVIDENCE) -> bool:
    """Renew the table of the index, if there is one; return whether it changed."""
    file = root / FOLDER / "index.md"
    if not file.exists():
        return False
    text = file.read_text(encoding="utf-8")
    return replaced(file, with_text(text, BEGIN, END, f"\n{index(root, table)}\n\n"))


def index(root: Path, table: Sequence[EvidencePage] = EVIDENCE) -> str:
    """Return the table of all pages, as the pages name their commits and marks."""
    lines = ["| page | content | measured | measured again by | minutes |", "|---|---|---|---|---|"]
    for page in table:
        link = Path(os.path.relpath(page.path, FOLDER)).as_posix()
        cells = (f"[{page.title}]({link})", page.content, measured_cell(root, page), page.again)
        minutes = f"{page.minutes:g}" if page.minutes else "-"
        by_hand = "" if page.is_automatic or page.with_page or page.test else ", by hand"
        lines.append(f"| {' | '.join(cells)}{by_hand} | {minutes} |")
    return "\n".join(lines)


def measured_cell(root: Path, page: EvidencePage) -> str:
    """Return date and commit of a page for the index."""
    if page.test:
        return "derived, compared by a test"
    text = (root / page.path).read_text(encoding="utf-8")
    origin = origin_of(text)
    if origin is None:
        return "unknown"
    stale = ", **stale**" if STALE.search(block_of(text)) else ""
    how = "" if origin.is_recorded else "added "
    return f"{how}{origin.date}, `{origin.commit}`{stale}"


class CampaignState(msgspec.Struct):
    """How far the measurements of a commit have come; kept between calls."""

    commit: str = ""
    begun: list[str] = []
    steps: dict[str, int] = {}
    """Steps that have ended, by page."""
    done: list[str] = []


class EvidenceCampaign:
    """Measures pages one after the other and remembers how far it has come."""

    def __init__(self, root: Path, table: Sequence[EvidencePage] = EVIDENCE) -> None:
        self.root = root
        self.table = table
        self.history = CommitHistory(root)
        self.failed: list[str] = []
        self._file = root / STATE
        self._state = CampaignState()

    def run(self, pages: Sequence[EvidencePage], is_afresh: bool = False) -> int:
        """Measure the pages; return the exit code."""
        self._resume(self._clean_head(), is_afresh)
        automatic = [page for page in pages if page.is_automatic]
        for number, page in enumerate(automatic, 1):
            where = f"[{number}/{len(automatic)}] {page.name}"
            if page.name in self._state.done:
                print(f"{where}: measured already at commit {self._state.commit}", flush=True)
                continue
            print(f"{where}: about {page.minutes:g} min", flush=True)
            if problem := self._measure(page):
                self._put_back(page)
                self.failed.append(f"{page.name}: {problem}; see {self._log(page)}")
        for page in pages:
            if not (page.is_automatic or page.with_page or page.test):
                print(f"{page.name}: not measured, because {page.advice()}")
        for line in self.failed:
            print(f"evidence: FAILED, the old page is kept: {line}", file=sys.stderr)
        return 1 if self.failed else 0

    def name_commits(self, pages: Sequence[EvidencePage]) -> int:
        """Name the present commit on pages that were measured by hand; return the exit code."""
        commit = self._clean_head()
        for page in pages:
            self._name_commit(page, commit, described(figures.machine_load()))
        return 0

    def _clean_head(self) -> str:
        """Return the present commit; raise RuntimeError if it is not what would be measured."""
        head = self.history.head()
        if changes := self.history.changes_since(head):
            raise RuntimeError(
                f"{', '.join(changes[:5])}: uncommitted changes, so that the pages would name a"
                " commit that was not measured; commit or remove them"
            )
        return head

    def _name_commit(self, page: EvidencePage, commit: str, about: str) -> None:
        """Name a commit on a page and on those of the same measurement."""
        line = f"Measured on {datetime.now(UTC):%Y-%m-%d} at commit `{commit}`, {about}."
        for one in (page, *(one for one in self.table if one.with_page == page.name)):
            file = self.root / one.path
            file.write_text(with_block(file.read_text("utf-8"), [line]), encoding="utf-8")
        write_index(self.root, self.table)

    def _resume(self, head: str, is_afresh: bool) -> None:
        """Go on with the commit of the last call, unless the code has changed since."""
        if self._file.exists() and not is_afresh:
            found = msgspec.json.decode(self._file.read_bytes(), type=CampaignState)
            if not self.history.changes_since(found.commit):
                self._state = found
                return
        self._state = CampaignState(commit=head)
        self._keep()

    def _measure(self, page: EvidencePage) -> str:
        """Measure a page from the step that was interrupted; return what failed, or nothing."""
        work, load = self._work(page), figures.machine_load()
        if page.name not in self._state.begun:
            rmtree(work, ignore_errors=True)
            self._put_aside(page)
            self._state.begun.append(page.name)
            self._keep()
        steps = self._steps(page)
        for number in range(self._state.steps.get(page.name, 0), len(steps)):
            words = " ".join(steps[number].words)
            print(f"    {datetime.now(UTC):%H:%M} {words}", flush=True)
            if problem := self._run(page, steps[number]):
                return f"{words}: {problem}"
            self._state.steps[page.name] = number + 1
            self._keep()
        if changes := self.history.changes_since(self._state.commit):
            return f"{', '.join(changes[:5])}: changed while it was measured"
        self._name_commit(page, self._state.commit, described(load))
        self._state.done.append(page.name)
        self._keep()
        return ""

    def _run(self, page: EvidencePage, step: MeasuringStep) -> str:
        """Run a step and return why it failed, or nothing."""
        work, file = self._work(page), self.root / page.path
        words = [word.replace("{work}", str(work)) for word in step.words]
        before = file.stat().st_mtime_ns if file.exists() else 0
        if words[0] == "python":
            words[0] = sys.executable
        # The options of `make evidence` are not those of another target.
        environment = {name: value for name, value in os.environ.items() if "MAKE" not in name}
        environment.pop("MFLAGS", None)
        environment.pop("ARGS", None)
        environment["PATH"] = os.pathsep.join(
            (str(Path(sys.executable).parent), environment.get("PATH", ""))
        )
        if step.is_compiled:
            environment["PYTHONPATH"] = str(self.root / "build" / "compiled")
        with self._log(page).open("ab") as log:
            log.write(f"\n$ {' '.join(words)}\n".encode())
            log.flush()
            code = exit_code(words, work if step.in_work else self.root, environment, log.fileno())
        was_written = file.exists() and file.stat().st_mtime_ns != before
        if code == 0 or (code == 1 and step.may_miss and was_written):
            return ""
        return f"exit code {code}"

    def _steps(self, page: EvidencePage) -> tuple[MeasuringStep, ...]:
        """Return the steps of a page; those of another page run in the work folder."""
        if page.console is None:
            return page.steps
        for name in WRITTEN:
            link = self._work(page) / name
            if not link.is_symlink():
                link.symlink_to(self.root / name)
        file, heading = page.console
        text = (self.root / file).read_text(encoding="utf-8")
        return (step("make compiled"), *commands_under(text, heading))

    def _work(self, page: EvidencePage) -> Path:
        return self._file.parent / page.name

    def _log(self, page: EvidencePage) -> Path:
        return self._work(page).with_suffix(".log")

    def _files(self, page: EvidencePage) -> Iterator[Path]:
        """Yield what a measurement may write."""
        pages = [page, *(one for one in self.table if one.with_page == page.name)]
        for name in (*(one.path for one in pages), *page.data):
            if (self.root / name).exists():
                yield Path(name)

    def _put_aside(self, page: EvidencePage) -> None:
        aside = self._work(page) / "before"
        for file in self._files(page):
            copied(self.root / file, aside / file)

    def _put_back(self, page: EvidencePage) -> None:
        """Restore the old page, and begin with its first step in the next call."""
        aside = self._work(page) / "before"
        for file in self._files(page):
            if (aside / file).exists():
                copied(aside / file, self.root / file)
        self._state.begun.remove(page.name)
        self._state.steps.pop(page.name, None)
        self._keep()

    def _keep(self) -> None:
        self._file.parent.mkdir(parents=True, exist_ok=True)
        new = self._file.with_suffix(".new")
        new.write_bytes(msgspec.json.encode(self._state))
        new.replace(self._file)


def exit_code(words: Sequence[str], folder: Path, environment: dict[str, str], log: int) -> int:
    """Run a command; let it end by itself after an interruption."""
    try:
        child = subprocess.Popen(
            words, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log
        )
    except OSError as error:
        os.write(log, f"{error}\n".encode())
        return 127
    try:
        return child.wait()
    except KeyboardInterrupt:
        try:
            child.wait(timeout=30.0)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
        raise


def copied(source: Path, target: Path) -> None:
    """Replace a file or a folder by a copy of another one."""
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.is_dir():
        rmtree(target, ignore_errors=True)
        copytree(source, target)
    else:
        copy2(source, target)


def commands_under(text: str, heading: str) -> Iterator[MeasuringStep]:
    """Yield the console commands in a section of a page, with compiled modules."""
    section = text.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    for found in PROMPT.finditer(section):
        words = found[1].replace("\\\n", " ").split()
        program = words[:1] if words[0] == "sidestep" else words[2:3]
        rest = words[1:] if words[0] == "sidestep" else words[3:]
        yield MeasuringStep(("python", "-P", "-m", *program, *rest), is_compiled=True, in_work=True)


def described(load_before: float) -> str:
    """Return machine and load in words."""
    return ", ".join(
        f"{name} {value}" for name, value in figures.describe_machine(load_before).items()
    )


def chosen(
    table: Sequence[EvidencePage], names: Sequence[str], minutes: float
) -> list[EvidencePage]:
    """Return the pages with these names that take at most so long; raise KeyError for others.

    A page that is measured with another one stands for that one.
    """
    known = {page.name: page for page in table}
    found = [known[name] for name in names] if names else list(table)
    found = [known[page.with_page] if names and page.with_page else page for page in found]
    return [page for page in found if page.minutes <= minutes]


def listing(table: Sequence[EvidencePage]) -> Iterator[str]:
    """Yield one line for each page, with the expected minutes and the command."""
    for page in table:
        if page.test:
            how = "derived from the code"
        elif page.with_page:
            how = f"measured with {page.with_page}"
        else:
            how = f"{page.minutes:4g} min{'' if page.is_automatic else ' by hand'}"
        yield f"{page.name:16} {how:24} {page.again}"


def main(argv: Sequence[str] | None = None) -> int:
    """Print, mark or measure; return the exit code, 0 whatever the age of a page is."""
    command = "python -m checks.evidence"
    parser = argparse.ArgumentParser(prog=command, description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="PAGE", help="pages to measure (all)")
    group = parser.add_mutually_exclusive_group()
    group.add_argument("--mark", action="store_true", help='write or remove the word "Stale"')
    group.add_argument("--brief", action="store_true", help="print only what needs attention")
    group.add_argument("--measure", action="store_true", help="measure, from where it ended")
    group.add_argument("--measured", action="store_true", help="name this commit on the pages")
    parser.add_argument("--list", action="store_true", help="print the pages with their minutes")
    parser.add_argument("--max-minutes", type=float, default=float("inf"), metavar="N")
    parser.add_argument("--afresh", action="store_true", help="forget what was measured before")
    options = parser.parse_args(argv)
    try:
        pages = chosen(EVIDENCE, options.names, options.max_minutes)
    except KeyError as error:
        parser.error(f"no page {error}; pages: {', '.join(one.name for one in EVIDENCE)}")
    if options.list:
        print(*listing(pages), sep="\n")
    elif options.measure:
        return ended(lambda: EvidenceCampaign(ROOT).run(pages, options.afresh))
    elif options.measured:
        return ended(lambda: EvidenceCampaign(ROOT).name_commits(pages if options.names else []))
    elif options.mark:
        for line in mark(ROOT):
            print(line)
    elif options.brief:
        print(*brief(list(statuses(ROOT))), sep="\n")
    else:
        for one in statuses(ROOT, pages):
            note = "" if one.is_marked == (one.age is PageAge.STALE) else "; its mark is wrong"
            print(f"{one.page.name:16} {one.age.value:8} {one.words}{note}")
    return 0


def ended(measure: Callable[[], int]) -> int:
    """Measure and return the exit code; an interruption keeps what has ended."""
    try:
        return measure()
    except RuntimeError as error:
        print(f"evidence: {error}", file=sys.stderr)
        return EXIT_USAGE
    except KeyboardInterrupt:
        print("\nevidence: interrupted; the next call goes on with this step", file=sys.stderr)
        return EXIT_INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
