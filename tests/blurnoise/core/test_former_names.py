"""Former names of modules: each gives the new one's names, and warns."""

from __future__ import annotations

import importlib
import sys

import pytest

import blurnoise
from blurnoise._core.former_names import FORMER


@pytest.mark.parametrize(
    "former", sorted(FORMER.keys() - {"blurnoise.augment_torchvision"})
)  # needs torchvision
def test_a_former_name_gives_what_is_there_now(monkeypatch: pytest.MonkeyPatch, former: str) -> None:
    monkeypatch.delitem(sys.modules, former, raising=False)
    monkeypatch.delattr(blurnoise, former.split(".")[1], raising=False)
    now = importlib.import_module(FORMER[former])
    with pytest.warns(DeprecationWarning, match=f"{former} is {FORMER[former]} now"):
        found = importlib.import_module(former)
    assert {name for name in vars(now) if not name.startswith("__")} <= vars(found).keys()
    assert all(vars(found)[name] is vars(now)[name] for name in vars(now) if not name.startswith("__"))
