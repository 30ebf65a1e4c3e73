"""The server of the explorer: the page, its pictures and its uploads, behind the gate."""

from __future__ import annotations

import asyncio
import logging
import signal
import socket
import sys
import webbrowser
from collections.abc import Callable
from importlib.resources import files
from ipaddress import ip_address
from urllib.parse import urlencode
from weakref import WeakValueDictionary

import uvicorn
from fastapi import FastAPI, Request, Response
from nicegui import ui
from starlette.requests import ClientDisconnect

from blurnoise_eval.explorer.gate import UPLOADS, Gate
from blurnoise_eval.explorer.page import Page
from blurnoise_eval.explorer.shelf import MOST_UPLOADED_MB, Shelf, clear_stale_uploads, held
from blurnoise_eval.explorer.state import State

_RECEIVED = 4
"""Uploads that come in at a time, one of a visitor: they are held in memory."""
_RECEIVED_S = 120.0
_TYPES = {"png": "image/png", "jpg": "image/jpeg"}


def serve(
    shelf: Shelf, usual: State, *, host: str, port: int, browser: bool, say: Callable[[str], None]
) -> None:
    """Serve until interrupted. port 0: any that is free. Raises ``OSError`` where the address cannot be had."""
    clear_stale_uploads()
    listening = socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    listening.set_inheritable(False)
    address, port = listening.getsockname()[:2]
    everywhere, local = ip_address(address).is_unspecified, ip_address(address).is_loopback
    names = {host, address, *(("localhost",) if everywhere or local else ())}
    names |= {socket.gethostname(), f"{socket.gethostname()}.local"} if everywhere else set()
    gate = Gate(_app(shelf, usual), names, port, any_address=everywhere)
    seen_as = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    query = "&".join(filter(None, (urlencode({"token": gate.token}), usual.query())))
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
    # uvicorn ends at SIGTERM and then raises it again: as an exit, so that uploads are removed
    handled = [signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))]
    handled += [signal.signal(signal.SIGHUP, lambda *_: signal.raise_signal(signal.SIGTERM))]
    try:
        uvicorn.Server(config).run(sockets=[listening])
    finally:
        listening.close()
        shelf.close()
        for number, handler in zip((signal.SIGTERM, signal.SIGHUP), handled, strict=True):
            signal.signal(number, handler)


def _app(shelf: Shelf, usual: State) -> FastAPI:
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    pages: WeakValueDictionary[str, Page] = WeakValueDictionary()
    receiving: set[str] = set()
    folder = files("blurnoise_eval.explorer") / "static"
    style, script = ((folder / name).read_text(encoding="utf-8") for name in ("explorer.css", "explorer.js"))

    def page_of(request: Request, token: str) -> Page | None:
        page = pages.get(token)
        return page if page is not None and page.shelf.visitor == request.scope["visitor"] else None

    @app.get("/pictures/{token}/{name}")
    def picture(request: Request, token: str, name: str) -> Response:
        page = page_of(request, token)
        content = page.visit.file(name) if page else None
        if content is None:
            return Response(status_code=404)
        kept = {"Cache-Control": "private, max-age=600"}
        return Response(content, media_type=_TYPES[name.rpartition(".")[2]], headers=kept)

    @app.post(f"{UPLOADS}{{token}}/{{kind}}")
    async def upload(request: Request, token: str, kind: str, name: str) -> Response:
        page = page_of(request, token)
        if page is None or kind not in MOST_UPLOADED_MB:
            return Response(status_code=404)
        if int(request.headers.get("content-length", 0)) > MOST_UPLOADED_MB[kind] * 2**20:
            return refused(page, name, kind)
        visitor = page.shelf.visitor
        if visitor in receiving or len(receiving) >= _RECEIVED:
            page.fails(f"{name[-80:]}: another upload is still coming in; try again")
            return Response(status_code=429)
        receiving.add(visitor)
        try:
            content = await asyncio.wait_for(_received(request, MOST_UPLOADED_MB[kind] * 2**20), _RECEIVED_S)
            if content is None:
                return refused(page, name, kind)
            await page.uploaded(kind, name, content)
        except (ClientDisconnect, TimeoutError):
            return Response(status_code=400)
        finally:
            receiving.discard(visitor)
        return Response(status_code=204)

    def refused(page: Page, name: str, kind: str) -> Response:
        page.fails(f"{name[-80:]}: must be at most {MOST_UPLOADED_MB[kind]} MB")
        return Response(status_code=413)

    @ui.page("/", title="blurnoise explorer")
    def explorer(request: Request) -> None:
        ui.add_css(style)
        ui.add_body_html(f"<script>{script}</script>")
        own, state, note = shelf.of(request.scope["visitor"]), usual, ""
        if request.url.query:
            asked, wrong = State.of_query(request.url.query)
            state, lacking = held(own, asked, usual)
            note = "; ".join((*wrong, *lacking))
        page = Page(own, state, usual, note)
        pages[page.visit.token] = page
        running: list[asyncio.Task[None]] = []

        def begin() -> None:
            if not running:  # a browser may connect again
                running.append(asyncio.create_task(page.live()))

        ui.context.client.on_connect(begin)
        ui.context.client.on_delete(lambda: [task.cancel() for task in running] and None)

    ui.run_with(
        app,
        title="blurnoise explorer",
        dark=None,
        tailwind=True,
        show_welcome_message=False,
        reconnect_timeout=10,
    )
    return app


async def _received(request: Request, most: int) -> bytes | None:
    """The body; None as soon as it is longer than ``most`` bytes."""
    content = bytearray()
    async for chunk in request.stream():
        content += chunk
        if len(content) > most:
            return None
    return bytes(content)
