"""Committed findings are driven again: their files follow the present core."""

from pathlib import Path
from shutil import copyfile

import pytest

from checks.site.findings import WORLDS, failing, main, name_of
from runtime.errors import UserError
from study.falsify.findings import read_finding

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
