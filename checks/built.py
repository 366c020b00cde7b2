"""`python -m checks.built WHAT`: what is built once, for all runs and all checkouts.

Results are kept in `$XDG_CACHE_HOME/sidestep/built` (`~/.cache/sidestep/built`) under a key made of
the content of their sources and of the versions of their tools. So a change is built again, a clean
clone of the same sources is not, and neither dates nor commits matter. An entry appears complete
or not at all; one that was damaged later is made again. The tools and the tests use this cache; no
program of the product reads it.

    compiled [FOLDER]   an installation with compiled modules, by default in build/compiled;
                        with --installed nothing is built, and the folder printed if it is there
    firmware [VARIANT]  the firmware of the emulated board, in build/firmware
    hashes              the requirements of the images, with all hashes, in docker

The versions of the images are those of constraints.txt, and what is wanted is in pyproject.toml. Of
each package the files are listed that pip chooses for Linux on both machines with each Python; pip
then refuses every other file, and every package that is not listed. The hashes are those of the
index that pip is configured for.
"""

import argparse
import contextlib
import fcntl
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from re import findall, match
from time import time
from typing import Any, Final, NamedTuple
from zipfile import ZipFile

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import hatch_build
from firmware import build, image
from firmware import build as firmware_build
from runtime.errors import UserError

ROOT: Final = Path(__file__).resolve().parents[1]
COMPILED: Final = ROOT / "build" / "compiled"
MARK: Final = "built"
"""The file of an installation that has the key of its wheel."""
LISTED: Final = "files.json"
"""The hash of each file of an entry. Written last, and touched at each use."""
UNFINISHED: Final = "unfinished-"
KEPT: Final = 4
"""Entries of a kind that are kept however long they have not been used."""
IN_USE_S: Final = 3600.0
"""An entry used since then may belong to a process that still runs: it is kept, too."""
BUILD_S: Final = 900.0
CHUNK_BYTES: Final = 1 << 20


class BuildError(Exception):
    """A result could not be built; the message has the output of the failed tool."""


def built(kind: str, key: str, make: Callable[[Path], None]) -> Path:
    """Return the folder of an entry; if it is missing or damaged, let `make` fill a new one.

    `make` is called with an empty folder, which is renamed when it returns: what it writes must not
    depend on the name. Other processes that need an entry of this kind wait meanwhile. A caller
    changes no file of the result.
    """
    kind_folder = cache() / kind
    entry = kind_folder / key
    if not is_complete(entry):
        kind_folder.mkdir(parents=True, exist_ok=True)
        with (kind_folder / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not is_complete(entry):
                _fill(entry, make)
    with contextlib.suppress(OSError):  # only its age is lost
        os.utime(entry / LISTED)
    return entry


def cache() -> Path:
    """Return the folder of the cache, or a temporary one of this user if that is read-only."""
    home = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not home.is_absolute():
        home = Path("~/.cache").expanduser()
    folder = home / "sidestep" / "built"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK)
    except OSError:
        writable = False
    if not writable:
        folder = Path(tempfile.gettempdir()) / f"sidestep-built-{os.getuid()}"
        folder.mkdir(mode=0o700, exist_ok=True)
        if folder.stat().st_uid != os.getuid():
            raise BuildError(f"{folder} belongs to another user: set XDG_CACHE_HOME")
    return folder


def is_complete(entry: Path) -> bool:
    """Return whether each file of an entry has the content that it had when it was made."""
    try:
        listed: dict[str, str] = json.loads((entry / LISTED).read_bytes())
        return all(content_hash(entry / name) == digest for name, digest in listed.items())
    except (OSError, ValueError):
        return False


def content_hash(path: Path) -> str:
    """Return the SHA-256 of a file."""
    digest = sha256()
    with path.open("rb") as file:
        while chunk := file.read(CHUNK_BYTES):
            digest.update(chunk)
    return digest.hexdigest()


def key_of(files: Iterable[Path] = (), *facts: str) -> str:
    """Return the key for the content of files of this tree, the versions of tools, and Python."""
    digest = sha256()
    python = (sys.version, sysconfig.get_config_var("EXT_SUFFIX") or "", sys.base_prefix)
    for fact in (*python, *facts):
        digest.update(f"{fact}\0".encode())
    for path in sorted(files):
        digest.update(f"{path.relative_to(ROOT)}\0{content_hash(path)}\0".encode())
    return digest.hexdigest()[:20]


def _fill(entry: Path, make: Callable[[Path], None]) -> None:
    """Make an entry in a temporary place; remove what was damaged, interrupted or has aged."""
    for left in entry.parent.glob(f"{UNFINISHED}*"):
        shutil.rmtree(left, ignore_errors=True)
    place = Path(tempfile.mkdtemp(prefix=UNFINISHED, dir=entry.parent))
    try:
        make(place)
        files = sorted(path for path in place.rglob("*") if path.is_file())
        listed = {path.relative_to(place).as_posix(): content_hash(path) for path in files}
        (place / LISTED).write_text(json.dumps(listed), encoding="utf-8")
        if entry.exists():
            entry.rename(Path(tempfile.mkdtemp(prefix=UNFINISHED, dir=entry.parent)) / "damaged")
        place.rename(entry)
    finally:
        for left in entry.parent.glob(f"{UNFINISHED}*"):
            shutil.rmtree(left, ignore_errors=True)
    _prune(entry.parent)


def _prune(kind_folder: Path) -> None:
    """Remove the entries of a kind that are neither among the newest nor in use."""
    ages = [(path.stat().st_mtime, path.parent) for path in kind_folder.glob(f"*/{LISTED}")]
    for used, entry in sorted(ages, reverse=True)[KEPT:]:
        if time() - used > IN_USE_S:
            shutil.rmtree(entry, ignore_errors=True)


# Compiled modules, and the wheel that carries them.


def project() -> dict[str, Any]:
    """Return pyproject.toml."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def compiled_sources() -> list[str]:
    """Return the sources that become compiled modules, relative to the root."""
    wheel = project()["tool"]["hatch"]["build"]["targets"]["wheel"]
    return hatch_build.sources_in(ROOT, wheel["hooks"]["custom"]["modules"])


def compiled_modules() -> Path:
    """Return a folder with the compiled modules of this tree, by their names in the wheel.

    Raises SystemExit without a compiler, and BuildError if it fails.
    """
    hatch_build.check_compiler()

    def make(place: Path) -> None:
        print("Compiling; it takes about a minute.", file=sys.stderr, flush=True)
        _run([sys.executable, str(ROOT / "hatch_build.py"), "compile", str(place)])

    return built("compiled", _modules_key(), make)


def _modules_key() -> str:
    """Return the key of the compiled modules of this tree."""
    settings = project()
    wanted = (*hatch_build.TOOLS, *settings["project"]["dependencies"])
    libraries = [f"{name} {_version(name)}" for name in map(_name_of, wanted)]
    sources = compiled_sources()
    facts = [json.dumps([sources, settings["tool"]["mypy"]]), *libraries, *_compiler()]
    return key_of([*hatch_build.reached(ROOT, sources), ROOT / "hatch_build.py"], *facts)


def wheel(*, compiled: bool) -> Path:
    """Return the wheel of this tree, built by pip; a compiled one has the commit in it."""
    modules = compiled_modules() if compiled else None

    def make(place: Path) -> None:
        options = ("--quiet", "--disable-pip-version-check", "--no-deps", "--no-build-isolation")
        words = ["-m", "pip", "wheel", *options, "--no-index", "-w", str(place), str(ROOT)]
        switch = {hatch_build.SWITCH: "" if modules is None else "1"}
        _run([sys.executable, *words], switch | {hatch_build.READY: str(modules or "")})

    entry = built("wheel", _wheel_key(None if modules is None else modules.name), make)
    return next(entry.glob("*.whl"))


def _wheel_key(modules_key: str | None) -> str:
    """Return the key of the wheel of this tree, with these compiled modules."""
    chosen = project()["tool"]["hatch"]["build"]["targets"]["wheel"]["only-include"]
    others = ("pyproject.toml", "README.md", "LICENSE", "hatch_build.py")
    files = [ROOT / name for name in (*chosen, *others)]
    files += [path for folder in files if folder.is_dir() for path in folder.rglob("*")]
    contents = [path for path in files if path.is_file() and path.suffix not in (".pyc", ".so")]
    facts = [f"hatchling {_version('hatchling')}"]
    if modules_key is not None:
        facts += [modules_key, hatch_build.commit_of(ROOT)]
    return key_of(contents, *facts)


def install_compiled(folder: Path) -> Path:
    """Unpack the compiled wheel into a folder, unless it is there; return the folder.

    It belongs before the checkout on the search path.
    """
    source = wheel(compiled=True)
    mark = folder / MARK
    if not mark.exists() or mark.read_text(encoding="utf-8") != source.parent.name:
        shutil.rmtree(folder, ignore_errors=True)
        with ZipFile(source) as archive:
            archive.extractall(folder)
        mark.write_text(source.parent.name, encoding="utf-8")
    return folder


def is_installed(folder: Path) -> bool:
    """Return whether a folder has the compiled installation of this very tree."""
    try:
        key = (folder / MARK).read_text(encoding="utf-8")
    except OSError:
        return False
    return key == _wheel_key(_modules_key())


def _name_of(requirement: str) -> str:
    found = match(r"[\w.-]+", requirement)
    assert found is not None
    return found[0]


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "none"


def _compiler() -> tuple[str, str]:
    """Return the command of the C compiler, and its version."""
    command = os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc"
    return command, _output([command.split()[0], "--version"])


# Firmware


def firmware(variant: str = image.IMAGE.name) -> Path:
    """Return the firmware of this tree in build/firmware; raise UserError if it cannot be built."""
    build.check_tools()
    chosen = image.IMAGES[variant]
    package = ROOT / "firmware"
    roots = [package / "build.py", *image.core_sources().values(), *package.glob("onboard/*.py")]
    sources = hatch_build.reached(ROOT, (path.relative_to(ROOT).as_posix() for path in roots))
    sources |= {*package.glob("port/*"), *(ROOT / "protocol").rglob("*.xml")}
    facts = [project()["project"]["version"], build.TARBALL_SHA256, variant]
    facts += [_output([tool, "--version"]) for tool in ("arm-none-eabi-gcc", "arm-none-eabi-ld")]

    def make(place: Path) -> None:
        tarball = image.OUTPUT / "source" / build.TARBALL
        if not tarball.exists():
            source = built("micropython", build.TARBALL_SHA256[:20], _fetch)
            tarball.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source / build.TARBALL, tarball)
        firmware_build.build(chosen)
        for path in (chosen.elf, chosen.elf.with_suffix(".map")):
            shutil.copy2(path, place)

    entry = built("firmware", key_of(sources, *facts), make)
    chosen.folder.mkdir(parents=True, exist_ok=True)
    for path in entry.iterdir():
        target = chosen.folder / path.name
        if path.name != LISTED and not (
            target.exists() and content_hash(path) == content_hash(target)
        ):
            # Another process may read the old one at this moment.
            shutil.copy2(path, target.with_suffix(f".new-{os.getpid()}"))
            target.with_suffix(f".new-{os.getpid()}").replace(target)
    return chosen.elf


def _fetch(place: Path) -> None:
    """Fetch the source of MicroPython, which is needed once for all states of the core."""
    build.fetch(place / build.TARBALL)
    build.check(place / build.TARBALL)


# Environments of other programs


def environment(name: str, pins: Sequence[str], python: str | None = None) -> Path:
    """Return the Python of a virtual environment with exactly these packages.

    `python` is the command of another version, such as python3.12. Raises BuildError if it is not
    there, or a package cannot be installed. Of the installed commands only those that Python
    is called with work, because they name the place where they were installed.
    """
    interpreter = sys.executable if python is None else python_named(python)
    if interpreter is None:
        raise BuildError(f"{python}: not found")

    def make(place: Path) -> None:
        _run([interpreter, "-m", "venv", "--without-pip", str(place)])
        pip = ("pip", "--disable-pip-version-check", "--no-input", "--python", str(place))
        # Without dependencies: the pins list all, and nothing for a screen.
        _run([sys.executable, "-m", *pip, "install", "--quiet", "--no-deps", *pins])

    return built(f"client-{name}", key_of((), *pins), make) / "bin" / "python"


def python_named(name: str) -> str | None:
    """Return a Python such as python3.12: the newest that pyenv has installed, or of the path."""
    folders = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")).glob("versions/*/bin")
    found = [folder / name for folder in folders if (folder / name).exists()]
    newest = max(
        found,
        key=lambda path: [int(number) for number in findall(r"\d+", path.parts[-3])],
        default=None,
    )
    return shutil.which(name) if newest is None else str(newest)


def node_modules(name: str, pins: Sequence[str]) -> Path:
    """Return a folder `node_modules` with exactly these packages of npm, as NAME@VERSION.

    Raises BuildError if one cannot be fetched.
    """

    def make(place: Path) -> None:
        with tempfile.TemporaryDirectory() as fetched:
            _run(["npm", "pack", "--silent", "--pack-destination", fetched, *pins])
            for pin in pins:
                package, _, version_ = pin.rpartition("@")
                file = f"{package.removeprefix('@').replace('/', '-')}-{version_}.tgz"
                with tarfile.open(Path(fetched, file)) as archive:
                    archive.extractall(place / "unpacked", filter="data")
                target = place / "node_modules" / package
                target.parent.mkdir(parents=True, exist_ok=True)
                (place / "unpacked" / "package").rename(target)
            (place / "unpacked").rmdir()

    return built(f"client-{name}", key_of((), *pins), make) / "node_modules"


def _output(words: Sequence[str]) -> str:
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout


def _run(words: Sequence[str], settings: dict[str, str] | None = None) -> None:
    """Run a step of a build outside this checkout's search path."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    try:
        done = subprocess.run(
            words,
            cwd=ROOT,
            env=environment | (settings or {}),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=BUILD_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise BuildError(f"{' '.join(words[1:])}: no end within {BUILD_S:g} s") from None
    except FileNotFoundError:
        raise BuildError(f"{words[0]} is not installed") from None
    if done.returncode:
        raise BuildError(f"{' '.join(words[1:])}: {done.stdout.strip()[-2000:]}")


# The requirements of the images

FOLDER: Final = ROOT / "docker"
PYTHONS: Final = ("3.11", "3.12", "3.13")
MACHINES: Final = ("x86_64", "aarch64")
GLIBC: Final = 36
"""Newest C library that a file may need: that of Debian 12. Newer systems take these files, too."""
RUNTIME: Final = "runtime"
LISTS: Final[Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]]] = {
    RUNTIME: (("web", "keys"), ()),
    "build": ((), ("hatchling", "mypy", "setuptools")),
    "ros2": (("ros2",), ()),
    "tests": (("dev",), ("hatchling", "editables")),
}
"""The extras of the project, and the tools, that each list has; all begin with the first list."""
HEAD: Final = "# `make hashes` writes this, from constraints.txt and pyproject.toml."


class PinnedFile(NamedTuple):
    """What pip chose of one package for one Python and machine."""

    version: str
    sha256: str
    requires: tuple[Requirement, ...]


def chosen(python: str, machine: str) -> dict[str, PinnedFile]:
    """Return the file of each package of constraints.txt, by its name, as pip chooses it."""
    tags = [f"manylinux_2_{minor}_{machine}" for minor in range(GLIBC, 4, -1)]
    tags += [f"{old}_{machine}" for old in ("manylinux2014", "manylinux2010", "manylinux1")]
    platforms = [word for tag in tags for word in ("--platform", tag)]
    with tempfile.TemporaryDirectory() as folder:
        words = (
            *("--quiet", "--disable-pip-version-check", "--no-input", "install", "--dry-run"),
            *("--ignore-installed", "--target", folder, "--no-deps", "--only-binary=:all:"),
            *("--python-version", python, *platforms, "--report", f"{folder}/report.json"),
            *("-r", str(ROOT / "constraints.txt")),
        )
        subprocess.run([sys.executable, "-m", "pip", *words], check=True)
        report = json.loads(Path(folder, "report.json").read_bytes())
    return {
        canonicalize_name(one["metadata"]["name"]): PinnedFile(
            one["metadata"]["version"],
            one["download_info"]["archive_info"]["hashes"]["sha256"],
            tuple(map(Requirement, one["metadata"].get("requires_dist", ()))),
        )
        for one in report["install"]
    }


def needed(
    wanted: Iterable[str],
    requires: Mapping[str, Iterable[Requirement]],
    environment: Mapping[str, str],
) -> set[str]:
    """Return the names of all packages that some need, themselves included, in an environment."""

    def applying(name: str, extra: str) -> Iterator[Requirement]:
        for one in requires[name]:
            if one.marker is None or one.marker.evaluate({**environment, "extra": extra}):
                yield one

    found: set[tuple[str, str]] = set()
    waiting = [Requirement(text) for text in wanted]
    while waiting:
        one = waiting.pop()
        name = canonicalize_name(one.name)
        for extra in {"", *one.extras}:
            if (name, extra) not in found:
                found.add((name, extra))
                waiting += applying(name, extra)
    return {name for name, _ in found}


def wanted_in(name: str) -> list[str]:
    """Return the requirements of a list: those of the project, of its extras, and the tools."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras, tools = LISTS[name]
    chosen_extras = [project["optional-dependencies"][extra] for extra in extras]
    return [*project["dependencies"], *(one for extra in chosen_extras for one in extra), *tools]


def write_hashes() -> None:
    """Ask pip for each Python and machine, and write the lists."""
    names: dict[str, set[str]] = {name: set() for name in LISTS}
    lines: dict[str, set[str]] = {}
    versions: dict[str, str] = {}
    for python in PYTHONS:
        for machine in MACHINES:
            print(f"Python {python} on {machine}")
            files = chosen(python, machine)
            requires = {package: file.requires for package, file in files.items()}
            environment = {
                "python_version": python,
                "python_full_version": f"{python}.0",
                "platform_machine": machine,
                "platform_system": "Linux",
                "sys_platform": "linux",
                "os_name": "posix",
                "implementation_name": "cpython",
                "platform_python_implementation": "CPython",
            }
            for name, packages in names.items():
                packages |= needed(wanted_in(name), requires, environment)
            for package, file in files.items():
                lines.setdefault(package, set()).add(f"--hash=sha256:{file.sha256}")
                versions[package] = file.version
    for name, packages in names.items():
        begin, own = [HEAD], packages
        if name != RUNTIME:
            begin, own = [HEAD, f"-r {RUNTIME}.txt"], packages - names[RUNTIME]
        entries = (
            " \\\n    ".join((f"{package}=={versions[package]}", *sorted(lines[package])))
            for package in sorted(own)
        )
        (FOLDER / f"{name}.txt").write_text("\n".join((*begin, *entries, "")))


def main(argv: Sequence[str] | None = None) -> int:
    """Build what is named; return 1 with the reason if it cannot be built."""
    parser = argparse.ArgumentParser(prog="python -m checks.built")
    what = parser.add_subparsers(dest="what", required=True)
    modules = what.add_parser("compiled", help="an installation with compiled modules")
    modules.add_argument("folder", nargs="?", type=Path, default=COMPILED)
    modules.add_argument(
        "--installed", action="store_true", help="build nothing: print the folder if it is current"
    )
    board = what.add_parser("firmware", help="the firmware of the emulated board")
    board.add_argument("variants", nargs="*", default=[image.IMAGE.name], metavar="VARIANT")
    what.add_parser("hashes", help="the requirements of the images, with all hashes")
    options = parser.parse_args(argv)
    try:
        if options.what == "compiled" and options.installed:
            if is_installed(options.folder):
                print(options.folder)
        elif options.what == "compiled":
            install_compiled(options.folder)
        elif options.what == "hashes":
            write_hashes()
        else:
            for variant in options.variants:
                print(firmware(variant).relative_to(ROOT))
    except (BuildError, UserError) as error:
        print(f"{parser.prog} {options.what}: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
