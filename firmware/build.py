"""Build the firmware (`make firmware`), with generated code for the messages of its serial link.

The tools and the source of MicroPython are packages of Debian. The source may be of a newer release
than the tools. So apt fetches it with a separate configuration, from the mirror and with the keys
of this machine.
"""

import ast
import contextlib
import fcntl
import importlib
import re
import shutil
import subprocess
import sys
import tarfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from struct import calcsize
from typing import Final

from firmware import linker, translator
from firmware.image import IMAGE, IMAGES, OUTPUT, ROOT, Image, core_hash, core_sources, core_version
from firmware.linker import NATIVE, Binding, Program
from protocol.wire import enums
from protocol.wire.message import LAYOUT, Field, Layout, class_name
from runtime.errors import UserError

TOOLS: Final = {
    "arm-none-eabi-gcc": "gcc-arm-none-eabi",
    "arm-none-eabi-ld": "binutils-arm-none-eabi",
    "gcc": "gcc",
    "make": "make",
    "python3": "python3",
}
"""Packages of Debian by the command that they contain."""
HEADERS: Final = {
    Path("/usr/include/newlib/stdint.h"): "libnewlib-dev",
    Path("/usr/include/stdio.h"): "libc6-dev",
}
"""Packages of Debian by a header that they contain; gcc only recommends the last one."""
SUITE: Final = "trixie"
PACKAGE: Final = "micropython"
VERSION: Final = "1.25.0"
TARBALL: Final = f"{PACKAGE}_{VERSION}+ds.orig.tar.xz"
TARBALL_SHA256: Final = "7b25be99a502f070b2de81dafc08da7051d992325d6e67daa9045a918fffdbea"
KEYRING: Final = Path("/usr/share/keyrings/debian-archive-keyring.gpg")
SOURCES: Final = Path("/etc/apt")
MIRROR: Final = re.compile(r"https?://\S+/debian/?(?=\s)")
TIMEOUT_S: Final = 300.0


def missing_packages() -> list[str]:
    """Return the packages of tools and headers that this machine lacks."""
    missing = [package for tool, package in TOOLS.items() if shutil.which(tool) is None]
    return missing + [package for header, package in HEADERS.items() if not header.exists()]


def check_tools() -> None:
    """Raise UserError naming all packages that are missing."""
    missing = missing_packages()
    if missing:
        raise UserError(f"the firmware needs packages that are not installed: {advice(missing)}")


def advice(packages: Iterable[str]) -> str:
    """Return the command that installs packages."""
    return f"apt install --no-install-recommends {' '.join(packages)}"


def source_tree() -> Path:
    """Return the source of MicroPython, after fetching and unpacking it if necessary."""
    tree = OUTPUT / f"{PACKAGE}-{VERSION}"
    ready = tree / "ready"
    if not ready.exists():
        tarball = OUTPUT / "source" / TARBALL
        if not tarball.exists():
            fetch(tarball)
        check(tarball)
        shutil.rmtree(tree, ignore_errors=True)
        with tarfile.open(tarball) as archive:
            # An attribute, not an argument: Python before 3.11.4, as in Debian 12, has no filters.
            archive.extraction_filter = getattr(tarfile, "data_filter", None)
            archive.extractall(OUTPUT)
        # The makefiles test for a file of a folder that Debian leaves out.
        (tree / "lib/micropython-lib").mkdir(exist_ok=True)
        (tree / "lib/micropython-lib/README.md").touch()
        ready.touch()
    return tree


def check(tarball: Path) -> None:
    """Raise UserError unless the source is the one that the firmware was written for."""
    found = sha256(tarball.read_bytes()).hexdigest()
    if found != TARBALL_SHA256:
        raise UserError(f"{tarball} has sha256 {found}, not {TARBALL_SHA256}: remove it")


def fetch(tarball: Path) -> None:
    """Fetch the source package by apt, with an isolated configuration."""
    by_hand = f"put {TARBALL} of Debian {SUITE} into {tarball.parent}"
    if shutil.which("apt-get") is None:
        raise UserError(f"the source of MicroPython needs apt-get: {by_hand}")
    folder = OUTPUT / "apt"
    for name in ("lists/partial", "cache/archives/partial", "empty"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    tarball.parent.mkdir(parents=True, exist_ok=True)
    sources = folder / "micropython.sources"
    sources.write_text(source_of(mirror(), KEYRING), encoding="utf-8")
    for action in (["update"], ["source", "--download-only", PACKAGE]):
        command = ["apt-get", *isolated(folder, sources), *action]
        done = subprocess.run(
            command, cwd=tarball.parent, capture_output=True, text=True, timeout=TIMEOUT_S
        )
        if done.returncode != 0 or (action[0] == "source" and not tarball.exists()):
            cause = done.stderr.strip().splitlines()[-1:] or ["no cause given"]
            raise UserError(f"apt cannot fetch the source of MicroPython ({cause[0]}): {by_hand}")


def isolated(folder: Path, sources: Path) -> Sequence[str]:
    """Return the options with which apt does not use the configuration of this machine."""
    options = {
        "Dir::Etc::SourceList": sources,
        "Dir::Etc::SourceParts": folder / "empty",
        "Dir::State::Lists": folder / "lists",
        "Dir::Cache": folder / "cache",
        "APT::Sandbox::User": "",
        "Debug::NoLocking": "1",
    }
    return [part for name, value in options.items() for part in ("-o", f"{name}={value}")]


def source_of(uri: str, keyring: Path) -> str:
    """Return the entry of the source package's repository."""
    return f"Types: deb-src\nURIs: {uri}\nSuites: {SUITE}\nComponents: main\nSigned-By: {keyring}\n"


def mirror(folder: Path = SOURCES) -> str:
    """Return the mirror of Debian that this machine uses."""
    files = [folder / "sources.list", *sorted((folder / "sources.list.d").glob("*"))]
    for file in files:
        if file.is_file():
            text = file.read_text(encoding="utf-8", errors="replace") + "\n"
            lines = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
            found = MIRROR.search("\n".join([*lines, ""]))
            if found is not None:
                return found[0]
    raise UserError(
        f"no mirror of Debian in {folder}: add one, or put {TARBALL} into build/firmware/source"
    )


def cross_compiler(tree: Path) -> Path:
    """Return MicroPython's cross compiler, after building it if necessary."""
    program = tree / "mpy-cross" / "build" / "mpy-cross"
    if not program.exists():
        run(["make", "-C", str(tree / "mpy-cross")])
    return program


def run(command: Sequence[str]) -> None:
    """Run a step of the build; raise UserError with the end of its output if it fails."""
    done = subprocess.run(
        [*command, "-j2"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    if done.returncode:
        lines = [line for line in done.stdout.splitlines() if "rror" in line or "overflow" in line]
        what = lines[0] if lines else done.stdout[-300:]
        raise UserError(f"{' '.join(command[:3])} failed: {what}")


TO_BOARD: Final = (
    "SONAR_SCAN",
    "WHEEL_TICKS",
    "TICK_INPUTS",
    "BOARD_SETUP",
    "BOARD_PARAMETER",
    "BOARD_FENCE",
    "BOARD_GOAL",
    "BOARD_COMMAND",
    "BOARD_STOP",
    "BOARD_RESTART",
)
FROM_BOARD: Final = (
    "WHEEL_COMMAND",
    "PLANAR_ODOMETRY",
    "AVOIDANCE_DECISION",
    "BOARD_HELLO",
    "BOARD_ANSWER",
    "BOARD_STATE",
    "BOARD_REPORT",
)
MARKED: Final = ("TICK_INPUTS", "WHEEL_COMMAND")
"""Messages whose ids the link needs, because they mark the start and the end of a measurement."""
READ_WHOLE: Final = ("SONAR_SCAN", "WHEEL_TICKS")
"""Messages that the core reads by the names of their fields."""
STAMP: Final = "time_ns"
COPIED: Final = ("TICK_INPUTS", "WHEEL_COMMAND", "PLANAR_ODOMETRY", "AVOIDANCE_DECISION")
"""Messages whose stamp the board only copies, as bytes."""
CONSTANTS: Final = ("INPUT_", "BOARD_")
EXTENTS: Final = ("VEHICLE", "GOAL", "PLACE")
COMMANDS: Final = (
    "DO_FLIGHTTERMINATION",
    "SIDESTEP_CLEAR_EMERGENCY_STOP",
    "SIDESTEP_ABORT_GOAL",
    "NAV_RETURN_TO_LAUNCH",
    "DO_SET_MODE",
    "SIDESTEP_SET_NAVIGATOR",
    "COMPONENT_ARM_DISARM",
    "DO_PAUSE_CONTINUE",
    "SIDESTEP_SET_POSE",
)


def c_header() -> str:
    """Return the table of messages for the link, which is written in C."""
    rows = [
        f"    {{{layout.number}u, {size_of(layout)}, {layout.crc_extra}}}, // {layout.name}"
        for layout in map(layout_of, (*TO_BOARD, *FROM_BOARD))
    ]
    largest = max(size_of(layout_of(name)) for name in (*TO_BOARD, *FROM_BOARD))
    return "\n".join(
        [
            "// Generated by firmware.build from the dialect.",
            "#define PAYLOAD_BYTES " + f"{largest}u",
            *(f"#define {name}_ID {layout_of(name).number}u" for name in MARKED),
            "#ifdef WITH_MESSAGES",
            "static const struct message {",
            "    uint32_t id;",
            "    uint8_t size, seed;",
            "} messages[] = {",
            *rows,
            "};",
            f"#define MESSAGE_COUNT {len(rows)}u",
            "#endif",
            "",
        ]
    )


def python_module() -> str:
    """Return the module `wire` of the firmware."""
    lines = ['"""Messages of the link, generated from the dialect."""', ""]
    lines += ["from collections import namedtuple", "from struct import unpack_from", ""]
    lines += ["from typing import Final", ""]
    for name, value in constants():
        lines.append(f"{name}: Final = {value!r}")
    for name in READ_WHOLE:
        lines += ["", *_reader(layout_of(name))]
    return "\n".join([*lines, ""])


def constants() -> Iterator[tuple[str, int | str]]:
    """Yield the constants of the module `wire`."""
    for name in (*TO_BOARD, *FROM_BOARD):
        layout = layout_of(name)
        yield f"{name}_ID", layout.number
        yield f"{name}_SIZE", size_of(layout)
        yield f"{name}_FORMAT", format_of(layout)
    for name in sorted(vars(enums)):
        if name.startswith(CONSTANTS):
            yield name, int(getattr(enums, name))
    for name in EXTENTS:
        yield f"STOP_{name}", int(enums.StopExtent[name])
    for name in COMMANDS:
        yield name, int(enums.Command[name])


def layout_of(name: str) -> Layout:
    """Return the layout of a message by its name in the dialect."""
    return LAYOUT[class_name(name)]


def size_of(layout: Layout) -> int:
    """Return the number of bytes of a whole payload."""
    return calcsize("<" + "".join(map(_code, layout.fields)))


def format_of(layout: Layout) -> str:
    """Return the format of a payload; bytes that the board only copies stay bytes."""
    copied = layout.name in COPIED
    codes = ["8s" if copied and field.name == STAMP else _code(field) for field in layout.fields]
    if layout.name == "BOARD_HELLO":
        codes = ["32s" if code == "32B" else code for code in codes]
    return "<" + "".join(codes)


def _code(field: Field) -> str:
    return f"{field.length or ''}{field.code}"


def _reader(layout: Layout) -> list[str]:
    name = class_name(layout.name)
    fields = ", ".join(f'"{field.name}"' for field in layout.fields)
    values, place = [], 0
    for field in layout.fields:
        end = place + (field.length or 1)
        values.append(f"v[{place}:{end}]" if field.length else f"v[{place}]")
        place = end
    return [
        f'{name} = namedtuple("{name}", ({fields}))',
        "",
        "",
        f"def {layout.name.lower()}(payload):",
        f"    v = unpack_from({layout.name}_FORMAT, payload)",
        f"    return {name}({', '.join(values)})",
        "",
    ]


HERE: Final = Path(__file__).resolve().parent


def sources() -> dict[str, str]:
    """Return all sources that may be frozen, by module."""
    paths = dict(core_sources())
    paths |= {path.stem: path for path in (HERE / "onboard").glob("*.py")}
    texts = {name: path.read_text(encoding="utf-8") for name, path in paths.items()}
    return texts | {"wire": python_module()}


def values(sources: Mapping[str, str]) -> dict[Binding, object]:
    """Return the values of all module-level constants, as CPython computes them."""
    found: dict[Binding, object] = {}
    for name, text in sources.items():
        if "." in name or name == "robot":
            names = vars(importlib.import_module(name))
        else:
            names = dict(constants_of(text))
        found |= {Binding(name, key): value for key, value in names.items()}
    return found


def constants_of(source: str) -> Iterator[tuple[str, object]]:
    """Yield the constants of a module that are literals."""
    for statement in ast.parse(source).body:
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            with contextlib.suppress(ValueError, TypeError):
                yield statement.target.id, ast.literal_eval(statement.value or statement)


def write(path: Path, text: str) -> None:
    """Write a generated file, unless it has this content already."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def generate(folder: Path) -> None:
    """Write the linked program with its manifest, and the headers of the port."""
    texts = sources()
    frozen = folder / "frozen"
    for name, short in NATIVE.items():
        source = texts.pop(name)
        functions = translator.translated(source, importlib.import_module(name))
        write(folder / f"{short}.h", functions + translator.bindings(source, short))
    write(frozen / "main.py", Program(texts, values(texts)).linked("main"))
    write(folder / "manifest.py", f"freeze({str(frozen)!r})\n")
    hashed = "".join(f"\\x{byte:02x}" for byte in core_hash())
    header = f'#define CORE_HASH "{hashed}"\n#define CORE_VERSION "{core_version()[:24]}"\n'
    write(folder / "image.h", header)
    write(folder / "messages.h", c_header())


def build(image: Image) -> None:
    """Build one variant."""
    check_tools()
    tree = source_tree()
    compiler = cross_compiler(tree)
    generate(image.folder)
    settings = {
        "TOP": tree,
        "BUILD": image.folder,
        "FROZEN_MANIFEST": image.folder / "manifest.py",
        "MICROPY_MPYCROSS": compiler,
        "HEAP_BYTES": image.heap_bytes,
        "STACK_BYTES": image.stack_bytes,
        "RAM_BYTES": image.ram_bytes,
        "FLOAT_BITS": image.float_bits,
    }
    port = str(HERE / "port")
    make = ["make", "-C", port, *(f"{name}={value}" for name, value in settings.items())]
    frozen = image.folder / "frozen_content.c"
    run([*make, str(frozen)])
    wanted = linker.floats_in((image.folder / "frozen" / "main.py").read_text(encoding="utf-8"))
    write(frozen, linker.exact(frozen.read_text(encoding="utf-8"), wanted))
    run(make)


def main(arguments: Sequence[str] | None = None) -> int:
    """Build the variants named on the command line; by default the double-precision one."""
    names = list(sys.argv[1:] if arguments is None else arguments) or [IMAGE.name]
    try:
        OUTPUT.mkdir(parents=True, exist_ok=True)
        with (OUTPUT / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            for name in names:
                build(IMAGES[name])
                elf = IMAGES[name].elf.relative_to(ROOT)
                print(f"{elf}: core {core_version()}, {core_hash().hex()[:12]}")
    except KeyError as error:
        print(f"make firmware: no variant {error}; known: {', '.join(IMAGES)}", file=sys.stderr)
        return 2
    except UserError as error:
        print(f"make firmware: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
