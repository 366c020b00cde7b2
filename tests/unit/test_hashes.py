"""The hashed lists of what the images install: complete, of the pinned versions, and enforced."""

import re
import shutil
import subprocess
import sys
from hashlib import sha256
from importlib.metadata import requires
from pathlib import Path
from zipfile import ZipFile

from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from checks.hashes import FOLDER, LISTS, MACHINES, RUNTIME, needed, wanted_in
from tests.support.each import each
from tests.unit.test_packaging import ROOT, pins

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
