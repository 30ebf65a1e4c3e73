"""The server of the explorer: the page and its pictures, under a path that nobody can guess.

A request must name the address that is served (another site's page whose name has been rebound to this machine names
its own), and come from no other origin; on any route and socket. All routes begin with the token of the printed URL.
"""

from __future__ import annotations

import asyncio
import logging
import re
import secrets
import socket
import webbrowser
from collections.abc import Callable, Iterable
from ipaddress import ip_address
from pathlib import Path
from weakref import WeakValueDictionary

import uvicorn
from fastapi import FastAPI, Request, Response
from nicegui import ui
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.page import Page
from blurnoise_eval.explorer.state import State

_NUMERIC = re.compile(r"\[[0-9a-f:.]+\]|\d{1,3}(\.\d{1,3}){3}")


class Gate:
    """names: host names and addresses (IPv6 in brackets) under which the page is served, at this port; any_address:
    also under every numeric address, which no DNS server can rebind."""

    def __init__(self, app: ASGIApp, names: Iterable[str], port: int, *, any_address: bool = False) -> None:
        self.app = app
        self._names, self._port, self._any_address = {name.lower() for name in names}, f":{port}", any_address

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer it with a refusal."""
        refusal = self._refusal(HTTPConnection(scope)) if scope["type"] in ("http", "websocket") else None
        if refusal is None:
            await self.app(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})  # before it is accepted: HTTP's 403
        else:
            await refusal(scope, receive, send)

    def _refusal(self, request: HTTPConnection) -> PlainTextResponse | None:
        """Why the request is not answered; None where it is."""
        headers, hosts = request.headers, request.headers.getlist("host")
        if len(hosts) != 1 or not self._serves(hosts[0]):
            return PlainTextResponse("This address is not served here.", 421)
        if any(origin != f"http://{hosts[0]}" for origin in headers.getlist("origin")):
            return PlainTextResponse("Requests from other origins are not answered.", 403)
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
    ip, token = ip_address(address), secrets.token_urlsafe(24)
    local = ["localhost"] if ip.is_loopback or ip.is_unspecified else []
    names = [f"[{name}]" if ":" in name else name for name in (host, address, *local)]
    shown = "localhost" if ip.is_unspecified else names[0]
    url = f"http://{shown}:{port}/{token}/?{usual.query(catalogue.base)}"
    logging.getLogger("nicegui").setLevel(logging.ERROR)
    config = uvicorn.Config(
        Gate(app(catalogue, usual, token), names, port, any_address=ip.is_unspecified),
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


def app(catalogue: Catalogue, usual: State, token: str) -> FastAPI:
    """The application behind the gate, at the path of the token."""
    made = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    pages: WeakValueDictionary[str, Page] = WeakValueDictionary()
    if run := catalogue.run:
        _ = [run.means(name) for name in run.models]  # before a page waits for it

    @made.get(f"/{token}/pictures/{{of}}/{{name}}")
    def picture(of: str, name: str) -> Response:
        content = pages[of].files.get(name) if of in pages else None
        return Response(content, 200 if content else 404, media_type="image/png")

    @ui.page("/", title="blurnoise explorer")
    def explorer(request: Request) -> None:
        ui.add_css(Path(__file__).with_name("explorer.css"))
        state, note = usual, ""
        try:
            state = catalogue.start(request.url.query) if request.url.query else usual
        except (ValueError, TypeError) as error:
            note = str(error)
        page = Page(catalogue, state, note)
        pages[page.name] = page
        running: list[asyncio.Task[None]] = []

        def begin() -> None:
            if not running:  # a browser may connect again
                running.append(asyncio.create_task(page.live()))

        ui.context.client.on_connect(begin)
        ui.context.client.on_delete(lambda: [task.cancel() for task in running] and None)

    ui.run_with(
        made,
        mount_path=f"/{token}",
        dark=None,
        show_welcome_message=False,
        reconnect_timeout=10,
        message_history_length=50,
    )
    return made
