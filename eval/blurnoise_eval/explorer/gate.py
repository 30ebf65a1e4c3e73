"""The gate of the explorer: the ASGI application around the page's, which decides who is answered.

A request must name the address that is served (another site's page whose name has been rebound to this machine names
its own), come from no other origin, and carry the token of the printed URL, or the cookie that holds it from then
on. The applications inside see neither token nor refused request, on any route or socket.
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

_UPLOADS = "/_nicegui/client/"
_MOST_MB, _MOST_UPLOADED_MB = 1, 129
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
        self.app, self.token = app, secrets.token_urlsafe(24)
        self._names, self._port, self._any_address = {name.lower() for name in names}, port, any_address
        self._cookie = f"blurnoise-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer it with a refusal."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        request = HTTPConnection(scope)
        query = parse_qsl(request.url.query, keep_blank_values=True)
        tokens = [value for name, value in query if name == "token"] if scope["path"] == "/" else []
        refusal = self._refusal(request, tokens)

        async def answer(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.update(_HEADERS)
                if tokens and not refusal:
                    kept = f"{self._cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"
                    headers.append("Set-Cookie", kept)
            await send(message)

        if refusal and scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})  # before it is accepted: HTTP's 403
        elif refusal:
            await refusal(scope, receive, answer)
        else:
            rest = urlencode([(name, value) for name, value in query if name != "token"])
            await self.app({**scope, "query_string": rest.encode()} if tokens else scope, receive, answer)

    def _refusal(self, request: HTTPConnection, tokens: list[str]) -> PlainTextResponse | None:
        """Why the request is not answered; None where it is."""
        headers, hosts = request.headers, request.headers.getlist("host")
        if len(hosts) != 1 or not self._serves(hosts[0]):
            return PlainTextResponse("This address is not served here.", 421)
        if any(origin != f"http://{hosts[0]}" for origin in headers.getlist("origin")):
            return PlainTextResponse("Requests from other origins are not answered.", 403)
        given = tokens or [request.cookies.get(self._cookie, "")]
        known = all(hmac.compare_digest(each.encode(), self.token.encode()) for each in given)
        if not known or not (tokens or headers.get("sec-fetch-site", "none") in ("same-origin", "none")):
            told = "Open the address that the explorer has printed, with its token."
            return PlainTextResponse(told, 403)
        if "transfer-encoding" in headers:
            return PlainTextResponse("Content-Length is required.", 411)
        most_mb = _MOST_UPLOADED_MB if request.url.path.startswith(_UPLOADS) else _MOST_MB
        large = int(headers.get("content-length", 0)) > most_mb << 20
        return PlainTextResponse(f"The body must be at most {most_mb} MB.", 413) if large else None

    def _serves(self, host: str) -> bool:
        name, colon, port = host.lower().rpartition(":")
        if not colon or host.endswith("]"):  # a browser leaves out port 80
            name, port = host.lower(), "80"
        name = name.removeprefix("[").removesuffix("]")
        return port == str(self._port) and (name in self._names or (self._any_address and _is_address(name)))


def _is_address(name: str) -> bool:
    try:
        ip_address(name)
    except ValueError:
        return False
    return True
