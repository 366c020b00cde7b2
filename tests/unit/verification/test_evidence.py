"""Pages of evidence name their commit, are marked when they are old, and are measured again."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from checks import evidence
from checks.evidence import (
    BEGIN,
    EVIDENCE,
    FOLDER,
    LIMIT,
    EvidenceCampaign,
    EvidencePage,
    MeasuredCommit,
    MeasuringStep,
    PageAge,
    PageStatus,
    brief,
    chosen,
    commands_under,
    index,
    mark,
    origin_of,
    statuses,
    with_block,
    with_mark,
    with_origin_of,
)
from tests.support.each import each

ROOT = Path(__file__).resolve().parents[3]
PAGE = EvidencePage(
    "speed", "Speed", "how fast", "`measure`", ("code",), 1, (MeasuringStep(("true",)),)
)
BY_HAND = EvidencePage("soak", "Soak", "how long", "`soak`", ("code",), 9)
DERIVED = EvidencePage("states", "States", "all", "`make`", test="tests/test_states.py")
TABLE = (PAGE, BY_HAND, DERIVED)


class Repository:
    """A made-up repository with two pages and their sources."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.git("init", "-q", "-b", "main")
        self.write("code/a.py", "0")
        self.write(".gitignore", "/build/\n")
        self.first = self.commit()
        for page in (PAGE, BY_HAND):
            text = with_block(f"# {page.title}\n\ntext\n", [line(self.first)])
            self.write(page.path, text)
        self.write(f"{FOLDER}/index.md", f"# Evidence\n\n{BEGIN}{evidence.END}")
        self.commit()

    def git(self, *words: str, folder: Path | None = None) -> str:
        named = ("-c", "user.name=a", "-c", "user.email=a@x", "-c", "commit.gpgsign=false")
        done = subprocess.run(
            ("git", *named, *words),
            cwd=folder or self.root,
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.strip()

    def write(self, name: str, text: str) -> None:
        (self.root / name).parent.mkdir(parents=True, exist_ok=True)
        (self.root / name).write_text(text, encoding="utf-8")

    def read(self, page: EvidencePage = PAGE) -> str:
        return (self.root / page.path).read_text(encoding="utf-8")

    def commit(self) -> str:
        self.git("add", "-A")
        self.git("commit", "-q", "-m", "change")
        return self.git("rev-parse", "--short=8", "HEAD")

    def commit_code(self, count: int, path: str = "code/a.py") -> None:
        """Add commits to a file, all with one call of git."""
        stream = ""
        for number in range(count):
            data = f"{count} {number}"
            stream += (
                f"commit refs/heads/main\ncommitter a <a@example.org> {number + 1} +0000\n"
                f"data 0\n{'from refs/heads/main^0' if number == 0 else ''}\n"
                f"M 644 inline {path}\ndata {len(data)}\n{data}\n"
            )
        subprocess.run(
            ("git", "fast-import", "--quiet"), cwd=self.root, input=stream.encode(), check=True
        )
        self.git("reset", "-q", "--hard")

    def statuses(self) -> dict[str, PageStatus]:
        return {one.page.name: one for one in statuses(self.root, TABLE)}

    def brief(self) -> str:
        return "\n".join(brief(list(statuses(self.root, TABLE))))


def line(commit: str, how: str = "Measured") -> str:
    word = "at" if how == "Measured" else "by"
    return f"{how} on 2026-11-24 {word} commit `{commit}`, cpu X, load 1.0 -> 2.0."


@pytest.fixture
def made(tmp_path: Path) -> Repository:
    return Repository(tmp_path)


def test_every_page_of_evidence_is_in_the_table() -> None:
    pages = {path.relative_to(ROOT).as_posix() for path in (ROOT / FOLDER).rglob("*.md")}
    assert pages - {f"{FOLDER}/index.md"} <= {page.path for page in EVIDENCE}
    assert all((ROOT / page.path).exists() for page in EVIDENCE)


def test_every_file_beside_the_pages_belongs_to_one() -> None:
    data = [name for page in EVIDENCE for name in page.data]
    for path in (ROOT / FOLDER).rglob("*.*"):
        name = path.relative_to(ROOT).as_posix()
        if path.suffix != ".md" and path.is_file():
            assert any(name == one or name.startswith(f"{one}/") for one in data), name


def test_every_source_of_a_page_exists() -> None:
    missing = [path for page in EVIDENCE for path in page.sources if not (ROOT / path).exists()]
    assert missing == []


@each("page", EVIDENCE)
def test_page_names_its_commit_unless_a_test_compares_it(page: EvidencePage) -> None:
    if page.test:
        assert page.path.rpartition("/")[2] in (ROOT / page.test).read_text(encoding="utf-8")
    else:
        assert page.sources
        assert origin_of((ROOT / page.path).read_text(encoding="utf-8")) is not None


def test_committed_index_shows_what_the_pages_name() -> None:
    text = (ROOT / FOLDER / "index.md").read_text(encoding="utf-8")
    assert index(ROOT) in text, "python -m checks.evidence --mark"


def test_commands_of_the_study_are_those_of_its_page() -> None:
    (page,) = (page for page in EVIDENCE if page.console)
    assert page.console
    steps = list(commands_under((ROOT / page.console[0]).read_text("utf-8"), page.console[1]))
    programs = [step.words[3] for step in steps]
    assert programs[0] == "sidestep"
    assert programs[-1] == "study.report.contacts"
    assert steps[-2].words[4:7] == ("study", "report", "study-results")
    assert not any("\\" in word for step in steps for word in step.words)


@each(
    ("text", "found"),
    [
        (line("abcdef12"), MeasuredCommit("2026-11-24", "abcdef12", True)),
        (line("abcdef12", "Figures added"), MeasuredCommit("2026-11-24", "abcdef12", False)),
        (
            "Measured on 2026-11-24 at commit `abcdef12`.",
            MeasuredCommit("2026-11-24", "abcdef12", True),
        ),
        ("Measured on 2026-11-24.", None),
    ],
)
def test_line_of_a_page_is_read(text: str, found: MeasuredCommit | None) -> None:
    assert origin_of(with_block("# Page\n\ntext\n", [text])) == found
    assert origin_of(f"# Page\n\n{text}\n") is None


def test_block_is_placed_below_the_heading_and_replaced() -> None:
    text = with_block("<!-- made -->\n\n# Page\n\ntext\n", ["one"])
    assert text.startswith(f"<!-- made -->\n\n# Page\n\n{BEGIN}\none\n\n")
    assert text.endswith("-->\n\ntext\n")
    assert with_block(text, ["one"]) == text
    assert with_block(text, ["two"]) == text.replace("one", "two")


def test_page_made_from_old_data_names_the_old_commit() -> None:
    old = with_block("# Page\n\nold\n", [line("abcdef12"), "**Stale:** more than 400 commits."])
    assert with_origin_of("# Page\n\nnew\n", old) == old.replace("\nold\n", "\nnew\n")
    assert with_origin_of("# Page\n", "# Page\n") == "# Page\n"


def test_only_commits_to_its_sources_make_a_page_stale(made: Repository) -> None:
    made.commit_code(LIMIT)
    made.commit_code(9, "other.py")
    found = made.statuses()
    assert (found["speed"].age, found["speed"].commits) == (PageAge.FRESH, LIMIT)
    assert found["states"].age is PageAge.DERIVED
    assert made.brief() == "evidence: none of 3 pages is stale"
    made.commit_code(1)
    assert made.statuses()["speed"].age is PageAge.STALE


def test_stale_pages_are_marked_until_they_are_measured(made: Repository) -> None:
    before = made.read()
    made.commit_code(LIMIT + 123)
    assert "2 of 3 pages are stale: speed, soak" in made.brief()
    assert "stale and not marked: speed, soak" in made.brief()
    assert list(mark(made.root, TABLE)) == [
        f"{PAGE.path}: stale",
        f"{BY_HAND.path}: stale",
        f"{FOLDER}/index.md",
    ]
    assert "**Stale:** more than 400 commits changed" in made.read()
    assert "`make evidence ARGS=speed` measures it again" in made.read()
    assert "measured by hand: `soak`" in made.read(BY_HAND)
    assert f"| 2026-11-24, `{made.first}`, **stale** | `measure` |" in index(made.root, TABLE)
    assert "not marked" not in made.brief()
    assert list(mark(made.root, TABLE)) == []
    head = made.git("rev-parse", "HEAD")
    made.write(PAGE.path, made.read().replace(made.first, head))
    assert "marked as stale, but fresh: speed" in made.brief()
    assert list(mark(made.root, TABLE)) == [f"{PAGE.path}: fresh", f"{FOLDER}/index.md"]
    assert made.read() == before.replace(made.first, head)


def test_mark_does_not_change_with_every_commit(made: Repository) -> None:
    status = PageStatus(PAGE, PageAge.STALE, "", 1_234)
    text = with_mark(made.read(), status)
    assert "more than 1,200 commits" in text
    assert with_mark(text, status._replace(commits=1_299)) == text
    assert with_mark(text, status._replace(commits=1_300)) != text


def test_unknown_commit_keeps_the_mark(made: Repository) -> None:
    made.write(PAGE.path, with_mark(made.read(), PageStatus(PAGE, PageAge.STALE, "", 400)))
    made.write(PAGE.path, made.read().replace(made.first, "1234567890"))
    assert made.statuses()["speed"].age is PageAge.UNKNOWN
    assert "commit 1234567890 is not in the history): speed" in made.brief()
    text = made.read()
    list(mark(made.root, TABLE))
    assert made.read() == text


def test_page_without_a_line_is_of_unknown_age(made: Repository) -> None:
    made.write(PAGE.path, "# Speed\n")
    assert "the page names no commit): speed" in made.brief()
    list(mark(made.root, TABLE))
    assert made.read() == "# Speed\n"


def test_shallow_clone_knows_no_age(made: Repository, tmp_path: Path) -> None:
    clone = tmp_path / "build" / "clone"
    made.git("clone", "-q", "--depth", "1", f"file://{made.root}", str(clone))
    assert list(brief(list(statuses(clone, TABLE)))) == [
        "evidence: of unknown age (shallow clone): speed, soak"
    ]


def test_folder_without_git_knows_no_age(made: Repository, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert made.brief() == "evidence: of unknown age (no git history): speed, soak"


def test_only_the_named_or_short_pages_are_measured() -> None:
    beside = PAGE._replace(name="beside", with_page="speed", steps=())
    table = (*TABLE, beside)
    assert chosen(table, [], 1.0) == [PAGE, DERIVED, beside]
    assert chosen(table, ["soak", "beside"], 99.0) == [BY_HAND, PAGE]
    with pytest.raises(KeyError):
        chosen(table, ["none"], 99.0)


def test_page_measured_by_hand_gets_the_present_commit(made: Repository) -> None:
    made.commit_code(1)
    assert EvidenceCampaign(made.root, TABLE).name_commits([BY_HAND]) == 0
    head = made.git("rev-parse", "--short=8", "HEAD")
    assert f"at commit `{head}`, cpu " in made.read(BY_HAND)
    assert made.first in made.read()


@each("option", [(), ("--brief",), ("--list",)])
def test_command_never_fails(option: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    assert evidence.main(option) == 0
    assert capsys.readouterr().out


SCRIPT = """\
import pathlib, sys
root, work = pathlib.Path.cwd(), pathlib.Path(sys.argv[2])
calls = root / "build" / "calls"
calls.parent.mkdir(exist_ok=True)
calls.write_text((calls.read_text() if calls.exists() else "") + sys.argv[1])
(root / "docs/evidence/speed.md").write_text(f"# Speed\\n\\nnew {sys.argv[1]}\\n")
raise SystemExit((root / "build" / f"code{sys.argv[1]}").exists())
"""


def campaign(made: Repository, *steps: str, may_miss: bool = False) -> Callable[[], int]:
    """Return a call that measures a page by these steps of SCRIPT."""
    made.write("code/step.py", SCRIPT)
    made.commit()
    words = ("python", "code/step.py")
    all_steps = tuple(MeasuringStep((*words, name, "{work}"), may_miss=may_miss) for name in steps)
    page = PAGE._replace(steps=all_steps)
    table = (page, BY_HAND, DERIVED)
    return lambda: EvidenceCampaign(made.root, table).run(table)


def calls(made: Repository) -> str:
    return (made.root / "build" / "calls").read_text(encoding="utf-8")


def test_measured_page_names_commit_machine_and_load(
    made: Repository, capsys: pytest.CaptureFixture[str]
) -> None:
    run = campaign(made, "a", "b")
    head = made.git("rev-parse", "--short=8", "HEAD")
    assert run() == 0
    assert f"at commit `{head}`, cpu " in made.read()
    assert "load " in made.read()
    assert made.read().endswith("\nnew b\n")
    assert f"`{head}`" in (made.root / FOLDER / "index.md").read_text(encoding="utf-8")
    assert "soak: not measured, because it is measured by hand: `soak`" in capsys.readouterr().out


def test_measured_page_is_not_measured_again_until_the_code_changes(made: Repository) -> None:
    run = campaign(made, "a")
    assert run() == 0
    made.commit()
    assert run() == 0
    assert calls(made) == "a"
    made.commit_code(1)
    assert run() == 0
    assert calls(made) == "aa"


def test_interrupted_page_goes_on_with_its_step(
    made: Repository, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = campaign(made, "a", "b", "c")
    real = evidence.exit_code

    def interrupted(words: list[str], *rest: object) -> int:
        if "b" in words:
            raise KeyboardInterrupt
        return real(words, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(evidence, "exit_code", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run()
    monkeypatch.setattr(evidence, "exit_code", real)
    assert run() == 0
    assert calls(made) == "abc"


def test_failed_measurement_keeps_the_old_page_and_names_its_log(
    made: Repository, capsys: pytest.CaptureFixture[str]
) -> None:
    run, before = campaign(made, "a", "b"), made.read()
    made.write("build/codeb", "")
    assert run() == 1
    assert made.read() == before
    err = capsys.readouterr().err
    assert "FAILED, the old page is kept: speed: python code/step.py b" in err
    assert str(made.root / "build" / "evidence" / "speed.log") in err
    (made.root / "build" / "codeb").unlink()
    assert run() == 0
    assert calls(made) == "abab"


def test_missed_threshold_is_no_failure_if_the_page_was_written(made: Repository) -> None:
    run = campaign(made, "a", may_miss=True)
    made.write("build/codea", "")
    assert run() == 0
    assert "new a" in made.read()


def test_uncommitted_code_is_refused_and_a_page_is_not(made: Repository) -> None:
    run = campaign(made, "a")
    made.write("code/new.py", "")
    with pytest.raises(RuntimeError, match=r"code/new.py: uncommitted changes"):
        run()
    (made.root / "code/new.py").unlink()
    made.write(BY_HAND.path, made.read(BY_HAND) + "more\n")
    assert run() == 0


def test_options_of_make_are_not_handed_to_a_step(
    made: Repository, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MAKEFLAGS", " -- ARGS=speed")
    monkeypatch.setenv("ARGS", "speed")
    found: dict[str, str] = {}

    def keep(words: object, folder: object, environment: dict[str, str], log: object) -> int:
        found.update(environment)
        return 0

    run = campaign(made, "a")
    monkeypatch.setattr(evidence, "exit_code", keep)
    assert run() == 0
    assert not {"MAKEFLAGS", "ARGS"} & set(found)
    assert found["PATH"].startswith(str(Path(sys.executable).parent))
