"""Fields checked against their annotations: one line each, naming the field, its value and what is allowed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from annotated_types import Ge, Le, Len

from blurnoise._core.checks import Characters, Figure, Text, check_fields


@dataclass(frozen=True)
class Record:
    name: Text = "a"
    share: Annotated[float, Ge(0), Le(1)] = 0.5
    level: Annotated[Figure, Ge(0)] = 0.0
    count: Annotated[int, Ge(1)] = 1
    on: bool = False
    colour: Literal["rgb", "bgr"] = "rgb"
    pair: Annotated[tuple[float, float] | None, "must be two numbers"] = None
    names: Annotated[tuple[Characters, ...], Len(1)] = ("x",)
    shares: tuple[Annotated[float, Ge(0), Le(1)], ...] = ()
    records: tuple[Record, ...] = ()
    notes: Mapping[str, Text] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_fields(self)


def test_lists_and_numpys_numbers_become_plain() -> None:
    record = Record(share=np.float32(0.5), count=np.int64(3), level=2, pair=[1, np.float64(2)], names=["a"])  # type: ignore[arg-type]
    assert (record.share, record.count, record.level) == (0.5, 3, 2.0)
    assert [type(value) for value in (record.share, record.count, record.level)] == [float, int, float]
    assert (record.pair, record.names) == ((1.0, 2.0), ("a",))
    assert {type(value) for value in record.pair or ()} == {float}


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        ({"name": 3}, TypeError, "name = 3: must be text"),
        ({"name": "\t"}, ValueError, r"name = '\t': must not be empty"),
        ({"name": "\ud800"}, ValueError, r"name = '\ud800': must be text, without halves of characters"),
        ({"share": 2}, ValueError, "share = 2: must be finite and >= 0 and <= 1"),
        ({"share": float("nan")}, ValueError, "share = nan: must be finite and >= 0 and <= 1"),
        (
            {"share": "1e-1"},
            TypeError, "share = '1e-1': must be a number, not text (YAML takes 1e4 for text; write 1.0e+4)",
        ),
        ({"share": 10**400}, ValueError, f"share = 1{'0' * 17}...{'0' * 19}: must be finite and >= 0 and <= 1"),
        ({"level": -1}, ValueError, "level = -1.0: must be finite and >= 0"),
        ({"count": 1.0}, TypeError, "count = 1.0: must be an integer"),
        ({"count": True}, TypeError, "count = True: must be an integer"),
        ({"count": -(10**400)}, ValueError, f"count = -1{'0' * 16}...{'0' * 19}: must be finite and >= 1"),
        ({"on": 1}, TypeError, "on = 1: must be true or false"),
        ({"colour": ["rgb"]}, ValueError, "colour = ['rgb']: must be one of 'rgb', 'bgr'"),
        ({"pair": [1, "x"]}, TypeError, "pair = [1, 'x']: must be two numbers"),
        ({"pair": [1]}, ValueError, "pair = [1]: must be two numbers"),
        ({"names": []}, ValueError, "names = []: must not be empty"),
        ({"names": ["a", 5]}, TypeError, "names = 5: must be text"),
        ({"names": ["a", "\ud800"]}, ValueError, r"names = '\ud800': must be text, without halves of characters"),
        ({"shares": (0.5, 1.5)}, ValueError, "shares = 1.5: must be finite and >= 0 and <= 1"),
        ({"records": (0.1,)}, TypeError, "records = 0.1: must be a Record"),
        ({"notes": 5}, TypeError, "notes = 5: must map names to text"),
        ({"notes": {"a": 5}}, TypeError, "notes.a = 5: must be text"),
        ({"notes": {7: "x"}}, TypeError, "notes.7 = 7: must be text"),
    ],
)  # fmt: skip
def test_faults_are_one_line(change: dict[str, Any], kind: type[Exception], message: str) -> None:
    with pytest.raises((TypeError, ValueError)) as caught:
        Record(**change)
    assert issubclass(caught.type, kind)
    assert str(caught.value) == message
