"""Answers of brackets as sentences, rows of tables and the content of files."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from blurnoise.metrics.values import Estimate
from blurnoise_eval.measure.bracket_worth import BRACKET, DEFAULTS, ROUTES, BracketTrial, Curves, Worth, worth
from blurnoise_eval.measure.followed import FEW, SIDES
from blurnoise_eval.measure.picture_measures import MEASURES

HEADS = (
    "model",
    "simulated from",
    "confidence within",
    "shift in the dark, EV",
    "shift in bright light, EV",
    "objects",
)
WORDS = {BRACKET: "the bracket", DEFAULTS: "one photograph, defaults"}


def answers(trials: Sequence[BracketTrial]) -> list[str]:
    """A sentence for each model and route; without models one on pictures."""
    sentences = [
        f"{model}, simulated from {WORDS[route]}: {_sentence(worth(trials, model, route))}"
        for model in _models(trials)
        for route in ROUTES
    ]
    if not sentences:
        for route in ROUTES:
            most = max(trial.largest("mean_grey", route) for trial in trials)
            sentences.append(f"simulated from {WORDS[route]}: mean grey within {most:.1f} of 255 levels.")
    return sentences


def _models(trials: Sequence[BracketTrial]) -> list[str]:
    return list(dict.fromkeys(curves.model for trial in trials for curves in trial.curves))


def _sentence(of: Worth) -> str:
    if not math.isfinite(of.difference):
        return "no object is found in two or more of the captured pictures."
    shifted = [
        f"{stops(of.shift[side])} stops in {'the dark' if side == 'dark' else 'bright light'}"
        for side in SIDES
        if of.shift[side].available
    ]
    text = f"within {of.difference:.2f}" + (f", shifted by {', '.join(shifted)}" if shifted else "") + "."
    if math.isfinite(of.in_motion):
        text = f"{text[:-1]}; in motion within {of.in_motion:.2f}."
    fewest = min((of.things[side] for side in SIDES if of.things[side]), default=0)
    if not shifted:
        text += " No object falls to half of its confidence within the exposures."
    elif fewest < FEW:
        text += f" Few objects: {fewest}, which is too few to say how it is elsewhere."
    return text


def stops(estimate: Estimate) -> str:
    """A shift with its interval, as text.

    >>> stops(Estimate(0.12, -0.31, 0.4)), stops(Estimate(math.nan))
    ('+0.1 (-0.3 to +0.4)', '-')
    """
    if not estimate.available:
        return "-"
    interval = f" ({estimate.low:+.1f} to {estimate.high:+.1f})" if math.isfinite(estimate.low) else ""
    return f"{estimate.value:+.1f}{interval}".replace("-0.0", "+0.0")


def table(trials: Sequence[BracketTrial]) -> list[tuple[str, list[tuple[str, ...]]]]:
    """Rows as ``HEADS`` for each bracket and, if there are several, for all."""
    groups = [(trial.name, [trial]) for trial in trials]
    groups += [("all brackets", list(trials))] if len(trials) > 1 else []
    return [
        (
            name,
            [_cells(model, route, worth(some, model, route)) for model in _models(some) for route in ROUTES],
        )
        for name, some in groups
    ]


def _cells(model: str, route: str, of: Worth) -> tuple[str, ...]:
    number = "-" if math.isnan(of.difference) else f"{of.difference:.2f} ({of.bias:+.2f})"
    counted = max(of.objects.values())
    beyond = sum(of.beyond.values())
    return (
        model, WORDS[route], number, *(stops(of.shift[side]) for side in SIDES),
        f"{counted}" + (f", {beyond} beyond" if beyond else ""),
    )  # fmt: skip


def picture_table(trial: BracketTrial) -> list[tuple[str, ...]]:
    """Largest difference of each measure of pictures: title, bracket, defaults."""
    return [
        (
            f"{each.title}{f', {each.unit}' if each.unit else ''}",
            *(f"{trial.largest(each.name, route):.1f}" for route in ROUTES),
        )
        for each in MEASURES
    ]


def confidence_rows(trials: Sequence[BracketTrial]) -> Iterator[dict[str, Any]]:
    """A row for each object and picture."""
    for trial in trials:
        for curves in trial.curves:
            for number, one in enumerate(curves.objects):
                for place, shot in enumerate(trial.shots):
                    yield {
                        **_object(trial, curves, number), "box": " ".join(f"{x:.0f}" for x in one.box_xyxy),
                        "picture": shot.name, "exposure_ev": float(trial.stops[place]),
                        "captured": float(curves.captured[place, number]),
                        **{f"from_{route}": float(curves.simulated[route][place, number]) for route in ROUTES},
                    }  # fmt: skip


def half_rows(trials: Sequence[BracketTrial]) -> Iterator[dict[str, Any]]:
    """A row for each object, side and route: simulated less captured exposure at half confidence."""
    for trial in trials:
        for curves in trial.curves:
            for route in ROUTES:
                for side in SIDES:
                    shift, beyond = trial.shifts(curves, route, side)
                    for number in range(len(curves.objects)):
                        known = math.isfinite(shift[number])
                        yield {
                            **_object(trial, curves, number), "route": route, "side": side,
                            "shift_ev": float(shift[number]) if known else None, "beyond": bool(beyond[number]),
                        }  # fmt: skip


def _object(trial: BracketTrial, curves: Curves, number: int) -> dict[str, Any]:
    one = curves.objects[number]
    return {
        "bracket": trial.name,
        "model": curves.model,
        "object": number,
        "thing": one.thing,
        "label": one.label,
    }


def document(trials: Sequence[BracketTrial]) -> dict[str, Any]:
    """What the JSON file holds beside the rows."""
    numbers: list[dict[str, Any]] = [
        {
            "bracket": name, "model": model, "route": route,
            "difference": _finite(of.difference), "bias": _finite(of.bias),
            "in_motion": _finite(of.in_motion),
            **{f"{key}_{side}": value for side in SIDES for key, value in {
                "shift_ev": _finite(of.shift[side].value), "low_ev": _finite(of.shift[side].low),
                "high_ev": _finite(of.shift[side].high), "objects": of.objects[side], "things": of.things[side],
                "beyond": of.beyond[side]}.items()},
        }
        for name, some in [*((trial.name, [trial]) for trial in trials), ("all", trials)]
        for model in _models(some)
        for route in ROUTES
        for of in [worth(some, model, route)]
    ]  # fmt: skip
    pictures = [
        {
            "bracket": trial.name,
            "route": route,
            **{each.name: trial.largest(each.name, route) for each in MEASURES},
        }
        for trial in trials
        for route in ROUTES
    ]
    return {"answers": answers(trials), "worth": numbers, "largest_differences": pictures}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
