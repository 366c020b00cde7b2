"""The tools of the build, and what is said when one is missing."""

from pathlib import Path

import pytest

from firmware import build
from firmware.board import Emulator
from firmware.build import main
from firmware.image import Image
from runtime.errors import UserError

ENTRY = "Types: deb\n# http://old.example/debian\nURIs: http://mirror.example/debian\nSuites: x\n"


def test_build_names_the_missing_compiler(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main([]) == 2
    told = capsys.readouterr().err
    assert told.startswith("make firmware: ")
    assert "gcc-arm-none-eabi" in told
    assert told.count("\n") == 1


def test_missing_headers_are_named_by_their_packages(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    headers = {tmp_path / package: package for package in build.HEADERS.values()}
    monkeypatch.setattr(build, "HEADERS", headers)
    (tmp_path / "libnewlib-dev").touch()
    assert "libc6-dev" in build.missing_packages()
    assert "libnewlib-dev" not in build.missing_packages()


def test_unknown_variant_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lpc9"]) == 2
    assert "lpc1768" in capsys.readouterr().err


def test_missing_emulator_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UserError, match="apt install qemu-system-arm"):
        Emulator(tmp_path / "firmware.elf")


def test_changed_source_of_micropython_is_refused(tmp_path: Path) -> None:
    tarball = tmp_path / build.TARBALL
    tarball.write_bytes(b"something else")
    with pytest.raises(UserError, match="sha256"):
        build.check(tarball)


def test_mirror_of_this_machine_is_used(tmp_path: Path) -> None:
    folder = tmp_path / "sources.list.d"
    folder.mkdir()
    (folder / "debian.sources").write_text(ENTRY)
    assert build.mirror(tmp_path) == "http://mirror.example/debian"


def test_machine_without_a_mirror_is_told_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="build/firmware/source"):
        build.mirror(tmp_path)


def test_image_fits_the_memory_of_the_chip() -> None:
    image = Image()
    assert image.ram_bytes <= 64 * 1024
    assert image.heap_bytes + image.stack_bytes < image.ram_bytes
