"""Pages of evidence: their commit, their age, findings driven again, and published maps."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from shutil import copyfile

import pytest

from checks import evidence
from checks.evidence import (
    BEGIN,
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
    former_paths,
    index,
    mark,
    origin_of,
    statuses,
    with_block,
    with_mark,
    with_origin_of,
)
from checks.evidence import EVIDENCE as CHECKS_EVIDENCE
from checks.site import published_maps
from checks.site.findings import WORLDS, failing, main, name_of
from checks.site.published_maps import (
    MapRun,
    MapSet,
    barn_worlds,
    cells,
    cylinders,
    result,
    table,
    with_table,
)
from checks.site.published_maps import main as published_maps_main
from protocol.outcome import LOST, UNREACHABLE
from protocol.world import WorldCircle
from runtime.errors import UserError
from study.falsify.findings import read_finding
from study.report.evidence import MapResult, read_evidence
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
    assert pages - {f"{FOLDER}/index.md"} <= {page.path for page in CHECKS_EVIDENCE}
    assert all((ROOT / page.path).exists() for page in CHECKS_EVIDENCE)


def test_every_file_beside_the_pages_belongs_to_one() -> None:
    data = [name for page in CHECKS_EVIDENCE for name in page.data]
    for path in (ROOT / FOLDER).rglob("*.*"):
        name = path.relative_to(ROOT).as_posix()
        if path.suffix != ".md" and path.is_file():
            assert any(name == one or name.startswith(f"{one}/") for one in data), name


def test_every_source_of_a_page_exists() -> None:
    missing = [
        path for page in CHECKS_EVIDENCE for path in page.sources if not (ROOT / path).exists()
    ]
    assert missing == []


@each("page", CHECKS_EVIDENCE)
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
    (page,) = (page for page in CHECKS_EVIDENCE if page.console)
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


SOURCE = min(WORLDS.glob("paper/bug-a-*.toml"))


def stem_of(kind: str) -> str:
    """Return the name of a file with a finding of this kind."""
    return f"bug-a-{read_finding(SOURCE).world.family}-{kind}-again"


def stale(folder: Path) -> Path:
    """Copy a finding, with another name, kind and sentence than its drive has."""
    _, recipe, rest = SOURCE.read_text(encoding="utf-8").split("\n", 2)
    recipe = recipe.replace(f"kind={read_finding(SOURCE).kind}", "kind=lost")
    file = folder / f"{stem_of('lost')}.toml"
    file.write_text(f"# Old.\n{recipe}\n{rest}", encoding="utf-8")
    copyfile(SOURCE.with_suffix(".svg"), file.with_suffix(".svg"))
    return file


def test_stale_finding_gets_sentence_kind_name_and_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, file = read_finding(SOURCE), stale(tmp_path)
    assert main([str(file)]) == 0
    wanted = stem_of(source.kind)
    assert source.found
    assert sorted(one.name for one in tmp_path.iterdir()) == [f"{wanted}.svg", f"{wanted}.toml"]
    new = read_finding(tmp_path / f"{wanted}.toml")
    assert (new.sentence, new.kind, new.found) == (source.sentence, source.kind, source.found)
    assert new.world.name == wanted
    assert source.sentence in capsys.readouterr().out


def test_finding_that_holds_is_reported_and_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fixed = next(WORLDS.glob("fixed/b-wedge*.toml"))
    file = tmp_path / fixed.name
    copyfile(fixed, file)
    assert main([str(file)]) == 1
    assert "holds now" in capsys.readouterr().out
    assert file.read_bytes() == fixed.read_bytes()


def test_name_that_is_taken_or_without_class_is_refused(tmp_path: Path) -> None:
    file = stale(tmp_path)
    (tmp_path / f"{stem_of('blocked')}.toml").write_text("")
    with pytest.raises(UserError, match="exists"):
        name_of(file, read_finding(file), "blocked")
    with pytest.raises(UserError, match="does not contain its class"):
        name_of(tmp_path / "other.toml", read_finding(file), "blocked")


def test_only_findings_that_still_fail_are_driven_again() -> None:
    assert {file.parent.name for file in failing(WORLDS)} == {"open", "paper"}


CYLINDER = """
<model name='unit_cylinder_{n}'>
  <pose frame=''>{x} {y} 0 0 0 0</pose>
  <link name='link'><collision name='collision'><geometry>
    <cylinder><radius>0.075</radius><length>1</length></cylinder>
  </geometry></collision></link>
</model>"""
PLACES = ((-4.0, 0.0), (0.0, 9.5))
EVIDENCE = Path(__file__).resolve().parents[3] / "docs" / "evidence"
RUNS = (
    *[MapRun(True, False, "reached", 0.5)] * 95,
    MapRun(False, True, "collided", 0.0),
    MapRun(False, False, UNREACHABLE, 0.0),
    MapRun(False, False, LOST, 0.0),
    *[MapRun(False, False, "timeout", 0.0)] * 2,
)


def judged(maps: str, noise: str, runs: tuple[MapRun, ...] = RUNS) -> MapResult:
    return result(MapSet(maps, 1.0, ()), noise, runs)


@pytest.fixture
def gazebo(tmp_path: Path) -> Path:
    models = "".join(CYLINDER.format(n=n, x=x, y=y) for n, (x, y) in enumerate(PLACES))
    plane = "<model name='ground_plane'><link name='link'/></model>"
    path = tmp_path / "world_0.world"
    path.write_text(f"<sdf><world name='default'>{plane}{models}</world></sdf>", encoding="utf-8")
    return path


def test_cylinders_are_scaled_and_other_models_left_out(gazebo: Path) -> None:
    assert cylinders(gazebo, 0.5) == "-2.00000,0.00000,0.03750\n0.00000,4.75000,0.03750\n"


def test_world_has_the_cylinders_and_a_way_to_the_goal_behind_them(gazebo: Path) -> None:
    (world,) = barn_worlds(gazebo.parent, 1.0)
    discs = [one for one in world.obstacles if isinstance(one, WorldCircle)]
    assert [one.radius_m for one in discs] == [0.075, 0.075]
    assert world.goal.y_m > max(one.y_m for one in discs)
    assert world.shortest_path_m == pytest.approx(7.1, abs=0.05)


def test_call_without_maps_says_what_to_give(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert published_maps_main(["--barn", str(tmp_path)]) == 2
    assert "give --barn or --moving-ai" in capsys.readouterr().err


def test_file_that_is_no_xml_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken = tmp_path / "world_7.world"
    broken.write_text("<sdf>", encoding="utf-8")
    assert published_maps_main(["--barn", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith(f"{broken}:1: xml: not a Gazebo world: ")


def test_each_trial_is_counted_by_its_end() -> None:
    one = judged("BARN", "default")
    assert (one.trials, one.arrived, one.touched) == (100, 95, 1)
    assert (one.unreachable, one.lost, one.other) == (1, 1, 2)
    assert one.score == pytest.approx(0.475)
    assert one.score_interval.low < 0.475 < one.score_interval.high


@each(
    ("maps", "noise", "verdict"),
    [
        ("Moving AI", "none", ("arrives 100 %", "missed")),
        ("Moving AI", "default", ("arrives ≥ 99 %", "missed")),
        ("Moving AI", "lossy", ("-", "-")),
        ("BARN", "lossy", ("score ≥ 0.48", "missed")),
    ],
)
def test_row_says_what_was_wanted(maps: str, noise: str, verdict: tuple[str, str]) -> None:
    assert cells(judged(maps, noise))[-2:] == verdict
    arrived = judged(maps, noise, RUNS[:90])
    assert cells(arrived)[-1] in ("met", "-")
    assert cells(arrived)[2:4] == ("90 of 90", "100.0 [95.9, 100.0]")


def test_committed_page_has_the_table_of_the_committed_results() -> None:
    found = read_evidence(EVIDENCE).maps
    assert len(found) == 8
    page = (EVIDENCE / "published-maps.md").read_text(encoding="utf-8")
    assert with_table(page, table(found)) == page


def test_page_without_markers_is_refused() -> None:
    with pytest.raises(ValueError, match="add both where the text goes"):
        with_table("# Page", "table")


def test_results_and_page_are_written(
    gazebo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(published_maps, "SCALES", (0.55,))
    page = tmp_path / "page.md"
    page.write_text("<!-- published-maps:begin -->\nold\n<!-- published-maps:end -->\n")
    files = ["--output", str(tmp_path / "published-maps.json"), "--page", str(page)]
    assert published_maps_main(["--barn", str(gazebo.parent), "--noise", "none", *files]) == 0
    (one,) = read_evidence(tmp_path).maps
    assert (one.maps, one.scale, one.noise, one.trials, one.arrived) == ("BARN", 0.55, "none", 1, 1)
    assert table([one]) in page.read_text()
    assert "old" not in page.read_text()
    page.write_text("<!-- published-maps:begin --><!-- published-maps:end -->\n")
    assert published_maps_main(["--results", files[1], "--page", str(page)]) == 0
    assert table([one]) in page.read_text()


def test_commits_to_a_folder_before_its_move_count() -> None:
    assert "verification/same_bits" in former_paths("checks/same_bits")
    assert "ground/gateway" in former_paths("gateways")
    assert "verification" not in former_paths("checks/same_bits"), "those of its neighbours"
    assert list(former_paths("plant")) == []
