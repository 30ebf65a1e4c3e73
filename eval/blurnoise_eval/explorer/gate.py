"""The gate of the explorer: the ASGI application around the page's, which decides who is answered.

A request must name the address that is served (another site's page whose name has been rebound to this machine names
its own), come from no other origin, and carry the token of the printed URL or the cookie that the token was exchanged
for. The cookie names the visitor; the applications inside find that name in the scope, under "visitor". They see
neither token nor refused request, on any route or socket.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Iterable
from ipaddress import ip_address
from urllib.parse import parse_qsl, urlencode

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

UPLOADS = "/uploads/"
"""Where bodies may be larger than ``_MOST_BYTES``: that route has limits of its own."""
_MOST_BYTES = 1 << 20
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self'; font-src 'self' data:; "
    "frame-ancestors 'none'; base-uri 'self'; form-action 'self'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class Gate:
    """names: host names and addresses under which the page is served, at this port; any_address: also under every
    numeric address, which no DNS server can rebind."""

    def __init__(self, app: ASGIApp, names: Iterable[str], port: int, *, any_address: bool = False) -> None:
        self.app = app
        self.token = secrets.token_urlsafe(24)
        self._names, self._port, self._any_address = {name.lower() for name in names}, port, any_address
        self._cookie = f"blurnoise-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer it with a refusal."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        asked = HTTPConnection(scope)
        query = parse_qsl(asked.url.query, keep_blank_values=True)
        tokens = [value for name, value in query if name == "token"] if scope["path"] == "/" else []
        known = self._visitor(asked)
        visitor = known or secrets.token_hex(16)

        async def answer(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.update(_HEADERS)
                if tokens and not refused:
                    kept = f"{self._cookie}={visitor}.{self._signed(visitor)}"
                    headers.append("Set-Cookie", f"{kept}; Path=/; HttpOnly; SameSite=Strict")
            await send(message)

        refused = self._refused(asked, tokens, known)
        if refused is not None and scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})  # before it is accepted: HTTP's 403
            return
        if refused is not None:
            await refused(scope, receive, answer)
            return
        rest = urlencode([(name, value) for name, value in query if name != "token"])
        inside = {**scope, "visitor": visitor, **({"query_string": rest.encode()} if tokens else {})}
        await self.app(inside, receive, answer)

    def _refused(self, asked: HTTPConnection, tokens: list[str], known: str) -> PlainTextResponse | None:
        """Why the request is not answered; None where it is."""
        headers = asked.headers
        hosts = headers.getlist("host")
        if len(hosts) != 1 or not self._serves(hosts[0]):
            return PlainTextResponse("This address is not served here.", 421)
        if any(origin != f"http://{hosts[0]}" for origin in headers.getlist("origin")):
            return PlainTextResponse("Requests from other origins are not answered.", 403)
        if tokens:
            entitled = all(hmac.compare_digest(each.encode(), self.token.encode()) for each in tokens)
        else:
            entitled = bool(known) and headers.get("sec-fetch-site", "none") in ("same-origin", "none")
        if not entitled:
            told = "Open the address that the explorer has printed, with its token."
            return PlainTextResponse(told, 403)
        if asked.scope["path"].startswith(UPLOADS) or "content-length" not in headers:
            chunked = "transfer-encoding" in headers and not asked.scope["path"].startswith(UPLOADS)
            return PlainTextResponse("Content-Length is required.", 411) if chunked else None
        large = int(headers["content-length"]) > _MOST_BYTES
        return PlainTextResponse(f"The body must be at most {_MOST_BYTES} bytes.", 413) if large else None

    def _serves(self, host: str) -> bool:
        name, colon, port = host.lower().rpartition(":")
        if not colon or host.endswith("]"):  # a browser leaves out port 80
            name, port = host.lower(), "80"
        name = name.removeprefix("[").removesuffix("]")
        return port == str(self._port) and (name in self._names or (self._any_address and _is_address(name)))

    def _visitor(self, asked: HTTPConnection) -> str:
        """Whom the cookie names; "" where there is none, or it is not from here."""
        visitor, _, signed = asked.cookies.get(self._cookie, "").partition(".")
        return visitor if hmac.compare_digest(signed.encode(), self._signed(visitor).encode()) else ""

    def _signed(self, visitor: str) -> str:
        return hmac.new(self.token.encode(), visitor.encode(), "sha256").hexdigest()


def _is_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True
