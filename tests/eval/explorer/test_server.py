"""The explorer's server: what holds while it serves."""

from __future__ import annotations

import pytest
from blurnoise_eval.explorer.shelf import Shelf
from blurnoise_eval.explorer.state import State
from blurnoise_models.detector import STOP_SIGN

from blurnoise._core.compiled_ways import CompiledWay

uvicorn = pytest.importorskip("uvicorn")
pytest.importorskip("nicegui")


def test_no_visitor_waits_for_what_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Loading it takes seconds, and whoever moves a slider just then would wait."""
    from blurnoise_eval.explorer.server import serve

    way, found = CompiledWay(lambda: "compiled", worth=0), list[object]()
    monkeypatch.setattr(uvicorn.Server, "run", lambda *_, **__: found.append(way.after(1.0)))
    said: list[str] = []
    serve(Shelf(STOP_SIGN), State(), host="127.0.0.1", port=0, browser=False, say=said.append)
    assert found == [None]
    assert said[0].startswith("http://127.0.0.1:")
    assert way.after(1.0) == "compiled"
