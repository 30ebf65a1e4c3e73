"""The explorer's server: what is printed, what is freed, and what it takes."""

from __future__ import annotations

import gc
import re
import time
from collections.abc import Iterator
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from blurnoise_eval.datasets import encode
from blurnoise_eval.explorer.catalogue import MOST_UPLOADED_MB, Catalogue
from blurnoise_eval.explorer.state import State

uvicorn = pytest.importorskip("uvicorn")
nicegui = pytest.importorskip("nicegui")
from blurnoise_eval.explorer import page, server  # noqa: E402  # need NiceGUI
from blurnoise_eval.explorer.gate import _MOST_UPLOADED_MB, Gate  # noqa: E402
from starlette.testclient import TestClient  # noqa: E402

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
    assert taken.title == "a b.png"
    assert "a b.png" not in visitor.get("/").text
    assert "a b.png" in visitor.get(f"/?picture={name}").text


def test_an_upload_that_is_too_large_is_refused(visitor: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    assert MOST_UPLOADED_MB["picture"] < _MOST_UPLOADED_MB
    monkeypatch.setitem(MOST_UPLOADED_MB, "picture", 0)
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
    assert f"{query.partition('=')[0]} = &#39;own&#39;: must be &gt;" in answer.text.replace("'", "&#39;")
