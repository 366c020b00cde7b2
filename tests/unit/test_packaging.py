"""Pins, hashes, the build of wheel and images, and `make setup`."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from hashlib import sha256
from importlib.metadata import packages_distributions, requires
from pathlib import Path
from shutil import which
from zipfile import ZipFile

import pytest
import yaml
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import Version

import hatch_build
from checks.built import FOLDER, LISTS, MACHINES, PYTHONS, RUNTIME, needed, wanted_in
from checks.built import ROOT as BUILT_ROOT
from runtime.cli.packages import PACKAGES
from tests.support import images
from tests.support.each import each


@pytest.fixture
def docker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the path of a command `docker` that is the only one."""
    monkeypatch.setenv("PATH", str(tmp_path))
    return tmp_path / "docker"


def plays(docker: Path, script: str) -> None:
    docker.write_text(f"#!/bin/sh\n{script}\n")
    docker.chmod(0o755)


def test_missing_client_is_named(docker: Path) -> None:
    with pytest.raises(images.NoEngineError, match="no docker on this machine"):
        images.require_engine(0.0)


def test_client_without_an_engine_is_named_with_its_words(docker: Path) -> None:
    plays(docker, 'echo "Cannot connect to the Docker daemon"; exit 1')
    with pytest.raises(images.NoEngineError, match="docker info: Cannot connect to the Docker"):
        images.require_engine(0.0)


def test_missing_base_image_is_named(docker: Path) -> None:
    plays(docker, 'case $1 in image|pull) echo "no route to registry"; exit 1;; esac')
    base = images.base_image()
    with pytest.raises(images.NoEngineError, match=f"no base image {base}: .*no route"):
        images.require_engine(0.0)


def test_base_image_that_appears_is_waited_for(docker: Path) -> None:
    plays(
        docker,
        'case $1 in image|pull) [ -e "$0.base" ] || { : >"$0.base"; exit 1; };; esac',
    )
    images.require_engine(60.0)


def test_image_of_the_product_is_made_of_what_the_dockerfile_copies() -> None:
    lines = (BUILT_ROOT / "Dockerfile").read_text().splitlines()
    of_tree = [line for line in lines if line.startswith("COPY ") and "--from=" not in line]
    words = [word for line in of_tree for word in line.split()[1:-1]]
    copied = {word.rstrip("/") for word in words if (BUILT_ROOT / word).exists() and word != "."}
    assert {name.partition("/")[0] for name in copied} <= set(images.PRODUCT)
    found = {path.relative_to(BUILT_ROOT).as_posix() for path in images.context("runtime")}
    assert {"Dockerfile", "docker/install", "robot/core/brain.py"} <= found
    assert found < {path.relative_to(BUILT_ROOT).as_posix() for path in images.context("tests")}


ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
FLOORS = [
    *PROJECT["build-system"]["requires"],
    *PROJECT["project"]["dependencies"],
    *PROJECT["project"]["optional-dependencies"]["dev"],
]
CHECKOUT_ONLY = {"checks", "examples", "tests"}
PIN = re.compile(r"(?P<name>[A-Za-z0-9._-]+)==(?P<version>[A-Za-z0-9.]+)")


def pins() -> dict[str, Version]:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    found = [PIN.fullmatch(line) for line in lines if line and not line.startswith("#")]
    assert all(found), "constraints.txt holds exact versions only: no hosts, no hashes"
    return {canonicalize_name(pin["name"]): Version(pin["version"]) for pin in found if pin}


@each("text", FLOORS)
def test_requirements_are_pinned_at_or_above_their_minimum(text: str) -> None:
    wanted = Requirement(text)
    assert pins()[canonicalize_name(wanted.name)] in wanted.specifier


def test_make_looks_for_the_pythons_the_package_accepts() -> None:
    makefile = (ROOT / "Makefile").read_text()
    accepted = SpecifierSet(PROJECT["project"]["requires-python"])
    named = re.findall(r"python(3\.\d+)", re.findall(r"PYTHONS := (.*)", makefile)[0])
    assert named
    assert all(f"{version}.0" in accepted for version in named)


def test_every_package_is_in_the_wheel_or_excluded() -> None:
    packages = {path.parent.name for path in ROOT.glob("*/__init__.py")}
    wheel = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert set(wheel["only-include"]) == packages - CHECKOUT_ONLY
    assert set(PACKAGES) == packages - CHECKOUT_ONLY
    assert set(PROJECT["tool"]["importlinter"]["root_packages"]) == packages - {"tests", "examples"}


def test_extras_serve_packages_of_the_wheel() -> None:
    extras = PROJECT["project"]["optional-dependencies"]
    assert set(extras) - {"dev", "docs"} == {
        *("study", "dask", "foxglove", "keys", "pandas", "ros2", "web")
    }
    needed = {name for extra in set(extras) - {"dev"} for name in extras[extra]}
    assert needed <= set(extras["dev"])


WITHOUT_EXTRAS = """
import sys
from runtime.cli.parsers import parser_of, program_parsers
from runtime.cli.verb_table import VERBS

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in sys.argv[1:]:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
for verb in VERBS:
    try:
        parser_of(verb), program_parsers(verb)
    except ModuleNotFoundError as error:
        print(verb, error.name)
"""


def test_only_study_needs_an_extra_to_start() -> None:
    extras = PROJECT["project"]["optional-dependencies"]
    named = {
        Requirement(line).name for extra in set(extras) - {"dev", "docs"} for line in extras[extra]
    }
    modules = {top for top, owners in packages_distributions().items() if named & set(owners)}
    assert {"aiohttp", "textual_serve", "pyarrow"} <= modules
    words = (sys.executable, "-c", WITHOUT_EXTRAS, *sorted(modules))
    found = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout == "study pyarrow\n"  # its own error says how to install it


def test_released_wheels_fit_every_python_and_machine() -> None:
    jobs = yaml.safe_load((ROOT / ".github/workflows/wheels.yml").read_text())["jobs"]
    steps = jobs["compiled"]["steps"]
    (settings,) = (step["env"] for step in steps if "cibuildwheel" in step.get("uses", ""))
    names = [f"cp{python.replace('.', '')}-manylinux_*" for python in PYTHONS]
    assert settings["CIBW_BUILD"].split() == names
    machines = {row["machine"] for row in jobs["compiled"]["strategy"]["matrix"]["include"]}
    assert machines == set(MACHINES)
    assert settings["CIBW_ENVIRONMENT"] == f"{hatch_build.SWITCH}=1"


def test_the_image_is_built_of_what_the_wheel_carries() -> None:
    wheel = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]
    copied = re.findall(r"^COPY (\w+) \1$", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
    assert set(copied) == set(wheel["only-include"])


def test_the_gate_calls_the_command_the_readme_gives() -> None:
    assert "make test" in (ROOT / ".ci" / "run").read_text()
    assert "make test" in (ROOT / "README.md").read_text()


@each("place", ["constraints.txt", "Makefile", "pyproject.toml", ".ci/run"])
def test_no_file_names_a_package_host_or_a_private_path(place: str) -> None:
    private = r"index-url|find-links|https?://|/root/|/home/"
    assert not re.search(private, (ROOT / place).read_text())


ENTRY = re.compile(r"([a-z0-9-]+)==(\S+)((?: \\\n    --hash=sha256:[0-9a-f]{64})+)\n")


def entries(name: str) -> dict[str, tuple[str, int]]:
    """Return version and number of hashes of each package of a list, the common one included."""
    text = (FOLDER / f"{name}.txt").read_text()
    assert ENTRY.sub("", text).splitlines()[1:] == ([] if name == RUNTIME else ["-r runtime.txt"])
    found = {
        name: (version, hashes.count("--hash")) for name, version, hashes in ENTRY.findall(text)
    }
    return found if name == RUNTIME else found | entries(RUNTIME)


class Installed(dict[str, list[Requirement]]):
    """What each installed package requires."""

    def __missing__(self, name: str) -> list[Requirement]:
        self[name] = [Requirement(text) for text in requires(name) or ()]
        return self[name]


@each("name", list(LISTS))
def test_list_has_all_that_is_needed_in_the_pinned_version(name: str) -> None:
    listed, pinned = entries(name), pins()
    environment = {key: str(value) for key, value in default_environment().items()}
    assert needed(wanted_in(name), Installed(), environment) <= set(listed)
    assert {package: str(pinned[package]) for package in listed} == {
        package: version for package, (version, _) in listed.items()
    }


def test_tests_have_all_pins() -> None:
    assert set(entries("tests")) == set(pins())


def test_file_of_each_machine_is_listed() -> None:
    for package in ("numpy", "eclipse-zenoh", "msgspec", "lxml"):  # none is a pure one
        assert entries(RUNTIME)[package][1] >= len(MACHINES)


def wheel(folder: Path) -> Path:
    """Make a package of one module."""
    path = folder / "changed-1.0-py3-none-any.whl"
    info = "changed-1.0.dist-info"
    with ZipFile(path, "w") as file:
        file.writestr("changed.py", "WORD = 'as it was published'\n")
        file.writestr(f"{info}/METADATA", "Metadata-Version: 2.1\nName: changed\nVersion: 1.0\n")
        file.writestr(
            f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        )
        file.writestr(f"{info}/RECORD", f"changed.py,,\n{info}/METADATA,,\n{info}/WHEEL,,\n")
    return path


def installed(folder: Path, requirement: str) -> subprocess.CompletedProcess[str]:
    """Install as the images do: by docker/install, with another pip, from a folder."""
    (folder / "list.txt").write_text(requirement)
    script = (ROOT / "docker" / "install").read_text()
    pip = f"{sys.executable} -m pip --isolated"
    assert script.count("/pip/bin/pip") == 1
    (folder / "install").write_text(script.replace("/pip/bin/pip", pip))
    words = ("--python", sys.executable, "--no-index", "--find-links", str(folder))
    target = ("--target", str(folder / "target"), "-r", str(folder / "list.txt"))
    return subprocess.run(
        ["sh", str(folder / "install"), *words, *target],
        capture_output=True,
        text=True,
        check=False,
    )


def test_changed_package_is_refused(tmp_path: Path) -> None:
    path = wheel(tmp_path)
    listed = f"changed==1.0 \\\n    --hash=sha256:{sha256(path.read_bytes()).hexdigest()}\n"
    done = installed(tmp_path, listed)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "target" / "changed.py").exists()
    shutil.rmtree(tmp_path / "target")
    data = bytearray(path.read_bytes())
    data[data.index(b"published")] ^= 1
    path.write_bytes(data)
    done = installed(tmp_path, listed)
    assert done.returncode != 0
    assert "DO NOT MATCH THE HASHES" in done.stderr
    assert not (tmp_path / "target").exists()


def test_package_without_a_hash_is_refused(tmp_path: Path) -> None:
    wheel(tmp_path)
    done = installed(tmp_path, "changed==1.0\n")
    assert done.returncode != 0
    assert "--hash" in done.stderr


def test_impostor_of_a_listed_package_is_refused(tmp_path: Path) -> None:
    text = (FOLDER / f"{RUNTIME}.txt").read_text()
    (found,) = (one for one in ENTRY.finditer(text) if one[1] == "mdurl")
    name = f"{canonicalize_name(found[1])}-{found[2]}-py3-none-any.whl"
    wheel(tmp_path).rename(tmp_path / name)
    done = installed(tmp_path, found[0])
    assert done.returncode != 0
    assert "DO NOT MATCH THE HASHES" in done.stderr


def test_images_install_nothing_without_hashes() -> None:
    lines = (ROOT / "Dockerfile").read_text().replace("\\\n", " ").splitlines()
    runs = [line for line in lines if re.search(r"\b(install|pip\w*) ", line) and "pip" in line]
    for line in runs:
        for words in re.findall(
            r"(?:pip|pip3) (?:--python \S+ )?(?:install|wheel|download) ([^&]*)", line
        ):
            assert "--no-index" in words or "--no-build-isolation" in words, line
    lists = re.findall(r"\./install .*?-r (\w+)\.txt", "\n".join(lines))
    assert sorted(lists) == sorted(LISTS)
    assert "--require-hashes" in (ROOT / "docker" / "install").read_text()


@pytest.mark.parametrize(("value", "wanted"), [("", False), ("0", False), ("1", True)])
def test_only_the_value_1_compiles(
    monkeypatch: pytest.MonkeyPatch, value: str, wanted: bool
) -> None:
    monkeypatch.setenv(hatch_build.SWITCH, value)
    assert hatch_build.is_wanted() is wanted


@pytest.mark.parametrize("value", ["yes", "2", " 1"])
def test_another_value_of_the_switch_is_refused(
    monkeypatch: pytest.MonkeyPatch, value: str
) -> None:
    monkeypatch.setenv(hatch_build.SWITCH, value)
    with pytest.raises(SystemExit, match=f"SIDESTEP_COMPILE={value}: use 1 to compile"):
        hatch_build.is_wanted()


def test_a_missing_compiler_is_named_with_the_package_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler -O2")
    with pytest.raises(SystemExit, match="no C compiler 'no-such-compiler': install gcc"):
        hatch_build.check_compiler()


def test_missing_headers_of_python_are_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("CC", "sh")
    monkeypatch.setattr("sysconfig.get_paths", lambda: {"include": str(tmp_path)})
    with pytest.raises(SystemExit, match="install python3-dev"):
        hatch_build.check_compiler()


def test_a_pattern_without_a_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"no file matches modules = 'robot/cor/\*.py'"):
        hatch_build.sources_in(tmp_path, ["robot/cor/*.py"])


def test_modules_of_other_sources_are_refused(tmp_path: Path) -> None:
    sources = ["runtime/elementary.py"]
    (tmp_path / hatch_build.HASHES).write_text(json.dumps(hatch_build.hashes(ROOT, sources)))
    hatch_build.check(tmp_path, ROOT, sources)
    with pytest.raises(SystemExit, match="are those of other sources"):
        hatch_build.check(tmp_path, ROOT, [*sources, "robot/core/brain.py"])
    with pytest.raises(SystemExit, match="are those of other sources"):
        hatch_build.check(tmp_path / "nowhere", ROOT, sources)


def test_the_modules_named_in_the_project_are_found() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    hooks = project["tool"]["hatch"]["build"]["targets"]["wheel"]["hooks"]
    sources = hatch_build.sources_in(ROOT, hooks["custom"]["modules"])
    assert {"robot/core/brain.py", "plant/sim/sonar.py"} <= set(sources)
    assert not [name for name in sources if name.endswith("__init__.py")]


def test_sources_reach_what_they_import() -> None:
    paths = hatch_build.reached(ROOT, ["study/trial/core_loop.py"])
    found = {path.relative_to(ROOT).as_posix() for path in paths}
    assert {"study/trial/core_loop.py", "robot/core/brain.py", "robot/core/__init__.py"} <= found
    assert not [name for name in found if name.startswith("ground/")]


@pytest.mark.skipif(which("git") is None, reason="no git on this machine")
def test_the_commit_is_known_in_a_checkout_only(tmp_path: Path) -> None:
    assert hatch_build.commit_of(tmp_path) == "unknown"

    def git(*words: str) -> str:
        author = ("-c", "user.name=A", "-c", "user.email=a@b", "-c", "commit.gpgsign=false")
        run = ("git", "-C", str(tmp_path), *author, *words)
        return subprocess.run(run, check=True, capture_output=True, text=True).stdout.strip()

    git("init", "--quiet")
    assert hatch_build.commit_of(tmp_path) == "unknown"
    (tmp_path / "a.py").write_text("x = 1\n")
    git("add", "a.py")
    git("commit", "--quiet", "-m", "a")
    (tmp_path / "untracked").touch()
    assert hatch_build.commit_of(tmp_path) == git("rev-parse", "HEAD")
    (tmp_path / "a.py").write_text("x = 2\n")
    assert hatch_build.commit_of(tmp_path) == git("rev-parse", "HEAD") + "+"


FINISHED = "sidestep 0.1.0"

PYTHON = f"""#!/bin/sh
case "$*" in
    *"-m venv"*) ;;
    *) exec {sys.executable} "$@" ;;
esac
echo "venv" >>asked
mkdir -p .venv/bin
cp env_python .venv/bin/python
printf '#!/bin/sh\\necho {FINISHED}\\n' >.venv/bin/sidestep
chmod +x .venv/bin/sidestep
"""
ENV_PYTHON = """#!/bin/sh
echo "$*" >>asked
echo "words of pip"
[ ! -e broken ]
"""
WITHOUT_VENV = f"""#!/bin/sh
case "$*" in
    *ensurepip*) exit 1 ;;
    *) exec {sys.executable} "$@" ;;
esac
"""


def executable(path: Path, text: str) -> None:
    path.write_text(text)
    path.chmod(0o755)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    folder = tmp_path / "tree"
    folder.mkdir()
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, folder)
    executable(folder / "fake_python", PYTHON)
    executable(folder / "env_python", ENV_PYTHON)
    return folder


def make(folder: Path, pythons: str = "./fake_python") -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("MAKE", "MFLAGS"))}
    return subprocess.run(
        ["make", "setup", f"PYTHONS={pythons}"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def asked(folder: Path) -> list[str]:
    """Return the calls since the last time, in short: venv, or what pip was to install."""
    lines = (folder / "asked").read_text().splitlines() if (folder / "asked").exists() else []
    (folder / "asked").unlink(missing_ok=True)
    return [line.partition("constraints.txt ")[2] or line for line in lines]


INSTALLS = ["hatchling editables", "--no-build-isolation -e .[dev]"]


def test_first_setup_does_everything_and_hides_pip_output(tree: Path) -> None:
    run = make(tree)
    assert (run.returncode, run.stderr) == (0, "")
    assert asked(tree) == ["venv", *INSTALLS]
    assert FINISHED in run.stdout
    assert "words of pip" not in run.stdout


def test_second_setup_does_nothing(tree: Path) -> None:
    make(tree)
    asked(tree)
    assert make(tree).returncode == 0
    assert asked(tree) == []


@pytest.mark.parametrize("changed", ["constraints.txt", "pyproject.toml"])
def test_after_a_change_only_pip_runs(tree: Path, changed: str) -> None:
    make(tree)
    asked(tree)
    soon = (tree / ".venv" / "ready").stat().st_mtime + 1
    os.utime(tree / changed, (soon, soon))
    assert make(tree).returncode == 0
    assert asked(tree) == INSTALLS


def test_pip_failure_is_shown_and_setup_repeated_next_time(tree: Path) -> None:
    (tree / "broken").touch()
    run = make(tree)
    assert run.returncode == 2
    assert "words of pip" in run.stderr
    assert "pip could not install hatchling editables" in run.stderr
    asked(tree)
    (tree / "broken").unlink()
    assert make(tree).returncode == 0
    assert asked(tree) == ["venv", *INSTALLS]


def test_a_tree_that_was_moved_is_set_up_afresh(tree: Path) -> None:
    make(tree)
    asked(tree)
    moved = tree.rename(tree.parent / "elsewhere")
    assert make(moved).returncode == 0
    assert asked(moved) == ["venv", *INSTALLS]


def test_an_environment_whose_python_is_gone_is_made_afresh(tree: Path) -> None:
    make(tree)
    asked(tree)
    (tree / ".venv" / "bin" / "python").unlink()
    assert make(tree).returncode == 0
    assert asked(tree) == ["venv", *INSTALLS]


def test_missing_python_is_reported_with_what_to_install(tree: Path) -> None:
    executable(tree / "old", "#!/bin/sh\nexit 1\n")
    run = make(tree, pythons="./old python-not-there")
    assert run.returncode == 2
    assert "no Python from 3.11 to 3.13" in run.stderr
    assert "apt install python3 python3-venv" in run.stderr
    assert not (tree / ".venv").exists()


def test_python_without_venv_is_reported_with_its_package(tree: Path) -> None:
    executable(tree / "python3.12", WITHOUT_VENV)
    run = make(tree, pythons="./python3.12")
    assert run.returncode == 2
    assert "apt install ./python3.12-venv" in run.stderr


def test_python_without_venv_is_skipped_for_another(tree: Path) -> None:
    executable(tree / "python3.12", WITHOUT_VENV)
    assert make(tree, pythons="./python3.12 ./fake_python").returncode == 0
