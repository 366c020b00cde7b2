"""Compile the control core and the simulation into the wheel if SIDESTEP_COMPILE=1.

The modules are named in pyproject.toml. mypyc translates them to C; a compiled module lies in the
wheel beside its source, and Python prefers it. `runtime/compiled.json` has the commit, and the
sources with their hashes, by which `runtime.cli.compiled` detects a module that does not match its
source. Nothing is written into the checkout, and an editable install is never compiled.

`python hatch_build.py compile FOLDER` compiles into a folder. With its name in SIDESTEP_COMPILED
the build takes the modules from there, if they are those of its sources, and compiles nothing.
`python hatch_build.py sources FOLDER` copies all that the compiler reads.
"""

import ast
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from hashlib import sha256
from importlib.machinery import EXTENSION_SUFFIXES
from multiprocessing.pool import ThreadPool
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

SWITCH = "SIDESTEP_COMPILE"
READY = "SIDESTEP_COMPILED"
LIST = "runtime/compiled.json"
TOOLS = ("mypy>=2.4", "setuptools>=65.5")
HASHES = "sources.json"
OPTIMISATION = "2"
GIT_TIMEOUT_S = 10.0
FLAGS = ("-ffp-contract=off", "-Wno-error")
"""Without fused multiply-add, which some processors' compilers use by default: it rounds once
instead of twice. A warning of a newer compiler is no error."""


class CompilingHook(BuildHookInterface[Any]):
    """Add compiled modules to a wheel."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """Return what the compiler needs: itself, and the libraries whose types it reads."""
        return [*TOOLS, *self.metadata.core.dependencies] if is_wanted() else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile into a temporary folder and include the result."""
        if not is_wanted():
            return
        if version == "editable":
            refuse("an editable install is not compiled, as it follows its sources; leave out -e")
        root = Path(self.root)
        sources = sources_in(root, self.config["modules"])
        self._folder = tempfile.mkdtemp(prefix="sidestep-compile-")
        folder = Path(os.environ.get(READY) or self._folder)
        if not os.environ.get(READY):
            compile_into(folder, root, sources)
        check(folder, root, sources)
        listed = Path(self._folder) / Path(LIST).name
        content = {"commit": commit_of(root), "sources": hashes(root, sources)}
        listed.write_text(json.dumps(content, indent=1) + "\n", "utf-8")
        built = {str(path): path.relative_to(folder).as_posix() for path in modules_in(folder)}
        build_data["force_include"].update({**built, str(listed): LIST})
        build_data["pure_python"] = False
        build_data["infer_tag"] = True

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the temporary folder."""
        shutil.rmtree(getattr(self, "_folder", ""), ignore_errors=True)


def is_wanted() -> bool:
    """Return whether the build compiles; end the build for a value that is no switch."""
    value = os.environ.get(SWITCH, "")
    if value not in ("", "0", "1"):
        refuse(f"{SWITCH}={value}: use 1 to compile, 0 or nothing for pure Python")
    return value == "1"


def refuse(why: str) -> None:
    """End the build with a reason."""
    sys.exit(f"{SWITCH}: {why}" if not why.startswith(SWITCH) else why)


def sources_in(root: Path, patterns: Sequence[str]) -> list[str]:
    """Return the sources that match the patterns, relative to the root; each must match one."""
    found: list[str] = []
    for pattern in patterns:
        paths = sorted(path for path in root.glob(pattern) if path.name != "__init__.py")
        if not paths:
            refuse(f"pyproject.toml: no file matches modules = {pattern!r}")
        found += [path.relative_to(root).as_posix() for path in paths]
    return found


def compile_into(folder: Path, root: Path, sources: Sequence[str]) -> None:
    """Write the compiled modules, by their names in the wheel, and the hashes of their sources."""
    check_compiler()
    from mypyc.build import mypycify  # needed only here
    from setuptools import Distribution
    from setuptools.command.build_ext import build_ext

    class Parallel(build_ext):  # type: ignore[misc]  # setuptools carries no types
        """Compile several files of one extension at a time, and several extensions."""

        def build_extensions(self) -> None:
            compile_files = self.compiler.compile

            def compile_each(files: Sequence[str], **options: Any) -> list[str]:
                with ThreadPool(os.cpu_count()) as pool:
                    found = pool.map(lambda file: compile_files([file], **options), files, 1)
                return [file for files in found for file in files]

            self.compiler.compile = compile_each
            super().build_extensions()

    os.chdir(root)
    with tempfile.TemporaryDirectory(prefix="sidestep-compile-") as temporary:
        extensions = mypycify(
            [f"--cache-dir={temporary}/types", *sources],
            opt_level=OPTIMISATION,
            debug_level="0",
            target_dir=f"{temporary}/c",
            multi_file=True,
        )
        for extension in extensions:
            if os.name == "posix":
                extension.extra_compile_args.extend(FLAGS)
        command = Parallel(Distribution({"ext_modules": extensions}))
        command.build_lib, command.build_temp = str(folder), f"{temporary}/objects"
        command.ensure_finalized()
        command.parallel = os.cpu_count()
        command.run()
    (folder / HASHES).write_text(json.dumps(hashes(root, sources)), "utf-8")


def check(folder: Path, root: Path, sources: Sequence[str]) -> None:
    """End the build if compiled modules are not those of the sources."""
    listed = folder / HASHES
    if not listed.exists() or json.loads(listed.read_text("utf-8")) != hashes(root, sources):
        refuse(f"{READY}: the modules in {folder} are those of other sources")


def modules_in(folder: Path) -> list[Path]:
    """Return the compiled modules in a folder."""
    return [path for path in folder.rglob("*") if path.name.endswith(tuple(EXTENSION_SUFFIXES))]


def commit_of(root: Path) -> str:
    """Return the commit of a checkout, with a + if tracked files have changes; else "unknown"."""
    if not (root / ".git").exists():
        return "unknown"

    def git(*words: str) -> str:
        return subprocess.check_output(
            ["git", "-C", str(root), *words],
            text=True,
            stderr=subprocess.DEVNULL,
            timeout=GIT_TIMEOUT_S,
            env={**os.environ, "GIT_OPTIONAL_LOCKS": "0"},
        ).strip()

    try:
        commit = git("rev-parse", "HEAD")
        changed = git("status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return f"{commit}+" if changed else commit


def check_compiler() -> None:
    """End the build if the C compiler or the headers of Python are missing."""
    compiler = (os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc").split()[0]
    if os.name == "posix" and shutil.which(compiler) is None:
        refuse(f"there is no C compiler {compiler!r}: install gcc, or unset {SWITCH}")
    header = Path(sysconfig.get_paths()["include"]) / "Python.h"
    if not header.exists():
        refuse(f"there is no {header}: install python3-dev, or unset {SWITCH}")


def hashes(root: Path, sources: Sequence[str]) -> dict[str, str]:
    """Return the SHA-256 of each source."""
    return {name: sha256((root / name).read_bytes()).hexdigest() for name in sources}


def reached(root: Path, sources: Iterable[str]) -> set[Path]:
    """Return these sources and all modules of the tree that they import, directly or not.

    mypyc reads the types of the latter: a change of one may change the compiled code.
    """
    found: set[Path] = set()
    todo = [root / name for name in sources]
    while todo:
        path = todo.pop()
        if path not in found:
            found.add(path)
            packages = [place / "__init__.py" for place in path.parents if root in place.parents]
            stems = [root.joinpath(*name.split(".")) for name in imports(path)]
            modules = [stem.with_suffix(".py") for stem in stems]
            others = [*packages, *modules, *(stem / "__init__.py" for stem in stems)]
            todo += [file for file in others if file.exists()]
    return found


def imports(path: Path) -> Iterator[str]:
    """Yield the names that a module imports, anywhere in it; some are no modules."""
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def main(what: str, folder: Path) -> None:
    """Compile the modules that pyproject.toml names, or copy what this needs."""
    root = Path(__file__).resolve().parent
    project = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    sources = sources_in(root, wheel["hooks"]["custom"]["modules"])
    if what == "compile":
        compile_into(folder.resolve(), root, sources)
        return
    for path in (*reached(root, sources), root / "pyproject.toml", root / "hatch_build.py"):
        target = folder / path.relative_to(root)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, target)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
