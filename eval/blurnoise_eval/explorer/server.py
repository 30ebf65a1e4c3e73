"""The server of the explorer: the page and its pictures, behind a gate that decides who is answered.

A request must name the address that is served (another site's page whose name has been rebound to this machine names
its own), come from no other origin, and carry the token of the printed URL, or the cookie that holds it from then
on. The applications inside see neither token nor refused request, on any route or socket.
"""

from __future__ import annotations

import asyncio
import hmac
import logging
import re
import secrets
import socket
import webbrowser
from collections.abc import Callable, Iterable
from importlib.resources import files
from ipaddress import ip_address
from urllib.parse import parse_qsl, urlencode
from weakref import WeakValueDictionary

import uvicorn
from fastapi import FastAPI, Request, Response
from nicegui import ui
from starlette.datastructures import MutableHeaders
from starlette.formparsers import MultiPartParser
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from blurnoise_eval.explorer.catalogue import MOST_UPLOADED_MB, Catalogue
from blurnoise_eval.explorer.page import Page, Session
from blurnoise_eval.explorer.state import State

_MOST_MB = MOST_UPLOADED_MB + 1
_POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; frame-ancestors 'none'; base-uri 'self'"
)
_HEADERS = {
    "Content-Security-Policy": _POLICY,
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
_NUMERIC = re.compile(r"\[[0-9a-f:.]+\]|\d{1,3}(\.\d{1,3}){3}")


class Gate:
    """names: host names and addresses (IPv6 in brackets) under which the page is served, at this port; any_address:
    also under every numeric address, which no DNS server can rebind."""

    def __init__(self, app: ASGIApp, names: Iterable[str], port: int, *, any_address: bool = False) -> None:
        self.app, self.token = app, secrets.token_urlsafe(24)
        self._names, self._port, self._any_address = {name.lower() for name in names}, f":{port}", any_address
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
                    cookie = f"{self._cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"
                    headers.append("Set-Cookie", cookie)
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
            return PlainTextResponse("Open the address that the explorer has printed, with its token.", 403)
        if "transfer-encoding" in headers or int(headers.get("content-length", 0)) > _MOST_MB << 20:
            return PlainTextResponse(f"The body must have a length, of at most {_MOST_MB} MB.", 413)
        return None

    def _serves(self, host: str) -> bool:
        name = host.lower().removesuffix(self._port)
        at_port = name != host.lower() or self._port == ":80"  # which a browser leaves out
        return at_port and (name in self._names or (self._any_address and bool(_NUMERIC.fullmatch(name))))


def serve(
    catalogue: Catalogue, usual: State, *, host: str, port: int, browser: bool, say: Callable[[str], None]
) -> None:
    """Serve until interrupted. port 0: any that is free. Raises ``OSError`` where the address is not available."""
    listening = socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    listening.set_inheritable(False)
    address, port = listening.getsockname()[:2]
    everywhere, local = ip_address(address).is_unspecified, ip_address(address).is_loopback
    names = [host, address, *(["localhost"] if local else [socket.gethostname()] if everywhere else [])]
    names = [f"[{name}]" if ":" in name else name for name in names]
    gate = Gate(app(catalogue, usual), names, port, any_address=everywhere)
    shown = {"0.0.0.0": "127.0.0.1", "[::]": "[::1]"}.get(names[0], names[0])
    url = f"http://{shown}:{port}/?{urlencode({'token': gate.token})}&{usual.query(catalogue.base)}"
    logging.getLogger("nicegui").setLevel(logging.ERROR)
    config = uvicorn.Config(
        gate,
        log_level="error",
        ws_max_size=1 << 20,
        ws_per_message_deflate=False,  # pictures are packed, and wait
        timeout_graceful_shutdown=2,
    )
    say(url)
    if browser:
        webbrowser.open(url)
    with listening:
        uvicorn.Server(config).run(sockets=[listening])


def app(catalogue: Catalogue, usual: State) -> FastAPI:
    """The application behind the gate."""
    made = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    sessions: WeakValueDictionary[str, Session] = WeakValueDictionary()
    style = (files("blurnoise_eval.explorer") / "explorer.css").read_text(encoding="utf-8")
    MultiPartParser.spool_max_size = MOST_UPLOADED_MB << 20  # uploads stay in memory

    @made.get("/pictures/{token}/{name}")
    def picture(token: str, name: str) -> Response:
        session = sessions.get(token)
        content = session.files.get(name) if session else None
        return Response(content, 200 if content else 404, media_type="image/png")

    @ui.page("/", title="blurnoise explorer")
    def explorer(request: Request) -> None:
        ui.add_css(style)
        state, wrong = catalogue.resolved(request.url.query) if request.url.query else (usual, ())
        page = Page(catalogue, state, "; ".join(wrong))
        sessions[page.session.token] = page.session
        running: list[asyncio.Task[None]] = []

        def begin() -> None:
            if not running:  # a browser may connect again
                running.append(asyncio.create_task(page.live()))

        ui.context.client.on_connect(begin)
        ui.context.client.on_delete(lambda: [task.cancel() for task in running] and None)

    ui.run_with(made, dark=None, show_welcome_message=False, reconnect_timeout=10, message_history_length=50)
    return made
