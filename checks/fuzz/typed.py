"""Typed input and browser requests: console, command lines, endpoints, web access."""

import shlex
from argparse import ArgumentParser
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from aiohttp import web
from aiohttp.test_utils import make_mocked_request

from checks.fuzz.target import REFUSALS, FuzzTarget, from_file
from ground.cli.verbs import VERBS
from ground.console.completion import complete
from ground.console.parser import read
from ground.grammar.fences import outlined
from ground.web import WebAccess, address_of, token_of
from plant.process.run import parser as plant_parser
from protocol.bus.network import Network
from protocol.options import numbers_kept
from protocol.topics import robot_name
from robot.run import parser as robot_parser
from runtime.cli.parsers import parser_of
from study.cli.calibrate import parser as calibrate_parser

TOKEN: Final = "0123456789abcdefgh"
SESSION: Final = "abcdefgh0123456789"
LINES: Final = (
    *("goto 5.4 2 -90", "param set d_obs_m 0.4", "mission upload 'my file.toml'", "teleop 0.2 30"),
    *("fence polygon 0 0 4 0 4 4", "mode manual", "export run.mcap --shape wide --out x.csv"),
    *("lease take", "replay run.tlog", "explain --turns run.mcap", "help goto", "find arm"),
)
WORDS: Final = (
    *(
        b"'",
        b'"',
        b"\\",
        b" -- ",
        b" --json",
        b" --at ",
        b" -1e3",
        b" nan",
        b" inf",
        b"=",
        b"@",
        b"%",
    ),
    *(
        b" --id ",
        b" --config ",
        b"goto ",
        b"param ",
        b"mission ",
        b"~",
        b"/",
        b"\xe2\x80\xae",
        b"\0",
    ),
)
COMMAND_LINES: Final = (
    b"robot\0--id\0r1\0--listen\0tcp/127.0.0.1:7447\0--start\x000\x000\x0090\0--param\0d_obs_m=0.4",
    b"plant\0--world\0box\0--robots\0r1,r2\0--seed\x007\0--noise\0lossy\0--speed\x0010",
    b"calibrate\0--runs\x005\0--side\x004\0--plot\0x.svg",
    b"goto\x001\x002\0-90\0--json",
    b"up\0--world\0box\0--goal\x001\x002\0--robots\x003\0--speed\0max\0--headless",
    b"export\0run.mcap\0--rate\x0010\0--from\x00-1",
)
PARSERS: Final[dict[str, Callable[[], ArgumentParser]]] = {
    "robot": robot_parser,
    "plant": plant_parser,
    "calibrate": calibrate_parser,
}
REQUESTS: Final = (
    f"/?token={TOKEN}\n".encode(),
    f"/ws?width=80\nCookie: sidestep_8765={SESSION}\nOrigin: http://127.0.0.1:8765\n".encode(),
    b"/static/js/textual.js\nCookie: sidestep_8765=wrong\nHost: [::1]:8765\n",
    b"/?token=%ff%fe\nOrigin: http://[\nCookie: a=b; sidestep_8765=\n",
)


def text_of(data: bytes) -> str:
    """Decode terminal input as Python does."""
    return data.decode("utf-8", "surrogateescape")


def console(data: bytes, folder: Path) -> None:
    """Complete and parse a console line."""
    text = text_of(data)
    for line in complete(text, ("d_obs_m", "side"), folder)[:3]:
        shlex.split(line)
    read(text)


def command_line(data: bytes, _: Path) -> None:
    """Parse arguments that are separated by zero bytes."""
    word, *rest = text_of(data).split("\0")
    if word in PARSERS:
        PARSERS[word]().parse_args(numbers_kept(rest))
    elif word in VERBS:
        parser_of(word).parse_args(numbers_kept(rest))


def endpoint(data: bytes, _: Path) -> None:
    """Read an endpoint and a robot name."""
    first, second = text_of(data).partition("\n")[::2]
    robot_name(second or "r1")
    Network(mode="client", connect=(first,), prefix=second or "sidestep")


def address(data: bytes, _: Path) -> None:
    """Read a web address."""
    address_of(text_of(data)).url(TOKEN)


def token(path: Path) -> None:
    """Read a token file."""
    token_of(str(path))


def fence_words(data: bytes, _: Path) -> None:
    """Read the words of a fence."""
    outlined(text_of(data).split())


def door(data: bytes, _: Path) -> None:
    """Check a web request (first line: path, then headers): access needs the token."""
    first, *lines = data.decode("latin-1").split("\n")
    pairs = (line.partition(":")[::2] for line in lines if ":" in line)
    headers = {name.strip(): value.strip() for name, value in pairs if name.strip()}
    try:
        request = make_mocked_request("GET", first or "/", headers=headers)
    except ValueError:  # refused before it gets here
        return
    inside: list[web.Request] = []

    async def handler(asked: web.Request) -> web.Response:
        inside.append(asked)
        return web.Response(text="in")

    access = WebAccess(TOKEN, 8765)
    access.sessions.append(SESSION)
    answer = finished(access.middleware()(request, handler))
    if inside and SESSION not in headers.get("Cookie", request.headers.get("Cookie", "")):
        raise AssertionError("a request without the token was admitted")
    if answer.status not in (200, 303, 403):
        raise AssertionError(f"unexpected HTTP status {answer.status}")


def finished(waiting: object) -> web.StreamResponse:
    """Return the result of a coroutine that does not wait."""
    try:
        waiting.send(None)  # type: ignore[attr-defined]
    except StopIteration as done:
        found: web.StreamResponse = done.value
        return found
    raise AssertionError("the web access check must not wait")


def lines() -> Sequence[bytes]:
    """Return good console lines."""
    return [line.encode() for line in LINES]


TYPED: Final = (
    FuzzTarget(name="console", samples=lines, run=console, words=WORDS),
    FuzzTarget(
        name="command_line",
        samples=lambda: COMMAND_LINES,
        run=command_line,
        allowed=(*REFUSALS, SystemExit),
        words=(*WORDS, b"\0--", b"\0"),
    ),
    FuzzTarget(
        name="endpoint",
        samples=lambda: [b"tcp/127.0.0.1:7447\nr1", b"udp/[::1]:0#a=b", b"unixsock-stream//tmp/x"],
        run=endpoint,
        words=(b"/", b":", b"[", b"]", b"#", b"?", b"udp/", b"\n", b"**"),
    ),
    FuzzTarget(
        name="web_address",
        samples=lambda: [b"127.0.0.1:8765", b"[::1]:80", b"8080", b"localhost"],
        run=address,
        words=(b":", b"[", b"]", b"\xd9\xa1", b"\xc2\xb2"),
    ),
    FuzzTarget(name="token", samples=lambda: [TOKEN.encode()], run=from_file("token", token)),
    FuzzTarget(name="fence_words", samples=lambda: [b"0 0 4 0 4 4 0 4"], run=fence_words),
    FuzzTarget(
        name="door",
        samples=lambda: REQUESTS,
        run=door,
        allowed=(),
        words=(b"token=", b"%", b"%c3%28", b"Origin: ", b"Cookie: ", b"Host: ", b"\n", b"=", b";"),
    ),
)
