"""Files that name pins, packages, verbs and commands agree with each other."""

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from packaging.version import Version

from runtime.cli.packages import PACKAGES
from tests.support.each import each

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
    assert set(wheel["only-include"]) == packages - CHECKOUT_ONLY | {"sidestep.py"}
    assert set(PACKAGES) == packages - CHECKOUT_ONLY
    assert set(PROJECT["tool"]["importlinter"]["root_packages"]) == packages - {"tests", "examples"}


def test_extras_serve_packages_of_the_wheel() -> None:
    extras = PROJECT["project"]["optional-dependencies"]
    assert set(extras) - {"dev", "docs"} == {"study", "dask", "foxglove", "keys", "web"}
    needed = {name for extra in set(extras) - {"dev"} for name in extras[extra]}
    assert needed <= set(extras["dev"])


def test_the_image_is_built_of_what_the_wheel_carries() -> None:
    wheel = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]
    copied = re.findall(r"^COPY (\w+) \1$", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
    assert {*copied, "sidestep.py"} == set(wheel["only-include"])


def test_the_gate_calls_the_command_the_readme_gives() -> None:
    assert "make test" in (ROOT / ".ci" / "run").read_text()
    assert "make test" in (ROOT / "README.md").read_text()


@each("place", ["constraints.txt", "Makefile", "pyproject.toml", ".ci/run"])
def test_no_file_names_a_package_host_or_a_private_path(place: str) -> None:
    private = r"index-url|find-links|https?://|/root/|/home/"
    assert not re.search(private, (ROOT / place).read_text())
