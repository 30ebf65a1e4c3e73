"""The explorer's server: who is answered, with what, and what it takes."""

import os
import signal

import cv2
import numpy as np
import pytest
from blurnoise_eval.cli import main
from blurnoise_eval.datasets import encode
from blurnoise_eval.explorer.catalogue import Catalogue

pytest.importorskip("uvicorn")
pytest.importorskip("httpx")
import uvicorn
from blurnoise_eval.explorer import server
from blurnoise_eval.explorer.state import State
from starlette.testclient import TestClient

PNG = encode(np.random.default_rng(0).integers(0, 255, (40, 52, 3), np.uint8))


@pytest.fixture(scope="module")
def app():
    catalogue = Catalogue(model="none")
    return server.app(catalogue, catalogue.base, "token")


@pytest.fixture(scope="module")
def client(app):
    with TestClient(app, base_url="http://127.0.0.1:8123") as client:
        yield client


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
    for path in ("", "facts", "picture.png", "dropped?name=a.png"):
        for ask in (client.get, client.post):
            assert ask(f"/token/{path}", headers={"host": host}).status_code == 400


@pytest.mark.parametrize("host", ["127.0.0.1:8123", "localhost:8123", "127.0.0.1:9000"])
def test_its_own_names_are_answered_through_a_forwarded_port_too(client, host):
    assert client.get("/token/", headers={"host": host}).status_code == 200


@pytest.mark.parametrize(
    "path",
    ["/", "/tokens/", "/token", "//token/", "/facts", "/picture.png", "/dropped?name=a", "/favicon.ico"],
)
def test_without_the_token_nothing_is_answered(client, path):
    for ask in (client.get, client.post):
        assert ask(path, follow_redirects=False).status_code in (404, 405, 307)


def test_an_answer_is_that_of_its_query(client, app):
    """The picture exactly, its figures, and the texts of the controls; a model that is not there is a line."""
    query = "exposure-ms=5&lux=20&dx=0&dy=0&gain=0&seed=3"
    shown = client.get(f"/token/picture.png?{query}").content
    catalogue = Catalogue(model="none")
    state = catalogue.start(query)
    decoded = cv2.imdecode(np.frombuffer(shown, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert np.array_equal(decoded, catalogue.render(state).frame.image)
    facts = client.get(f"/token/facts?{query}").json()
    assert facts["query"] == query
    assert facts["controls"]["exposure_s"][0] == "5"
    assert facts["verdict"] == "No model."
    assert not facts["scored"]
    assert client.get("/token/preview.jpg?" + query).status_code == 204
    assert client.get("/token/command?" + query).text == catalogue.command(state)
    wrong = client.get("/token/facts?exposure-ms=-4")
    assert (wrong.status_code, wrong.text) == (
        422, "exposure-ms = '-4': exposure_s = -0.004: must be finite and > 0 and <= 3600",
    )  # fmt: skip
    assert "no &lt;b&gt;" in client.get("/token/?picture=no <b>").text


def test_a_curve_is_written_point_by_point():
    client = TestClient(server.app(Catalogue(), State(), "token"), base_url="http://127.0.0.1:8123")
    answer = client.get("/token/curve", params={"dx": "0"})
    points = len(answer.json()["points"])
    assert points > 20
    assert answer.text.startswith(" " * points + "{")
    assert answer.json()["sentence"].startswith("Exposure: ")


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


def test_a_large_file_is_refused_before_all_of_it_is_read(client, monkeypatch):
    monkeypatch.setattr(server, "MOST_DROPPED_MB", 3)
    answer = client.post("/token/dropped?name=big.png", content=iter([bytes(1 << 20)] * 4))
    assert (answer.status_code, answer.text) == (422, "big.png: must be at most 3 MB")
