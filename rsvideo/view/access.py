"""Who may talk to the server: this machine's browser, with the token, from the server's own pages; and what pages may do.

The token stands in the address, as the first part of its path. A request without it is refused, so is one that another page sends
(`Origin`, `Sec-Fetch-Site`), and one under another name of this machine (`Host`), as a name of a stranger's that was pointed here has.
"""

import json
import secrets
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from typing import Any

MOST_BYTES = 1_000_000  # of a request that is no upload
MOST_PASSED_OVER = 8_000_000  # bytes of a body that is refused
UPLOADS = "/api/upload/"  # below which requests may be longer; whoever takes them counts their bytes

POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' blob:",
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
_HEADERS = {
    "content-security-policy": POLICY,
    "referrer-policy": "no-referrer",  # which would carry the token
    "x-content-type-options": "nosniff",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cache-control": "no-store",
}

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]


def new_token() -> str:
    """For an address that nobody guesses."""
    return secrets.token_urlsafe(24)


class Gate:
    """Refuses what may not come in, and puts headers on all that goes out."""

    def __init__(self, app: App, token: str, port: int) -> None:
        self._app, self._token = app, token
        self._hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """As ASGI has it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        if (fault := self._fault(scope)) is not None:
            await _pass_over(receive)
            await _refuse(send, *fault)
            return
        scope = {**scope, "path": self._path(scope), "root_path": ""}
        scope["raw_path"] = scope["path"].encode()
        await self._app(scope, receive, _with_headers(send))

    def _fault(self, scope: Scope) -> tuple[int, str] | None:
        """Why a request is refused, with HTTP's number for it."""
        headers = _single(scope["headers"])
        if headers.get(b"host", b"").decode("latin-1").lower() not in self._hosts:
            return 421, "this name does not stand for this server; open the address that rsvideo view printed"
        first = scope["path"].split("/", 2)[1] if scope["path"].count("/") else ""
        if not secrets.compare_digest(first.encode("utf-8", "replace"), self._token.encode()):
            return 403, "the address lacks the right token; open the one that rsvideo view printed"
        origin = headers.get(b"origin")
        if origin is not None and origin.decode("latin-1").lower() not in {f"http://{host}" for host in self._hosts}:
            return 403, "another page sent this request; use the pages of rsvideo view itself"
        reading = scope["method"] in ("GET", "HEAD")
        foreign = headers.get(b"sec-fetch-site", b"same-origin") not in (b"same-origin", b"none")
        if foreign and not (reading and headers.get(b"sec-fetch-mode") == b"navigate"):
            return 403, "another page sent this request; use the pages of rsvideo view itself"
        if not reading and not self._path(scope).startswith(UPLOADS):
            kind = headers.get(b"content-type", b"").split(b";")[0].strip().lower()
            if kind != b"application/json":
                return 415, "a request that changes something must be JSON; use the pages of rsvideo view itself"
            length = headers.get(b"content-length", b"")
            if not length.isdigit() or int(length[:20]) > MOST_BYTES:
                return (
                    413,
                    f"a request must state its length, at most {MOST_BYTES / 1e6:g} MB; files are dropped on the page for calibration",
                )
        return None

    def _path(self, scope: Scope) -> str:
        return scope["path"][1 + len(self._token) :] or "/"


def _single(headers: Iterable[tuple[bytes, bytes]]) -> dict[bytes, bytes]:
    """Headers by their names; one that is given twice is none that can be trusted."""
    found: dict[bytes, bytes] = {}
    for name, value in headers:
        found[name] = b"\0given twice" if name in found else value
    return found


def _with_headers(send: Send) -> Send:
    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            given = {name.lower() for name, _ in message["headers"]}
            ours = [(name.encode(), value.encode()) for name, value in _HEADERS.items() if name.encode() not in given]
            message = {**message, "headers": [*message["headers"], *ours]}
        await send(message)

    return sent


async def _pass_over(receive: Receive) -> None:
    """Take a body that nobody wants, up to a bound: a connection that is closed on unread bytes may lose the answer."""
    left = MOST_PASSED_OVER
    while left > 0:
        message = await receive()
        left -= len(message.get("body", b"")) + 1
        if not message.get("more_body", False):
            return


async def _refuse(send: Send, number: int, words: str) -> None:
    body = json.dumps({"error": words}).encode()
    headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode()), (b"connection", b"close")]
    headers += [(name.encode(), value.encode()) for name, value in _HEADERS.items()]
    await send({"type": "http.response.start", "status": number, "headers": headers})
    await send({"type": "http.response.body", "body": body})
