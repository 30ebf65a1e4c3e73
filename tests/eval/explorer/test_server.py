"""The explorer's server: who is answered, on routes and sockets, what is printed, freed and taken."""

from __future__ import annotations

import gc
import json
import re
import time
from collections.abc import Iterator
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from blurnoise_eval.datasets import encode
from blurnoise_eval.explorer.catalogue import Catalogue
from blurnoise_eval.explorer.state import State

uvicorn = pytest.importorskip("uvicorn")
nicegui = pytest.importorskip("nicegui")
from blurnoise_eval.explorer import page, server  # noqa: E402  # need NiceGUI
from blurnoise_eval.explorer.server import Gate  # noqa: E402
from starlette.testclient import TestClient  # noqa: E402
from starlette.types import Receive, Scope, Send  # noqa: E402
from starlette.websockets import WebSocket, WebSocketDisconnect  # noqa: E402

UPLOADS = "/_nicegui/client/"
OWN = "http://127.0.0.1:8123"
FOREIGN = "http://evil.example"


async def inside(scope: Scope, receive: Receive, send: Send) -> None:
    """An application that answers everybody with what it sees of the request."""
    seen = {"query": scope["query_string"].decode()}
    if scope["type"] == "websocket":
        socket = WebSocket(scope, receive, send)
        await socket.accept()
        await socket.send_json(seen)
        await socket.close()
        return
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": json.dumps(seen).encode()})


@pytest.fixture
def gate() -> Gate:
    return Gate(inside, ("127.0.0.1", "localhost"), 8123)


def opened(gate: Gate, address: str = OWN, **more: Any) -> TestClient:
    """Somebody who has opened the printed address."""
    client = TestClient(gate, base_url=address, **more)
    assert client.get(f"/?token={gate.token}").status_code == 200
    return client


def socket_opens(client: TestClient, **headers: str) -> bool:
    address = str(client.base_url).replace("http", "ws", 1)
    try:
        with client.websocket_connect(f"{address}/_nicegui_ws/socket.io/", headers=headers) as socket:
            return bool(socket.receive_json())
    except WebSocketDisconnect:
        return False


@pytest.mark.parametrize("path", ["/", "/pictures/a/b.png", "/_nicegui_ws/socket.io/", "/favicon.ico"])
def test_without_the_token_nothing_is_answered(gate: Gate, path: str) -> None:
    stranger = TestClient(gate, base_url=OWN)
    for query in ("", "?token=", "?token=wrong", f"?token={gate.token}x", f"?token=x&token={gate.token}"):
        assert stranger.get(path + query).status_code == 403
    assert not socket_opens(stranger, origin=OWN)
    assert "set-cookie" not in stranger.get("/?token=wrong").headers


def test_the_token_opens_the_page_alone_and_a_cookie_the_rest(gate: Gate) -> None:
    stranger = TestClient(gate, base_url=OWN)
    assert stranger.get(f"/pictures/a/b.png?token={gate.token}").status_code == 403
    first = stranger.get(f"/?token={gate.token}&lux=7&figure=prnu%3D0.1")
    assert first.json()["query"] == "lux=7&figure=prnu%3D0.1"
    cookie = first.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert stranger.get("/pictures/a/b.png").status_code == 200
    assert stranger.get("/?token=wrong").status_code == 403
    assert socket_opens(stranger, origin=OWN)


def test_a_cookie_of_ones_own_making_opens_nothing(gate: Gate) -> None:
    (name, kept) = next(iter(opened(gate).cookies.items()))
    for made in ("", ".", kept[:-1], f"{kept}1", "\xe9.\xe9"):
        stranger = TestClient(gate, base_url=OWN)
        cookie = f"{name}={made}".encode("latin-1")
        assert stranger.get("/", headers=[(b"cookie", cookie)]).status_code == 403  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:8123", "127.0.0.1", "127.0.0.1:80", "127.0.0.1:8123.evil.example", "",
     "10.0.0.7:8123", "127.0.0.1.evil.example:8123", "[::1]:8123", "localhost.:8123"],
)  # fmt: skip
def test_another_name_rebound_to_this_machine_is_not_answered(gate: Gate, host: str) -> None:
    client = opened(gate)
    cookie = "; ".join(f"{name}={value}" for name, value in client.cookies.items())
    for path in ("/", f"/?token={gate.token}", "/pictures/a/b.png", "/_nicegui_ws/socket.io/?EIO=4"):
        assert client.get(path, headers={"host": host, "cookie": cookie}).status_code == 421
        assert client.post(path, headers={"host": host, "cookie": cookie}).status_code == 421
    assert not socket_opens(client, host=host, cookie=cookie, origin=f"http://{host}")


@pytest.mark.parametrize("origin", [FOREIGN, "null", "", "https://127.0.0.1:8123", "http://127.0.0.1:8124"])
def test_other_origins_are_not_answered(gate: Gate, origin: str) -> None:
    client = opened(gate)
    assert client.get(f"/?token={gate.token}", headers={"origin": origin}).status_code == 403
    assert client.post(f"{UPLOADS}a/upload/1", headers={"origin": origin}).status_code == 403
    assert not socket_opens(client, origin=origin)
    assert client.post(f"{UPLOADS}a/upload/1", headers={"origin": OWN}).status_code == 200


def test_pictures_and_frames_in_pages_of_other_ports_are_not_answered(gate: Gate) -> None:
    """Their requests carry the cookie, as ports are of one site, and no origin."""
    client = opened(gate)
    for site, status in (("same-site", 403), ("cross-site", 403), ("same-origin", 200), ("none", 200)):
        assert client.get("/", headers={"sec-fetch-site": site}).status_code == status
    link = client.get(f"/?token={gate.token}", headers={"sec-fetch-site": "cross-site"})
    assert link.status_code == 200  # the printed address, clicked where it was sent
    assert "frame-ancestors 'none'" in link.headers["content-security-policy"]
    assert link.headers["cross-origin-resource-policy"] == "same-origin"  # nor from the browser's cache


def test_served_everywhere_it_has_every_numeric_address_and_its_own_names() -> None:
    gate = Gate(inside, ("0.0.0.0", "Workstation"), 80, any_address=True)
    for host in ("10.0.0.7", "10.0.0.7:80", "[fe80::1]", "[fe80::1]:80", "workstation", "WORKSTATION:80"):
        assert opened(gate, f"http://{host}").get("/").status_code == 200, host
    client = TestClient(gate, base_url="http://10.0.0.7")
    for host in ("evil.example", "evil.example:80", "10.0.0.7:81", "0x7f000001", "workstation.evil.example"):
        assert client.get(f"/?token={gate.token}", headers={"host": host}).status_code == 421, host


def test_a_body_is_bounded_before_it_is_read(gate: Gate) -> None:
    client = opened(gate)
    path = f"{UPLOADS}a/upload/1"
    assert client.post(path, content=bytes(2 << 20)).status_code == 200
    assert client.post(path, headers={"content-length": str(130 << 20)}).status_code == 413
    assert client.post(path, content=iter([b"a"])).status_code == 413


PNG = encode(np.random.default_rng(0).integers(0, 255, (40, 52, 3), np.uint8))


@pytest.fixture(scope="module")
def catalogue() -> Catalogue:
    return Catalogue(model="none")


@pytest.fixture(scope="module")
def visitor(catalogue: Catalogue) -> Iterator[TestClient]:
    gate = Gate(server.app(catalogue, catalogue.base), ("127.0.0.1",), 80)
    with TestClient(gate, base_url="http://127.0.0.1") as client:
        client.get("/", params={"token": gate.token})
        yield client


def upload(visitor: TestClient, name: str, content: bytes) -> None:
    """Upload a file on a page of its own: by its first upload, that of pictures."""
    found = re.search(r"/_nicegui/client/[\w-]+/upload/\d+", visitor.get("/").text)
    assert found
    visitor.post(found[0], files={"file": (name, content)})


def test_the_printed_address_holds_a_token(monkeypatch: pytest.MonkeyPatch, catalogue: Catalogue) -> None:
    made = SimpleNamespace(run=lambda sockets: None)  # NiceGUI looks for real ones in all memory
    monkeypatch.setattr(uvicorn, "Server", lambda config: made)
    said: list[str] = []
    server.serve(catalogue, State(), host="127.0.0.1", port=0, browser=False, say=said.append)
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=[\w-]{32}&exposure-ms=20.*", said[0])


def test_pages_whose_browser_never_connects_are_freed(visitor: TestClient) -> None:
    """NiceGUI drops their clients after a minute; nothing else may hold a page."""

    def pages() -> int:
        return sum(type(each) is page.Page for each in gc.get_objects())

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


def test_a_picture_is_uploaded_and_not_listed_on_another_page(
    visitor: TestClient, catalogue: Catalogue
) -> None:
    upload(visitor, "a b.png", PNG)
    end = time.monotonic() + 20
    while not catalogue._uploads and time.monotonic() < end:
        time.sleep(0.05)
    ((name, taken),) = catalogue._uploads.items()
    assert taken.name == "a b.png"
    assert "a b.png" not in visitor.get("/").text
    assert "a b.png" in visitor.get(f"/?picture={name}").text


def test_an_upload_that_is_too_large_is_refused(visitor: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "MOST_UPLOADED_MB", 0)
    said: list[str] = []
    monkeypatch.setattr(page.Page, "fails", lambda _, message: said.append(message))
    upload(visitor, "large.png", PNG)
    end = time.monotonic() + 20
    while not said and time.monotonic() < end:
        time.sleep(0.05)
    assert said == ["large.png: must be at most 0 MB"]


@pytest.mark.parametrize("query", ["lux=own", "exposure-ms=own", "lux=own&exposure-ms=own&dx=own&gain=own"])
def test_what_no_camera_has_is_told(query: str, visitor: TestClient) -> None:
    answer = visitor.get(f"/?{query}")
    assert answer.status_code == 200
    assert f"{query.partition('=')[0]} = &#39;own&#39;: must be " in answer.text.replace("'", "&#39;")
