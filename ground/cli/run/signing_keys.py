"""`keys signing`: create, show, rotate and retire the signing keys of the MAVLink gateway."""

import argparse
from pathlib import Path
from typing import Final

from ground.text.output import Output
from ground.user.mavlink_keys import (
    MAX_KEYS,
    KeyRing,
    SigningKey,
    new_key,
    read_keys,
    usual_file,
    write_keys,
)
from runtime.errors import UserError

ACTIONS: Final = ("new", "show", "rotate", "retire")
RESTART: Final = "restart the gateway to use it"
SHOW: Final = "`sidestep keys signing show --secret` prints the passphrase for the ground station"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `keys signing`."""
    text = (
        "new: make the first key; show: list the keys; rotate: make a new key, the old one stays"
        " valid; retire: end the old key"
    )
    parser.add_argument("what", choices=ACTIONS, metavar="|".join(ACTIONS), help=text)
    text = "show: print passphrase and key, too"
    parser.add_argument("--secret", action="store_true", help=text)
    text = f"file of the keys (default {usual_file()})"
    parser.add_argument("--file", type=Path, metavar="FILE", help=text)


def run(options: argparse.Namespace, output: Output) -> int:
    """Run the action; return 0."""
    path: Path = options.file or usual_file()
    ring = read_keys(path)
    if options.what == "show":
        show(path, ring, output, is_secret=options.secret)
        return 0
    if options.secret:
        raise UserError("--secret: only with `keys signing show`")
    changes = {"new": created, "rotate": rotated, "retire": retired}
    changed = changes[options.what](path, ring)
    write_keys(path, changed)
    names = [key.name for key in changed.key]
    lines = [f"{path}: key {names[0]} signs", *(f"  {name} stays valid" for name in names[1:])]
    hint = RESTART if options.what == "retire" else f"{RESTART}; {SHOW}"
    row: dict[str, object] = {"ok": True, "file": str(path), "keys": names}
    output.result(row, "\n".join([*lines, f"  {hint}"]))
    return 0


def created(path: Path, ring: KeyRing) -> KeyRing:
    """Return a first key; UserError if there is one."""
    if ring.key:
        raise UserError(f"{path} has key {ring.key[0].name}: use `sidestep keys signing rotate`")
    return KeyRing(key=(new_key(),))


def rotated(path: Path, ring: KeyRing) -> KeyRing:
    """Return a new key before the old one; UserError if there is none, or if two are valid."""
    if not ring.key:
        raise UserError(f"{path} has no key: use `sidestep keys signing new`")
    if len(ring.key) == MAX_KEYS:
        fix = "end the old one with `sidestep keys signing retire`"
        raise UserError(f"{path}: {MAX_KEYS} keys are valid: {fix}")
    return KeyRing(key=(new_key(), *ring.key))


def retired(path: Path, ring: KeyRing) -> KeyRing:
    """Return the key that signs, without the old one; UserError if there is no old key."""
    if len(ring.key) < MAX_KEYS:
        raise UserError(f"{path} has no old key to end")
    return KeyRing(key=ring.key[:1])


def show(path: Path, ring: KeyRing, output: Output, *, is_secret: bool) -> None:
    """Print the names of the keys; the secrets only if asked."""
    if not ring.key:
        output.result(
            {"ok": True, "file": str(path), "keys": []},
            f"{path} has no key: make one with `sidestep keys signing new`",
        )
        return
    roles = ("signs", "is still valid")
    lines = [f"{key.name} {role}" for key, role in zip(ring.key, roles, strict=False)]
    rows: list[dict[str, object]] = [{"name": key.name} for key in ring.key]
    if is_secret:
        for at, key in enumerate(ring.key):
            lines[at] += f"\n  {secrets_of(key)}"
            rows[at] |= {"passphrase": key.passphrase or None, "key": key.secret}
    output.result({"ok": True, "file": str(path), "keys": rows}, "\n".join(lines))


def secrets_of(key: SigningKey) -> str:
    """Return the passphrase, if it is known, and the key."""
    phrase = f"passphrase {key.passphrase}" if key.passphrase else "no passphrase: a client set it"
    return f"{phrase}\n  key {key.secret}"
