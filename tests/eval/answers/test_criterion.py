"""What is enough: as stated, or what is usual for the pictures and the models."""

from __future__ import annotations

from typing import Any

import pytest
from blurnoise_eval.answers.criterion import Criterion, criterion_for, names


@pytest.mark.parametrize(
    ("options", "rendered", "reads", "expected"),
    [
        ({}, False, False, Criterion(0.9, kept=True)),
        ({}, True, False, Criterion(0.6, kept=False)),
        ({}, False, True, Criterion(0.9, kept=True, score="exact_match")),
        ({}, True, True, Criterion(0.6, kept=False)),
        ({"keep": 0.8}, True, False, Criterion(0.8, kept=True)),
        ({"threshold": 0.3}, False, False, Criterion(0.3, kept=False)),
        ({"threshold": 0.3}, False, True, Criterion(0.3, kept=False)),
        ({"keep": 0.5}, False, True, Criterion(0.5, kept=True, score="exact_match")),
        ({"score": "ap50"}, False, False, Criterion(0.9, kept=True, score="ap50")),
        ({"score": "ap"}, True, False, Criterion(0.6, kept=False, score="ap")),
        ({"score": "recall@0.05", "keep": 1.0}, False, False, Criterion(1.0, kept=True, score="recall@0.05")),
        ({"threshold": 0.0}, False, False, Criterion(0.0, kept=False)),
    ],
)
def test_what_is_usual(options: dict[str, Any], rendered: bool, reads: bool, expected: Criterion) -> None:
    assert criterion_for(**options, rendered=rendered, reads=reads) == expected


@pytest.mark.parametrize(
    ("options", "reads", "message"),
    [
        ({"keep": 0.9, "threshold": 0.6}, False, r"^keep = 0.9: cannot go with threshold = 0.6"),
        ({"keep": 1.5}, False, r"^keep = 1.5"),
        ({"keep": 0.0}, False, r"^keep = 0.0: must be .* > 0"),
        ({"keep": float("nan")}, False, r"^keep = nan"),
        ({"threshold": -0.1}, False, r"^threshold = -0.1"),
        (
            {"score": "exact_match"},
            False,
            r"^score = 'exact_match': must be one of target_confidence, .* detectors",
        ),
        ({"score": "ap50"}, True, r"^score = 'ap50': must be one of target_confidence, exact_match for text"),
        ({"score": "recall@0.1"}, True, r"^score = 'recall@0.1'"),
        ({"score": "recall@0"}, False, r"^score = 'recall@0'"),
        ({"score": "recall@-1"}, False, r"^score = 'recall@-1'"),
        ({"score": "recall@RATE"}, False, r"^score = 'recall@RATE'"),
        ({"score": "recall@nan"}, False, r"^score = 'recall@nan'"),
        ({"score": "accuracy"}, False, r"^score = 'accuracy': must be one of"),
    ],
)
def test_what_cannot_be(options: dict[str, Any], reads: bool, message: str) -> None:
    with pytest.raises(ValueError, match=message) as raised:
        criterion_for(**options, rendered=False, reads=reads)
    assert "\n" not in str(raised.value)


def test_alarms_need_labels() -> None:
    with pytest.raises(ValueError, match=r"^score = 'recall@1': needs pictures with labels"):
        criterion_for(score="recall@1", rendered=False, reads=False, labelled=False)
    assert criterion_for(score="ap", rendered=False, reads=False, labelled=False).score == "ap"


def test_in_words() -> None:
    assert Criterion(0.9, kept=True).text == "keeps 0.9 of its confidence"
    assert Criterion(0.6, kept=False).text == "mean confidence 0.6"
    assert Criterion(0.9, kept=True).title == "kept confidence"
    assert Criterion(0.6, kept=False).title == "mean confidence"
    assert (
        Criterion(0.8, kept=True, score="recall@0.1").text
        == "keeps 0.8 of its recall at 0.1 false alarms per picture"
    )
    assert Criterion(0.3, kept=False, score="ap50").title == "AP50"
    every = [name.replace("RATE", "2") for kind in ("detector", "reader") for name in names(kind)]
    assert len({Criterion(0.5, kept=True, score=name).text for name in every}) == len(set(every))
