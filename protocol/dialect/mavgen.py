"""Build pymavlink's own module of the dialect, the reference for our generated modules.

mavgen takes about a second for the common dialect. Its module is written once to build/ and shared
by all processes; changed definitions or another pymavlink version get a module of their own.
"""

import contextlib
import fcntl
import importlib.util
import os
import shutil
import sys
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from protocol.dialect.definitions import SIDESTEP_XML, upstream_definitions

FOLDER: Final = Path(__file__).resolve().parents[2] / "build" / "mavgen"


@cache
def oracle() -> Any:
    """Return mavgen's module for sidestep.xml with all of common.xml."""
    definitions = [SIDESTEP_XML, *upstream_definitions()]
    facts = [version("pymavlink").encode(), *(path.read_bytes() for path in definitions)]
    name = "mavgen_" + sha256(b"\0".join(facts)).hexdigest()[:16]
    file = FOLDER / f"{name}.py"
    if not file.exists():
        FOLDER.mkdir(parents=True, exist_ok=True)
        with (FOLDER / "lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not file.exists():
                write_module(definitions, file)
    return loaded(file)


def write_module(definitions: list[Path], file: Path) -> None:
    """Write mavgen's module; the file appears complete or not at all."""
    from pymavlink.generator import mavgen, mavparse

    folder = file.with_suffix(".part")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for definition in definitions:  # mavgen searches an <include> in the folder of its file
        shutil.copy(definition, folder)
    options = mavgen.Opts(
        str(folder / file.name),
        wire_protocol=mavparse.PROTOCOL_2_0,
        language="Python3",
        validate=True,
    )
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
        mavgen.mavgen(options, [str(folder / definitions[0].name)])
    (folder / file.name).rename(file)
    shutil.rmtree(folder)


def loaded(file: Path) -> Any:
    """Import a module from its file."""
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # mavgen's code looks up its own module by name to find message classes
    sys.modules[module.__name__] = module
    spec.loader.exec_module(module)
    return module
