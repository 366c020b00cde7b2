"""The processes of `up` are recognised in `ps` and `top`."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from ground.launch.child_command import command, role_of
from tests.support.each import each


@each(
    ("words", "role"),
    [
        (["run", "robot", "--id", "r2", "--connect", "tcp/h:1"], "robot r2"),
        (["rec", "start", "runs", "--connect", "tcp/h:1", "--id", "r1"], "recorder r1"),
        (["run", "plant", "--world", "box"], "plant"),
        (["run", "router", "--listen", "tcp/h:1"], "router"),
        (["nonsense"], "sidestep"),
        (["run", "robot", "--id"], "robot"),
    ],
)
def test_the_role_names_the_robot(words: list[str], role: str) -> None:
    assert role_of(words) == role


def test_the_command_line_shows_the_verb_and_no_program_text() -> None:
    python, safe, script, parent, *verb = command(["robot", "--id", "r2"], 7)
    assert (python, safe, parent) == (sys.executable, "-P", "7")
    assert Path(script).name == "sidestep_process.py"
    assert verb == ["run", "robot", "--id", "r2"]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux has such names")
def test_the_process_has_the_name_of_its_role(tmp_path: Path) -> None:
    (tmp_path / "json.py").write_text("raise SystemExit(9)")
    words = command(["completion", "bash"], os.getpid())
    done = subprocess.run(words, capture_output=True, cwd=tmp_path, check=False)
    assert done.returncode == 0
    code = (
        "import sys; from ground.launch.child_command import set_process_name;"
        " set_process_name('robot r1 and more');"
        " print(open('/proc/self/comm').read(), end='')"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout == "robot r1 and mo\n"
