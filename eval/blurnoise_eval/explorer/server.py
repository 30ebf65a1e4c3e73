"""The server of the explorer: the page and its pictures, behind the gate."""

from __future__ import annotations

import asyncio
import logging
import socket
import webbrowser
from collections.abc import Callable
from importlib.resources import files
from ipaddress import ip_address
from urllib.parse import urlencode
from weakref import WeakValueDictionary

import uvicorn
from fastapi import FastAPI, Request, Response
from nicegui import ui
from starlette.formparsers import MultiPartParser

from blurnoise_eval.explorer.catalogue import MOST_UPLOADED_MB, Catalogue
from blurnoise_eval.explorer.gate import Gate
from blurnoise_eval.explorer.page import Page
from blurnoise_eval.explorer.state import State


def serve(
    catalogue: Catalogue, usual: State, *, host: str, port: int, browser: bool, say: Callable[[str], None]
) -> None:
    """Serve until interrupted. port 0: any that is free. Raises ``OSError`` where the address cannot be had."""
    listening = socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    listening.set_inheritable(False)
    address, port = listening.getsockname()[:2]
    everywhere, local = ip_address(address).is_unspecified, ip_address(address).is_loopback
    names = {host, address, *(("localhost",) if everywhere or local else ())}
    names |= {socket.gethostname(), f"{socket.gethostname()}.local"} if everywhere else set()
    gate = Gate(app(catalogue, usual), names, port, any_address=everywhere)
    seen_as = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    query = f"{urlencode({'token': gate.token})}&{usual.query(catalogue.base)}"
    url = f"http://{f'[{seen_as}]' if ':' in seen_as else seen_as}:{port}/?{query}"
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
    pages: WeakValueDictionary[str, Page] = WeakValueDictionary()
    folder = files("blurnoise_eval.explorer") / "static"
    style, script = ((folder / name).read_text(encoding="utf-8") for name in ("explorer.css", "explorer.js"))
    MultiPartParser.spool_max_size = max(MOST_UPLOADED_MB.values()) << 20  # uploads stay in memory

    @made.get("/pictures/{token}/{name}")
    def picture(token: str, name: str) -> Response:
        page = pages.get(token)
        content = page.session.file(name) if page else None
        if content is None:
            return Response(status_code=404)
        kept = {"Cache-Control": "private, max-age=600"}
        return Response(content, media_type="image/png", headers=kept)

    @ui.page("/", title="blurnoise explorer")
    def explorer(request: Request) -> None:
        ui.add_css(style)
        ui.add_body_html(f"<script>{script}</script>")
        state, wrong = catalogue.resolved(request.url.query) if request.url.query else (usual, ())
        page = Page(catalogue, state, usual, "; ".join(wrong))
        pages[page.session.token] = page
        running: list[asyncio.Task[None]] = []

        def begin() -> None:
            if not running:  # a browser may connect again
                running.append(asyncio.create_task(page.live()))

        ui.context.client.on_connect(begin)
        ui.context.client.on_delete(lambda: [task.cancel() for task in running] and None)

    made.router.on_shutdown.append(catalogue.close)
    ui.run_with(
        made,
        title="blurnoise explorer",
        dark=None,
        show_welcome_message=False,
        reconnect_timeout=10,
        message_history_length=50,
    )
    return made
