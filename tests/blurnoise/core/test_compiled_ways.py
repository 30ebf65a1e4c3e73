from __future__ import annotations

import pickle

import pytest

from blurnoise._core.compiled_ways import CompiledWay, compiled_ways


def test_loaded_once_when_the_other_way_has_taken_as_long() -> None:
    asked: list[str] = []
    way = CompiledWay(lambda: asked.append("loaded") or "compiled", worth=10)
    assert [way.after(4), way.after(4)] == [None, None]
    assert not asked
    assert [way.after(2), way.after(1)] == ["compiled", "compiled"]
    assert asked == ["loaded"]


@pytest.mark.parametrize(
    "error",
    [
        ImportError("no numba"),
        RuntimeError("no folder for the cache"),
        OSError("disk full"),
        EOFError("its index is cut short"),
        pickle.UnpicklingError("its index is no index"),
    ],
)
def test_where_it_cannot_be_loaded_the_other_way_is_taken(error: Exception) -> None:
    def load() -> str:
        raise error

    assert CompiledWay(load, worth=0).after(1) is None


def test_always_or_never_meanwhile() -> None:
    way = CompiledWay(lambda: "compiled", worth=10)
    with compiled_ways("always"):
        assert way.after(1) == "compiled"
        with compiled_ways("never"):
            assert way.after(100) is None
        assert way.after(0) == "compiled"
    assert way.after(0) == "compiled"  # by what was asked for meanwhile
    assert CompiledWay(lambda: "compiled", worth=10).after(9) is None
