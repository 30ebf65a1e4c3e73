"""The explorer's server: who can connect, who is answered, on routes and sockets, and what it takes."""

import asyncio
import os
import signal

import numpy as np
import pytest
from blurnoise_eval.cli import main
from blurnoise_eval.datasets import encode
from blurnoise_eval.explorer.catalogue import Catalogue

pytest.importorskip("nicegui")
import uvicorn
from blurnoise_eval.explorer import server
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
PNG = encode(np.random.default_rng(0).integers(0, 255, (40, 52, 3), np.uint8))


@pytest.fixture(scope="module")
def app():
    catalogue = Catalogue(model="none")
    return server.app(catalogue, catalogue.base, "token")


@pytest.fixture(scope="module")
def client(app):
    with TestClient(app, base_url="http://127.0.0.1:8123") as client:
        yield client


def opens(client, path, host="127.0.0.1:8123"):
    headers = {"host": host, "upgrade": "websocket"}
    try:
        with client.websocket_connect(f"ws://127.0.0.1:8123{path}", headers=headers) as socket:
            return socket.receive_text().startswith("0{")  # Engine.IO's first packet
    except WebSocketDisconnect:
        return False


def test_it_listens_on_the_loopback_address_alone(monkeypatch, capsys):
    addresses = []
    monkeypatch.setattr(server, "app", lambda *given: None)
    monkeypatch.setattr(
        uvicorn.Server, "run", lambda self, sockets: addresses.extend(each.getsockname() for each in sockets)
    )
    assert main(["explore", "--no-browser", "--model", "none"]) == 0
    ((address, port),) = addresses
    assert address == "127.0.0.1"
    assert f"http://127.0.0.1:{port}/" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="2"):
        main(["explore", "--no-browser", "--host", "0.0.0.0"])


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")
def test_a_second_interrupt_ends_the_server_at_once(monkeypatch):
    def interrupts(self, sockets):
        self.handle_exit(signal.SIGINT, None)
        if not (child := os.fork()):
            try:
                self.handle_exit(signal.SIGINT, None)
            finally:
                os._exit(0)
        ended.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))

    ended = []
    monkeypatch.setattr(server, "app", lambda *given: None)
    monkeypatch.setattr(uvicorn.Server, "run", interrupts)
    assert main(["explore", "--no-browser", "--model", "none"]) == 0
    assert ended == [-signal.SIGINT]


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:8123", "127.0.0.1.evil.example:8123", "127.0.0.1:8123.evil.example", "",
     "10.0.0.7:8123", "[::1]:8123", "localhost.:8123", "localhost.evil.example"],
)  # fmt: skip
def test_another_name_rebound_to_this_machine_is_not_answered(client, host):
    for ask in (client.get, client.post):
        assert ask("/token/", headers={"host": host}).status_code == 400
    assert client.post("/token/dropped?name=a.png", content=PNG, headers={"host": host}).status_code == 400
    assert not opens(client, f"/token{SOCKET}", host=host)


@pytest.mark.parametrize("host", ["127.0.0.1:8123", "localhost:8123", "127.0.0.1:9000"])
def test_its_own_names_are_answered_through_a_forwarded_port_too(client, host):
    assert client.get("/token/", headers={"host": host}).status_code == 200
    assert opens(client, f"/token{SOCKET}", host=host)


@pytest.mark.parametrize(
    "path", ["/", "/tokens/", "/token", "//token/", "/pictures/a", "/dropped?name=a", "/favicon.ico"]
)
def test_without_the_token_nothing_is_answered(client, path):
    for ask in (client.get, client.post):
        assert ask(path, follow_redirects=False).status_code in (404, 405, 307)
    assert not opens(client, SOCKET)


def test_a_dropped_picture_is_listed_and_what_is_none_is_refused_with_a_line(client):
    took = client.post("/token/dropped", params={"name": "a b.png"}, content=PNG)
    assert (took.status_code, took.text) == (200, "dropped-1")
    assert "a b.png" in client.get("/token/?picture=dropped-1").text
    for name in ("../../etc/passwd", "wrong.png"):
        refused = client.post("/token/dropped", params={"name": name}, content=b"hello")
        assert refused.status_code == 422
        assert (
            refused.text == f"{name.split('/')[-1]}: must be an 8- or 16-bit picture that OpenCV can decode"
        )


def dropped(app, body):
    """The status and text that answer a body, which is sent in pieces of 1 MB; and how many were read."""
    read, sent = 0, []

    async def receive():
        nonlocal read
        read += 1
        piece = next(body, None)
        return (
            {"type": "http.disconnect"}
            if piece is None
            else {"type": "http.request", "body": piece, "more_body": True}
        )

    async def send(message):
        sent.append(message)

    scope = {"type": "http", "http_version": "1.1", "method": "POST", "path": "/token/dropped", "root_path": "",
             "query_string": b"name=big.png", "headers": [(b"host", b"127.0.0.1:8123")]}  # fmt: skip
    asyncio.run(asyncio.wait_for(app(scope, receive, send), 20))
    return sent[0]["status"], sent[1]["body"].decode(), read


def test_bytes_are_counted_while_they_are_read(app, monkeypatch):
    """Nothing is read beyond the limit; a body that breaks off is no fault of the server."""
    monkeypatch.setattr(server, "MOST_DROPPED_MB", 3)
    assert dropped(app, iter([bytes(1 << 20)] * 40)) == (422, "big.png: must be at most 3 MB", 4)
    assert dropped(app, iter([PNG[:100]]))[0] == 422
