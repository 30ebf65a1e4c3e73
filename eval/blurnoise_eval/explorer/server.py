"""The server of the explorer: the page and its pictures, on this machine alone unless told otherwise."""

from __future__ import annotations

import asyncio
import logging
import socket
import webbrowser
from collections.abc import Callable
from importlib.resources import files
from weakref import WeakValueDictionary

import uvicorn
from fastapi import FastAPI, Request, Response
from nicegui import ui

from blurnoise._core.compiled_ways import compiled_ways
from blurnoise_eval.explorer.page import Page
from blurnoise_eval.explorer.shelf import Shelf, held
from blurnoise_eval.explorer.state import State
from blurnoise_eval.explorer.visit import Visit

_TYPES = {"png": "image/png", "jpg": "image/jpeg"}
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self' ws: wss:; font-src 'self' data:; "
    "frame-ancestors 'none'; base-uri 'self'"
)


def serve(
    shelf: Shelf, usual: State, *, host: str, port: int, browser: bool, say: Callable[[str], None]
) -> None:
    """Serve until interrupted. port 0: any that is free. Raises ``OSError`` where the address cannot be had."""
    listening = socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    listening.set_inheritable(False)
    seen_as = f"[{host}]" if ":" in host else {"0.0.0.0": "127.0.0.1"}.get(host, host)
    url = f"http://{seen_as}:{listening.getsockname()[1]}/"
    logging.getLogger("nicegui").setLevel(logging.ERROR)
    config = uvicorn.Config(
        _app(shelf, usual),
        log_level="error",
        ws_max_size=1 << 20,
        ws_per_message_deflate=False,  # pictures are packed, and wait
        timeout_graceful_shutdown=2,
    )
    query = usual.query()
    say(f"{url}{f'?{query}' if query else ''}")
    if browser:
        webbrowser.open(f"{url}{f'?{query}' if query else ''}")
    try:
        with compiled_ways("never"):  # loading them would hold up a slider for seconds
            uvicorn.Server(config).run(sockets=[listening])
    finally:
        listening.close()
        shelf.close()


def _app(shelf: Shelf, usual: State) -> FastAPI:
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    visits: WeakValueDictionary[str, Visit] = WeakValueDictionary()
    folder = files("blurnoise_eval.explorer") / "static"
    style, script = ((folder / name).read_text(encoding="utf-8") for name in ("explorer.css", "explorer.js"))

    @app.get("/pictures/{token}/{name}")
    def picture(token: str, name: str) -> Response:
        visit = visits.get(token)
        content = visit.file(name) if visit else None
        if content is None:
            return Response(status_code=404)
        kept = {"Cache-Control": "private, max-age=600", "X-Content-Type-Options": "nosniff"}
        return Response(content, media_type=_TYPES[name.rpartition(".")[2]], headers=kept)

    @app.middleware("http")
    async def guarded(request: Request, call_next: Callable[..., object]) -> Response:
        response: Response = await call_next(request)  # type: ignore[misc]
        response.headers["Content-Security-Policy"] = _POLICY
        response.headers["Referrer-Policy"] = "no-referrer"
        return response

    @ui.page("/", title="blurnoise explorer", response_timeout=60)
    async def explorer(request: Request) -> None:
        ui.add_css(style)
        ui.add_body_html(f"<script>{script}</script>")
        state, note = usual, ""
        if request.url.query:
            asked, wrong = State.of_query(request.url.query)
            state, lacking = held(shelf, asked, usual)
            note = "; ".join((*wrong, *lacking))
        page = Page(shelf, state, usual, note)
        visits[page.visit.token] = page.visit
        client = ui.context.client
        await client.connected(timeout=60)
        running = asyncio.create_task(page.live())
        client.on_delete(lambda: running.cancel())

    ui.run_with(
        app,
        title="blurnoise explorer",
        dark=None,
        tailwind=True,
        show_welcome_message=False,
        reconnect_timeout=10,
    )
    return app
