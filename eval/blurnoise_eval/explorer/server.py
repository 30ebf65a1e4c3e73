"""The server of the explorer: one person's page, on this machine only.

It listens on the loopback address. A request must name that address or localhost, so that the page of another site
whose name was rebound to this machine is refused, and every path begins with the token of the printed URL.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
import signal
import socket
import webbrowser
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import uvicorn
from fastapi import FastAPI, Request, Response
from nicegui import ui
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import ClientDisconnect

from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.page import Page
from blurnoise_eval.explorer.state import State

LOOPBACK = "127.0.0.1"
MOST_DROPPED_MB = 128


def serve(
    catalogue: Catalogue, usual: State, *, port: int, browser: bool, say: Callable[[str], None]
) -> None:
    """Serve until interrupted. port 0: any that is free. Raises ``OSError`` where the port is taken."""
    listening = socket.create_server((LOOPBACK, port))
    token = secrets.token_urlsafe(24)
    url = f"http://{LOOPBACK}:{listening.getsockname()[1]}/{token}/?{usual.query(catalogue.base)}"
    logging.getLogger("nicegui").setLevel(logging.ERROR)
    config = uvicorn.Config(
        app(catalogue, usual, token),
        log_level="error",
        ws_per_message_deflate=False,  # pictures are packed, and wait
        timeout_graceful_shutdown=2,
    )
    say(url)
    if browser:
        webbrowser.open(url)
    with listening:
        _Server(config).run(sockets=[listening])


class _Server(uvicorn.Server):
    """The second signal ends the process at once, as of any command: uvicorn's own way out prints tracebacks."""

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        if self.should_exit:
            signal.signal(sig, signal.SIG_DFL)
            signal.raise_signal(sig)
        super().handle_exit(sig, frame)


def app(catalogue: Catalogue, usual: State, token: str) -> FastAPI:
    """The application, at the path of the token."""
    made = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    made.add_middleware(TrustedHostMiddleware, allowed_hosts=[LOOPBACK, "localhost"], www_redirect=False)
    files = dict[str, bytes]()
    folder = Path(__file__).parent
    if run := catalogue.run:
        _ = [run.means(name) for name in run.models]  # before a page waits for it

    @made.get(f"/{token}/pictures/{{name}}")
    def picture(name: str) -> Response:
        content = files.get(name)
        return Response(content, 200 if content else 404, media_type="image/png")

    @made.post(f"/{token}/dropped")
    async def dropped(request: Request, name: str) -> Response:
        """Take a picture; answers with its name, or with why not."""
        content, title = bytearray(), Path(name).name[-80:] or "picture"
        try:
            async for part in request.stream():
                content += part
                if len(content) > MOST_DROPPED_MB << 20:
                    raise ValueError(f"{title}: must be at most {MOST_DROPPED_MB} MB")
            return Response(await asyncio.to_thread(catalogue.take, title, bytes(content)))
        except (ValueError, OSError, MemoryError, ClientDisconnect) as error:
            return Response(str(error), 422)

    @ui.page("/", title="blurnoise explorer")
    def explorer(request: Request) -> None:
        ui.add_css(folder / "explorer.css")
        ui.add_body_html(f"<script>{(folder / 'explorer.js').read_text(encoding='utf-8')}</script>")
        state, note = usual, ""
        try:
            state = catalogue.start(request.url.query) if request.url.query else usual
        except (ValueError, TypeError) as error:
            note = str(error)
        page = Page(catalogue, state, files, note)
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
