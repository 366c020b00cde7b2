"""A browser's first steps, without a browser: ask for a page, and keep the cookie it comes with."""

from contextlib import closing
from http.client import HTTPConnection
from typing import NamedTuple
from urllib.parse import parse_qs, urlsplit

PATIENCE_S = 30.0


class Answer(NamedTuple):
    status: int
    text: str
    cookie: str


def asked(address: str, path: str = "/", cookie: str = "") -> Answer:
    """Return the server's answer for a path."""
    place = urlsplit(address)
    assert place.hostname is not None
    with closing(HTTPConnection(place.hostname, place.port, timeout=PATIENCE_S)) as connection:
        connection.request("GET", path, headers={"Cookie": cookie} if cookie else {})
        answer = connection.getresponse()
        given = (answer.getheader("Set-Cookie") or "").partition(";")[0]
        return Answer(answer.status, answer.read().decode(errors="replace"), given)


def token_in(address: str) -> str:
    return parse_qs(urlsplit(address).query)["token"][0]
