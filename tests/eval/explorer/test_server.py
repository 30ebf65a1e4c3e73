"""The explorer's server: what holds while it serves, what is freed, and what it takes."""

from __future__ import annotations

import asyncio
import gc
import re
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.datasets import encode
from blurnoise_eval.explorer import shelf as shelves
from blurnoise_eval.explorer.shelf import Shelf
from blurnoise_eval.explorer.state import State
from blurnoise_models.detector import STOP_SIGN

uvicorn = pytest.importorskip("uvicorn")
nicegui = pytest.importorskip("nicegui")
from blurnoise_eval.explorer import page, server  # noqa: E402  # need NiceGUI
from blurnoise_eval.explorer.gate import Gate  # noqa: E402
from starlette.testclient import TestClient  # noqa: E402

PNG = encode(np.random.default_rng(0).integers(0, 255, (40, 52, 3), np.uint8))
QUIET = State(model="none")


@pytest.fixture(scope="module")
def shelf() -> Iterator[Shelf]:
    found = Shelf(STOP_SIGN)
    yield found
    found.close()


@pytest.fixture(scope="module")
def visitor(shelf: Shelf) -> Iterator[TestClient]:
    gate = Gate(server._app(shelf, QUIET), ("127.0.0.1",), 80)
    with TestClient(gate, base_url="http://127.0.0.1") as client:
        client.params = {"token": gate.token}
        client.get("/")
        client.params = {}
        yield client


def uploads(visitor: TestClient) -> str:
    """The address of a page's uploads."""
    found = re.search(r"/uploads/\w+/", visitor.get("/").text)
    assert found
    return found[0]


def served(shelf: Shelf, monkeypatch: pytest.MonkeyPatch, run: Callable[[], object]) -> str:
    """What is printed by an explorer that does this in place of serving."""
    made = SimpleNamespace(run=lambda sockets: run())  # NiceGUI looks for real ones in all memory
    monkeypatch.setattr(uvicorn, "Server", lambda config: made)
    said: list[str] = []
    server.serve(shelf, State(), host="127.0.0.1", port=0, browser=False, say=said.append)
    return said[0]


def test_the_printed_address_holds_a_token(monkeypatch: pytest.MonkeyPatch) -> None:
    said = served(Shelf(STOP_SIGN), monkeypatch, lambda: None)
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=[\w-]{32}", said)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_it_and_its_uploads(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """uvicorn raises SIGTERM once more after it has ended; it does not know SIGHUP."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    before = [signal.getsignal(each) for each in (signal.SIGTERM, signal.SIGHUP)]

    shelf = Shelf(STOP_SIGN)

    def run() -> None:
        shelf.of("a").take("picture", "a.png", PNG)
        assert list(tmp_path.glob("*/*/a.png"))
        signal.raise_signal(number)

    with pytest.raises(SystemExit) as end:
        served(shelf, monkeypatch, run)
    assert end.value.code == 128 + signal.SIGTERM
    assert list(tmp_path.iterdir()) == []
    assert [signal.getsignal(each) for each in (signal.SIGTERM, signal.SIGHUP)] == before


def pages() -> int:
    """How many are in memory."""
    return sum(type(each) is page.Page for each in gc.get_objects())


def test_pages_whose_browser_never_connects_are_freed(visitor: TestClient) -> None:
    """NiceGUI drops their clients after a minute; nothing else may hold a page."""
    for _ in range(3):
        assert visitor.get("/").status_code == 200
    assert visitor.portal is not None
    visitor.portal.call(partial(nicegui.Client.prune_instances, client_age_threshold=0))
    assert not nicegui.Client.instances
    end = time.monotonic() + 20  # whoever awaited such a client goes on; its queue ends within a second
    while pages() and time.monotonic() < end:
        time.sleep(0.2)
        gc.collect()
    assert pages() == 0


def test_a_picture_is_taken_for_this_visitor_alone(visitor: TestClient, shelf: Shelf) -> None:
    where = uploads(visitor)
    assert visitor.post(f"{where}picture?name=a%20b.png", content=PNG).status_code == 204
    (item,) = shelf._items["picture"].values()
    assert (item.title, len(item.visitor)) == ("a b.png", 32)
    assert "a b.png" in visitor.get("/").text
    cookies = dict(visitor.cookies)
    other = TestClient(visitor.app, base_url="http://127.0.0.1")
    assert other.get("/", params={"token": visitor.app.token}).status_code == 200  # type: ignore[attr-defined]
    assert dict(other.cookies) != cookies
    assert "a b.png" not in other.get("/").text
    assert other.post(f"{where}picture?name=c.png", content=PNG).status_code == 404


@pytest.mark.parametrize(("kind", "status"), [("model", 404), ("wild", 404), ("../picture", 404)])
def test_nothing_else_is_uploaded(kind: str, status: int, visitor: TestClient) -> None:
    assert visitor.post(f"{uploads(visitor)}{kind}?name=mine.onnx", content=b"a").status_code == status
    assert visitor.post("/uploads/0/picture?name=a.png", content=PNG).status_code == 404


def test_an_upload_is_refused_by_its_size_before_it_is_read(
    visitor: TestClient, monkeypatch: pytest.MonkeyPatch, shelf: Shelf
) -> None:
    """By what the request says, and, where it says nothing, as soon as too much has come."""
    monkeypatch.setattr(Shelf, "take", None)
    said: list[str] = []
    monkeypatch.setattr(page.Page, "fails", lambda _, told: said.append(told))
    where = f"{uploads(visitor)}camera?name=a.yaml"
    sent = 0

    def endless() -> Iterator[bytes]:
        nonlocal sent
        while sent < 9:
            sent += 1
            yield bytes(1 << 18)

    assert visitor.post(where, content=b"", headers={"content-length": str(1 + 2**20)}).status_code == 413
    assert visitor.post(where, content=endless()).status_code == 413
    assert said == ["a.yaml: must be at most 1 MB"] * 2
    assert shelves.MOST_UPLOADED_MB["camera"] == 1


def test_few_uploads_come_in_at_a_time_and_none_for_ever(
    visitor: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second one of a visitor waits for the first, which ends, though its sender never does."""
    monkeypatch.setattr(server, "_RECEIVED_S", 1.0)
    where = f"{uploads(visitor)}picture?name=a.png"
    app, said = visitor.app, list[int]()
    scope = {"type": "http", "method": "POST", "path": where.partition("?")[0], "query_string": b"name=a.png",
             "headers": [(b"host", b"127.0.0.1"), (b"cookie", cookie(visitor))], "http_version": "1.1",
             "scheme": "http", "server": ("127.0.0.1", 80), "root_path": ""}  # fmt: skip

    async def slow() -> None:
        async def receive() -> dict[str, Any]:
            await asyncio.sleep(1e6)
            return {}

        async def send(message: Any) -> None:
            said.append(message.get("status", 0))

        asked = asyncio.create_task(app(scope, receive, send))
        await asyncio.sleep(0.1)
        await app(scope, receive, send)
        await asked

    assert visitor.portal is not None
    visitor.portal.call(slow)
    assert [status for status in said if status] == [429, 400]
    assert visitor.post(where, content=PNG).status_code == 204


def cookie(visitor: TestClient) -> bytes:
    return "; ".join(f"{name}={value}" for name, value in visitor.cookies.items()).encode()


@pytest.mark.parametrize("query", ["lux=own", "exposure-ms=own", "lux=own&exposure-ms=own&dx=own&gain=own"])
def test_what_no_camera_has_is_told(query: str, visitor: TestClient) -> None:
    answer = visitor.get(f"/?{query}")
    assert answer.status_code == 200
    assert f"{query.partition('=')[0]} = &#39;own&#39;: must be &gt;" in answer.text.replace("'", "&#39;")
