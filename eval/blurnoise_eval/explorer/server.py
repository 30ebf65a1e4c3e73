"""The server of the explorer: one person's page, on this machine only.

It listens on the loopback address. A request must name that address or localhost, so that the page of another site
whose name was rebound to this machine is refused, and every path begins with the token of the printed URL.

The server keeps no state of the page: a request has it all in its query. Requests are answered in threads, so that a
preview does not wait for a full picture.
"""

from __future__ import annotations

import asyncio
import json
import secrets
import signal
import socket
import webbrowser
from collections.abc import Awaitable, Callable, Iterator
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

import cv2
import numpy as np
import uvicorn
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from numpy.typing import NDArray
from plotly.offline import get_plotlyjs
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Mount, Route

from blurnoise_eval.explorer.catalogue import KINDS, Catalogue
from blurnoise_eval.explorer.state import State, text_of
from blurnoise_eval.explorer.verdict import window, window_sentence

LOOPBACK = "127.0.0.1"
MOST_DROPPED_MB = 128
TEMPLATES = Path(__file__).parent / "templates"
_POLICY = (
    "default-src 'self'; img-src 'self' blob: data:; style-src 'self' 'unsafe-inline'; "
    "script-src 'self' 'unsafe-inline'"
)
"""What the page may load: nothing from anywhere else."""
_EXPECTED = (ValueError, TypeError, OSError, MemoryError, RuntimeError, ClientDisconnect)
"""What is wrong with a state or a file, or too much for this machine; the page shows it as a line."""


def serve(
    catalogue: Catalogue, usual: State, *, port: int, browser: bool, say: Callable[[str], None]
) -> None:
    """Serve until interrupted. port 0: any that is free. Raises ``OSError`` where the port is taken."""
    listening = socket.create_server((LOOPBACK, port))
    token = secrets.token_urlsafe(24)
    url = f"http://{LOOPBACK}:{listening.getsockname()[1]}/{token}/?{usual.query(catalogue.base)}"
    config = uvicorn.Config(app(catalogue, usual, token), log_level="error", timeout_graceful_shutdown=2)
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


def app(catalogue: Catalogue, usual: State, token: str) -> Starlette:
    """The application, at the path of the token."""
    of_state = {
        "original.png": _original,
        "picture.png": _picture,
        "preview.jpg": _preview,
        "facts": _facts,
        "curve": _curve,
        "command": _command,
    }
    routes = [Route(f"/{name}", _guarded(answer, catalogue)) for name, answer in of_state.items()]
    routes += [
        Route("/", partial(_page, catalogue, usual)),
        Route("/plotly.js", _plotly),
        Route("/dropped", partial(_dropped, catalogue), methods=["POST"]),
    ]
    hosts = Middleware(TrustedHostMiddleware, allowed_hosts=[LOOPBACK, "localhost"], www_redirect=False)
    return Starlette(routes=[Mount(f"/{token}", routes=routes)], middleware=[hosts])


def _guarded(
    answer: Callable[[Catalogue, State], Response], catalogue: Catalogue
) -> Callable[[Request], Awaitable[Response]]:
    """A route that answers the state of its query, or with a line on what is wrong with it."""

    async def route(request: Request) -> Response:
        try:
            state = await run_in_threadpool(catalogue.start, request.url.query)
            return await run_in_threadpool(answer, catalogue, state)
        except _EXPECTED as error:
            return _refusal(error)

    return route


def _refusal(error: BaseException) -> Response:
    return PlainTextResponse(" ".join(str(error).split())[:400] or type(error).__name__, 422)


def _original(catalogue: Catalogue, state: State) -> Response:
    return _png(catalogue.subject(state).original)


def _picture(catalogue: Catalogue, state: State) -> Response:
    return _png(catalogue.frame(state).image)


def _png(image: NDArray[np.uint8]) -> Response:
    """Not compressed, which takes longer than the simulation."""
    flags = [cv2.IMWRITE_PNG_COMPRESSION, 0]
    return Response(cv2.imencode(".png", image[..., ::-1], flags)[1].tobytes(), media_type="image/png")


def _preview(catalogue: Catalogue, state: State) -> Response:
    """The smaller picture; nothing where there is none."""
    subject = catalogue.subject(state)
    try:
        if subject.smaller == 1:
            return Response(status_code=204)
        small = subject.preview(state, catalogue.camera(state))
    except ValueError:  # the full picture says what is wrong, if anything is
        return Response(status_code=204)
    return Response(cv2.imencode(".jpg", small[..., ::-1])[1].tobytes(), media_type="image/jpeg")


def _facts(catalogue: Catalogue, state: State) -> Response:
    """The query and the controls of a state, the figures of its picture, and the detections."""
    message = ""
    try:
        model = catalogue.model(state)
    except _EXPECTED as error:  # the picture is there without it
        model, message = None, str(error)
    rendered = catalogue.subject(state).rendered(catalogue.frame(state), model)
    scored, (good, verdict) = rendered.scored, rendered.verdict
    numbers = [
        (name, title, "none" if value is None else f"{value:.5g} {unit}")
        for name, (title, value, unit) in rendered.numbers.items()
    ]
    facts = {
        "query": state.query(catalogue.base),
        "controls": _controls(catalogue, state),
        "verdict": verdict,
        "good": good,
        "message": message,
        "numbers": numbers,
        "size": rendered.frame.image.shape[1::-1],
        "boxes": scored.boxes if scored else [],
        "original_boxes": scored.original_boxes if scored else [],
        "scored": scored is not None and bool(scored.counted.targets),
    }
    return JSONResponse(facts)


def _controls(catalogue: Catalogue, state: State) -> dict[str, tuple[str, int]]:
    """Text and position of each control."""
    camera = catalogue.camera(state)
    placed = {}
    for name, control in catalogue.controls(state).items():
        value = control.read(state, camera)
        placed[name] = text_of(control.axis, value), control.position(value)
    return placed


def _curve(catalogue: Catalogue, state: State) -> Response:
    """The curve of a state, as JSON after white space: a blank for each point, by which the server notices that the
    page no longer waits for it."""
    subject, camera, model = catalogue.subject(state), catalogue.camera(state), catalogue.model(state)
    rendered = subject.rendered(catalogue.frame(state), model)
    if model is None or rendered.scored is None:
        raise ValueError("model = 'none': has no curve")
    standard, at_ms = rendered.scored.standard, 1e3 * rendered.exposure.exposure_s

    def written() -> Iterator[str]:
        curve = []
        for point in subject.curve(state, camera, model):
            curve.append(point)
            yield " "
        document: dict[str, Any] = {"points": curve, "at_ms": at_ms, "required": standard.required}
        if curve:
            document["window"] = window(curve, standard.required, at_ms)
            document["sentence"] = window_sentence(curve, at_ms, standard)
        yield json.dumps(document)

    return StreamingResponse(written(), media_type="application/json")


def _command(catalogue: Catalogue, state: State) -> Response:
    return PlainTextResponse(catalogue.command(state))


async def _dropped(catalogue: Catalogue, request: Request) -> Response:
    """Take a picture; answers with its name, or with why not."""
    content, title = bytearray(), Path(request.query_params.get("name", "")).name[-80:] or "picture"
    try:
        async for part in request.stream():
            content += part
            if len(content) > MOST_DROPPED_MB << 20:
                raise ValueError(f"{title}: must be at most {MOST_DROPPED_MB} MB")
        return PlainTextResponse(await asyncio.to_thread(catalogue.take, title, bytes(content)))
    except _EXPECTED as error:
        return _refusal(error)


def _plotly(request: Request) -> Response:
    return Response(get_plotlyjs(), media_type="text/javascript", headers={"Cache-Control": "max-age=3600"})


def _page(catalogue: Catalogue, usual: State, request: Request) -> Response:
    """The page of a query; of one that is not allowed, the usual one with a line on it."""
    state, message = usual, ""
    try:
        state = catalogue.start(request.url.query) if request.url.query else usual
    except _EXPECTED as error:
        message = str(error)
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    shown = {
        "query": state.query(catalogue.base),
        "message": message,
        "controls": catalogue.controls(state),
        "placed": _controls(catalogue, state),
        "conditions": state.at,
        "lists": {kind: (getattr(state, kind), catalogue.titles(kind)) for kind in KINDS},
    }
    text = environment.get_template("explorer.html.j2").render(**shown)
    return Response(text, media_type="text/html", headers={"Content-Security-Policy": _POLICY})
