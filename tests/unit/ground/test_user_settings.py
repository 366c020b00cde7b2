"""The user's settings: each fault has its line and a fix, and a change keeps the comments."""

import json
from pathlib import Path

import pytest

from ground.app import start
from ground.app.appearance import appearance_of
from ground.cli.main import main, parse
from ground.cli.options import common_of
from ground.user.settings import Settings, load_settings, set_setting, settings_file, unset_setting
from runtime.errors import ConfigError, UserError
from tests.support.each import each
from tests.support.ground.runs import written

LAB = '[contexts.lab]\nconnect = "tcp/10.0.0.5:7447"\nid = "r2"\n'
COLOURS = {"TERM": "xterm-256color", "LANG": "C.UTF-8"}


@pytest.fixture(autouse=True)
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    settings_file().parent.mkdir()
    return settings_file()


def test_without_a_file_all_settings_have_their_defaults() -> None:
    assert load_settings() == Settings()
    assert settings_file().name == "config.toml"


@each(
    ("text", "line", "words"),
    [
        ('\nthema = "dark"', 2, "unknown key; did you mean 'theme'?"),
        ('# my colours\ntheme = "drak"', 2, "choose one of dark, light"),
        ("hz = 3", 1, "choose one of 2, 5, 10, 20"),
        ("hz = nan", 1, "is not finite"),
        ('bell = "no"', 1, "expected `bool`"),
        ("startup = [1]", 1, "expected `str`"),
        ('context = "lab"', 1, "no such context: 'lab'"),
        (f'{LAB}idd = "r2"', 4, "did you mean 'id'?"),
        ('[contexts.lab]\nid = "r1"', 1, "neither connect nor config"),
        ('[contexts.lab]\nconnect = "h:1"', 2, "write it as tcp/"),
        ('[contexts.lab]\nconnect = "tcp/h:1"\nid = "a/b"', 3, "robot name"),
    ],
)
def test_a_fault_has_its_line_its_key_and_a_fix(
    file: Path, text: str, line: int, words: str
) -> None:
    file.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_settings()
    assert str(caught.value).startswith(f"{file}:{line}: ")
    assert words in str(caught.value)


def test_invalid_toml_has_its_line(file: Path) -> None:
    file.write_text('theme = "dark"\nhz = \n')
    with pytest.raises(ConfigError, match=r"line 2, .*; correct the TOML syntax there"):
        load_settings()


def test_settings_nested_too_deeply_are_refused(file: Path) -> None:
    file.write_text("a = " + "[" * 100_000)
    with pytest.raises(ConfigError, match="nested too deeply"):
        load_settings()


def test_a_faulty_key_has_its_line_in_both_files(file: Path, tmp_path: Path) -> None:
    text = '# keys\n[keys]\nhold = "P"\nhodl = "x"\n'
    keys = tmp_path / "keys.toml"
    for path in (file, keys):
        path.write_text(text)
    for words in ([], ["--keys", str(keys)]):
        with pytest.raises(ConfigError, match=r"\.toml:4: keys\.hodl: .* did you mean 'hold'"):
            start.keymap_of(parse(["ground", *words]), load_settings())


def test_keys_of_the_settings_are_used(file: Path) -> None:
    file.write_text('[keys]\nhold = "P"\n')
    assert start.keymap_of(parse(["ground"]), load_settings())["hold"].keys == ("P",)


def test_an_option_wins_over_the_settings_and_these_over_the_terminal(file: Path) -> None:
    file.write_text('theme = "light"\nhz = 5\nbell = false\nstartup = ["layers trail"]\n')
    found = appearance_of(parse(["ground"]), load_settings(), COLOURS)
    assert (found.theme, found.hz, found.quiet_bell) == ("light", 5.0, True)
    assert found.startup == ("layers trail",)
    words = ["ground", "--theme", "contrast", "--hz", "20"]
    found = appearance_of(parse(words), load_settings(), COLOURS)
    assert (found.theme, found.hz) == ("contrast", 20.0)
    assert appearance_of(parse(["ground"]), Settings(), COLOURS).theme == "dark"


@pytest.mark.parametrize(
    ("more", "theme"),
    [
        ({"NO_COLOR": "1"}, "mono"),
        ({"TERM": "linux"}, "ansi"),
        ({"TERM": "screen"}, "ansi"),
        ({"TERM": "screen", "COLORTERM": "truecolor"}, "light"),
    ],
)
def test_the_theme_of_the_settings_needs_a_terminal_with_colours(
    more: dict[str, str], theme: str
) -> None:
    found = appearance_of(parse(["ground"]), Settings(theme="light"), COLOURS | more)
    assert found.theme == theme


@pytest.mark.parametrize(
    ("locale", "is_ascii"),
    [("C", True), ("de_DE.ISO-8859-1@euro", True), ("de_DE.utf8", False), ("de_DE", False)],
)
def test_without_unicode_only_ascii_is_drawn(locale: str, *, is_ascii: bool) -> None:
    environment = COLOURS | {"LC_ALL": locale}
    assert appearance_of(parse(["ground"]), Settings(), environment).ascii_only is is_ascii


def test_the_app_does_not_open_on_a_dumb_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXTUAL_DRIVER", "browser")
    monkeypatch.setenv("TERM", "dumb")
    assert start.has_screen()
    monkeypatch.delenv("TEXTUAL_DRIVER")
    assert not start.has_screen()


def test_a_theme_is_remembered_only_where_it_was_visible(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TERM", "linux")
    monkeypatch.delenv("COLORTERM", raising=False)
    monkeypatch.delenv("NO_COLOR", raising=False)
    start.remember_theme("light")
    assert not file.exists()
    monkeypatch.setenv("TERM", "xterm-256color")
    start.remember_theme("light")
    assert load_settings().theme == "light"


def test_a_change_keeps_comments_and_order(file: Path) -> None:
    file.write_text(f'# mine\ntheme = "dark"  # at night\n\n# the lab\n{LAB}')
    set_setting("theme", "light")
    set_setting("hz", "5")
    set_setting("contexts.lab.id", "r3")
    set_setting("contexts.yard.connect", "tcp/h:1")
    assert file.read_text() == (
        '# mine\ntheme = "light"  # at night\n\n# the lab\nhz = 5\n\n'
        '[contexts.lab]\nconnect = "tcp/10.0.0.5:7447"\nid = "r3"\n'
        '\n[contexts.yard]\nconnect = "tcp/h:1"\n'
    )


def test_key_of_very_many_parts_is_refused_at_once(file: Path) -> None:
    """The scanner's time and memory grow with their square: `bench fuzz` found it."""
    for text in (f"{'a.' * 60_000}a = 1\n", f"theme = 'dark'\n{'x' * 1_000_001} = 1\n"):
        file.write_text(text)
        for change in (lambda: set_setting("theme", "light"), lambda: unset_setting("context")):
            with pytest.raises(UserError, match=f"{file}: .*(parts|larger)"):
                change()
        assert file.read_text() == text
    file.write_text("")
    with pytest.raises(UserError, match="is not a key"):
        set_setting("a." * 60_000 + "a", "1")
    with pytest.raises(UserError, match="the value of theme: A key has more than"):
        set_setting("theme", "{" + "a." * 60_000 + "a = 1}")


@each(
    ("key", "value"),
    [("theme", "drak"), ("them", "dark"), ("hz", "7"), ("hz.x", "1"), ("a b", "1"), ("bell", "2")],
)
def test_an_invalid_change_leaves_the_file_as_it_was(file: Path, key: str, value: str) -> None:
    file.write_text(LAB)
    with pytest.raises(UserError):
        set_setting(key, value)
    assert file.read_text() == LAB


def test_a_value_over_several_lines_is_set_too(file: Path) -> None:
    file.write_text('startup = [\n  "layers trail",\n]  # mine\n')
    set_setting("startup", "[]")
    assert file.read_text() == "startup = []  # mine\n"


def test_a_key_below_a_value_is_refused(file: Path) -> None:
    file.write_text("hz = 5\n")
    with pytest.raises(UserError, match=r"hz\.x: hz is a value"):
        set_setting("hz.x", "1")
    assert file.read_text() == "hz = 5\n"


def test_a_fault_can_be_mended_by_a_change(file: Path) -> None:
    file.write_text('theme = "drak"\n')
    set_setting("theme", "light")
    assert load_settings().theme == "light"


def test_a_key_is_removed(file: Path) -> None:
    file.write_text(f'context = "lab"\n{LAB}')
    unset_setting("context")
    assert file.read_text() == LAB
    unset_setting("context")
    assert file.read_text() == LAB


def test_a_link_to_the_file_is_kept(file: Path, tmp_path: Path) -> None:
    target = tmp_path / "dotfiles.toml"
    target.write_text("")
    file.symlink_to(target)
    set_setting("theme", "light")
    assert target.read_text() == 'theme = "light"\n'
    assert file.is_symlink()


def test_a_context_names_endpoint_robot_and_certificates(file: Path) -> None:
    file.write_text(LAB)
    found = common_of(parse(["hold", "--context", "lab"]))
    assert (found.endpoint, found.robot) == ("tcp/10.0.0.5:7447", "r2")
    assert found.source == "context lab at tcp/10.0.0.5:7447"
    assert common_of(parse(["hold", "--context", "lab", "--id", "r5"])).robot == "r5"
    with pytest.raises(UserError, match=r"--context lob: no such context .*known: lab"):
        common_of(parse(["hold", "--context", "lob"]))


def test_a_context_may_name_a_file_beside_the_settings(file: Path) -> None:
    file.write_text('[contexts.lab]\nconfig = "lab.toml"\n')
    file.with_name("lab.toml").write_text('[network]\nconnect = ["tcp/h:5"]\n')
    assert common_of(parse(["hold", "--context", "lab"])).endpoint == "tcp/h:5"


def test_the_context_in_force_wins_over_a_run(file: Path) -> None:
    written()
    file.write_text(LAB)
    assert common_of(parse(["hold"])).endpoint == "tcp/127.0.0.1:53985"
    assert main(["config", "context", "lab"]) == 0
    assert common_of(parse(["hold"])).endpoint == "tcp/10.0.0.5:7447"
    assert common_of(parse(["hold", "--run", "box"])).endpoint == "tcp/127.0.0.1:53985"
    assert main(["config", "context", "--none"]) == 0
    assert common_of(parse(["hold"])).endpoint == "tcp/127.0.0.1:53985"


def test_an_endpoint_that_is_given_needs_no_settings(file: Path) -> None:
    file.write_text("nonsense\n")
    assert common_of(parse(["estop", "--connect", "tcp/h:1"])).endpoint == "tcp/h:1"
    with pytest.raises(ConfigError, match="line 1"):
        common_of(parse(["estop"]))


def test_config_shows_and_sets(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "path"]) == 0
    assert main(["config", "set", "theme", "light"]) == 0
    assert main(["config", "get", "theme"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        str(file),
        f"{file}: theme = light",
        "light",
    ]
    assert main(["config", "get", "--json"]) == 0
    settings = json.loads(capsys.readouterr().out)["settings"]
    assert (settings["theme"], settings["hz"], settings["bell"]) == ("light", 10.0, True)
    assert main(["config", "get"]) == 0
    assert 'theme = "light"' in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["get", "them"], "did you mean 'theme'?"),
        (["get", "theme.x"], "there is no such setting"),
        (["set", "keys.hodl", "P"], "did you mean 'hold'?"),
        (["set", "keys.hold", "g"], "'g' is already used by goal"),
        (["context", "lob"], "no such context: 'lob'"),
    ],
)
def test_config_refuses_with_the_fix(
    words: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["config", *words]) == 2
    assert why in capsys.readouterr().err
