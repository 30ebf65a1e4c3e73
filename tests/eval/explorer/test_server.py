"""The explorer's server: who is answered, on routes and sockets, what is printed, freed and taken."""

import re
import time

import numpy as np
import pytest
from blurnoise_eval.datasets import encode
from blurnoise_eval.explorer.catalogue import Catalogue

pytest.importorskip("nicegui")
from blurnoise_eval.explorer import server
from blurnoise_eval.explorer.server import Gate
from starlette.testclient import TestClient
from starlette.websockets import WebSocket, WebSocketDisconnect

OWN = "http://127.0.0.1:8123"


async def inside(scope, receive, send):
    """An application that answers everybody."""
    if scope["type"] == "websocket":
        socket = WebSocket(scope, receive, send)
        await socket.accept()
        await socket.send_json("open")
        await socket.close()
        return
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b""})


@pytest.fixture
def client():
    return TestClient(Gate(inside, ("127.0.0.1", "localhost"), 8123), base_url=OWN)


def socket_opens(client, path="/_nicegui_ws/socket.io/", **headers):
    address = str(client.base_url).replace("http", "ws", 1)
    try:
        with client.websocket_connect(f"{address}{path}", headers=headers) as socket:
            return bool(socket.receive_json())
    except WebSocketDisconnect:
        return False


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:8123", "127.0.0.1", "127.0.0.1:80", "127.0.0.1:8123.evil.example", "",
     "10.0.0.7:8123", "127.0.0.1.evil.example:8123", "[::1]:8123", "localhost.:8123"],
)  # fmt: skip
def test_another_name_rebound_to_this_machine_is_not_answered(client, host):
    for ask in (client.get, client.post):
        assert ask("/token/", headers={"host": host}).status_code == 421
    assert not socket_opens(client, host=host, origin=f"http://{host}")


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "", "https://127.0.0.1:8123", "http://127.0.0.1:8124"]
)
def test_other_origins_are_not_answered(client, origin):
    for ask in (client.get, client.post):
        assert ask("/token/", headers={"origin": origin}).status_code == 403
        assert ask("/token/", headers={"origin": OWN}).status_code == 200
    assert not socket_opens(client, origin=origin)
    assert socket_opens(client, origin=OWN)


PNG = encode(np.random.default_rng(0).integers(0, 255, (40, 52, 3), np.uint8))


@pytest.fixture(scope="module")
def catalogue():
    return Catalogue(model="none")


@pytest.fixture(scope="module")
def visitor(catalogue):
    gate = Gate(server.app(catalogue, catalogue.base, "token"), ("127.0.0.1",), 80)
    with TestClient(gate, base_url="http://127.0.0.1") as client:
        yield client


@pytest.mark.parametrize("path", ["/", "/tokens/", "/token", "//token/", "/pictures/a/b", "/favicon.ico"])
def test_without_the_token_nothing_is_answered(visitor, path):
    assert visitor.get(path, follow_redirects=False).status_code in (404, 307)
    assert not socket_opens(visitor, "/_nicegui_ws/socket.io/?EIO=4&transport=websocket")
    assert visitor.get("/token/").status_code == 200


def upload(visitor, name, content):
    """Upload a file on a page of its own: by its first upload, that of pictures."""
    found = re.search(r"/_nicegui/client/[\w-]+/upload/\d+", visitor.get("/token/").text)
    assert found
    visitor.post(f"/token{found[0]}", files={"file": (name, content)})


def test_a_picture_is_uploaded_and_not_listed_on_another_page(visitor, catalogue):
    upload(visitor, "a b.png", PNG)
    end = time.monotonic() + 20
    while not catalogue._uploads and time.monotonic() < end:
        time.sleep(0.05)
    ((name, taken),) = catalogue._uploads.items()
    assert taken.name == "a b.png"
    assert "a b.png" not in visitor.get("/token/").text
    assert "a b.png" in visitor.get(f"/token/?picture={name}").text
