"""What a run says, in words: the answer, the alarms, the warnings, the assumptions and the circumstances.

Domain: confidences in [0, 1], exposures in s (written in ms). Texts are plain, never markup.
"""

from __future__ import annotations

from collections.abc import Iterable
from statistics import fmean
from typing import Any

from blurnoise.grey_anchor import reflectance_text
from blurnoise_eval.grid.axes import AXES, EXPOSURE
from blurnoise_eval.report.data import RunData
from blurnoise_eval.report.measured import clean_confidence, finite, largest_groups, model_names
from blurnoise_eval.report.settings import word
from blurnoise_eval.report.tradeoff import ROBUSTNESS
from blurnoise_eval.report.words import CANNOT_TELL, WORKS

MAX_LISTED = 8  # lines of one kind of warning
MAX_VALUE_CHARACTERS = 240
SWEPT_DIFFERENCE = 0.1  # of a detection rate, from which on the page says what the box decides


def best_common_exposure(answers: list[dict[str, Any]], threshold: float) -> tuple[float, int] | None:
    """The tested exposure, in s, that reaches the threshold in most answers, and in how many.

    Ties go to the higher mean confidence, then to the shorter exposure. None where nothing was measured.
    """
    reached: dict[float, list[float]] = {}
    for answer in answers:
        for exposure_s, confidence in zip(answer["exposures_s"], answer["confidence"], strict=True):
            if confidence is not None:
                reached.setdefault(exposure_s, []).append(confidence)
    if not reached:
        return None
    counts = {exposure_s: sum(c >= threshold for c in found) for exposure_s, found in reached.items()}
    best = max(sorted(reached), key=lambda exposure_s: (counts[exposure_s], fmean(reached[exposure_s])))
    return best, counts[best]


def summary(data: RunData) -> list[str]:
    """The answer in words: which model holds best, how often any exposure works, and the one that works most."""
    if not data.answers:
        return ["The pictures hold no targets, so no exposure can be recommended."]
    names = model_names(data)
    lines = _answer_lines(data) if len(names) == 1 else [*_ranking(data), *_leaders(data)]
    return [*lines, *_swept(data)]


def _answer_lines(data: RunData) -> list[str]:
    answers, threshold = data.answers, data.manifest["threshold"]
    total, untold = len(answers), count_untold(answers)
    reached = any(answer["windows_s"] for answer in answers)
    if not reached and not untold:
        return [f"No tested exposure reaches a mean confidence of {threshold:g} for any {_what(data, 'or')}."]
    held = data.settings.special_text(data.manifest["camera"])
    lines = [
        f"An exposure that keeps the mean confidence at or above {threshold:g} exists in "
        f"{count_working(answers)} of {total} combinations of {_what(data)}{f', with {held}' if held else ''}"
        f"{_untold(untold)}."
    ]
    if total > max(untold, 1) and reached and (best := best_common_exposure(answers, threshold)):
        lines.append(
            f"If the camera must use one exposure for all of them: the mean at {EXPOSURE.text(best[0])} reaches "
            f"it in {best[1]} of {total}; at no other tested exposure in more."
        )
    return lines


def _untold(count: int) -> str:
    return f"; in {count} the pictures are too few to tell" if count else ""


def _ranking(data: RunData) -> list[str]:
    """How often an exposure works for each model, the best first, and the best one's own answer."""
    threshold = data.manifest["threshold"]
    of_model = {
        name: answers
        for name in model_names(data)
        if (answers := [answer for answer in data.answers if answer["model"] == name])
    }
    share = {name: count_working(answers) / len(answers) for name, answers in of_model.items()}
    best = max(share.values())
    untold = count_untold(data.answers)
    if best == 0 and not untold:
        return [f"No model reaches a mean confidence of {threshold:g} at any tested exposure."]
    order = sorted(share, key=lambda name: -share[name])
    first = [name for name in order if share[name] == best]
    counts = [f"{name} {count_working(of_model[name])} of {len(of_model[name])}" for name in order]
    listed = ", ".join(counts[:MAX_LISTED]) + (", …" if len(counts) > MAX_LISTED else "")
    lines = [
        f"{_joined(first)} hold{'s' if len(first) == 1 else ''} best. Combinations of {_what(data)} in "
        f"which some exposure keeps the mean confidence at or above {threshold:g}: {listed}{_untold(untold)}."
    ]
    own = of_model[first[0]]
    common = best_common_exposure(own, threshold)
    if common and len(own) > max(count_untold(own), 1):
        lines.append(
            f"If the camera must use one exposure for all of them: with {first[0]}, the mean at "
            f"{EXPOSURE.text(common[0])} reaches it in {common[1]} of {len(own)}."
        )
    return lines


def _leaders(data: RunData) -> list[str]:
    """The model ahead in each measure of robustness."""
    leaders = []
    for measure, name in ROBUSTNESS.items():
        rows = [(value, row["model"]) for row in data.models if (value := finite(row[measure])) is not None]
        if len(rows) > 1:
            value, model = max(rows, key=lambda row: row[0])
            leaders.append(f"{name}: {model} ({value:.2f})")
    return [f"Ahead in {'; '.join(leaders)}."] if leaders else []


def _swept(data: RunData) -> list[str]:
    """Where it matters most whether a target's box is that at mid-exposure or all that its motion sweeps."""
    lines = []
    for name in model_names(data):
        rates = [
            (row["detection_rate_swept"] - row["detection_rate"], row)
            for row in data.scores
            if row["model"] == name and row.get("detection_rate_swept") is not None
        ]
        differing = [each for each in rates if abs(each[0]) >= SWEPT_DIFFERENCE]
        if differing:
            _, row = max(differing, key=lambda each: abs(each[0]))
            lines.append(
                f"{name} is held to boxes at mid-exposure; against all that the motion sweeps the detection rate "
                f"differs by {SWEPT_DIFFERENCE:g} and more in {len(differing)} of {len(rates)} conditions, most at "
                f"{data.settings.condition_text(row)}: {row['detection_rate']:.2f}, swept "
                f"{row['detection_rate_swept']:.2f}."
            )
    return lines


def _what(data: RunData, last: str = "and") -> str:
    """'target, light and speed', with what else varies."""
    return _joined(["target", *map(word, data.settings.axes), "speed"], last)


def count_working(answers: Iterable[dict[str, Any]]) -> int:
    """In how many answers some exposure surely works."""
    return sum(answer["verdict"] == WORKS for answer in answers)


def count_untold(answers: Iterable[dict[str, Any]]) -> int:
    """In how many answers the pictures are too few to tell."""
    return sum(answer["verdict"] == CANNOT_TELL for answer in answers)


def alarms(data: RunData) -> list[str]:
    """What makes a model's whole answer doubtful."""
    alarms = []
    if missing := missing_text(data.manifest["missing_cells"]):
        alarms.append(missing)
    for model in data.manifest["models"]:
        name = model["name"]
        highest = [row["highest_confidence"] for row in data.groups if row["model"] == name]
        if highest and not any(highest):
            alarms.append(
                f"{name}: every target in every condition, the untouched pictures included, has confidence 0. "
                "The model file or its contract is probably wrong: colour order, scale, resize, class list, "
                "or a broken int8 export."
            )
        if count := model.get("non_finite_values"):
            alarms.append(f"{name}: {count} output values were NaN or infinite.")
        alarms += [f"{name}: {suspicion}" for suspicion in model.get("suspicions", [])]
    errors = data.manifest["errors"]
    alarms += [
        f"{row['model']}: {_cells(row['cells'])} failed: {row['error']}" for row in errors[:MAX_LISTED]
    ]
    if len(errors) > MAX_LISTED:
        alarms.append(f"… and {len(errors) - MAX_LISTED} further kinds of error; see results.csv.")
    return alarms


def missing_text(cells: int) -> str | None:
    """That a run is not finished; None for one that is."""
    if not cells:
        return None
    return f"The run is not finished: {_cells(cells)} missing. The sweep's command, given again, computes the rest."


def warnings(data: RunData) -> list[str]:
    """What limits the answers: the run's own warnings, weak groups, skipped pictures."""
    threshold = data.manifest["threshold"]
    warnings = list(data.manifest["warnings"])
    names = model_names(data)
    if len(names) > 1 and not data.manifest["images"].get("labelled", True):
        warnings.append(
            "The pictures have no labels: each model is held to what it found itself in the untouched pictures, "
            "so the models answer for different targets."
        )
    weak = [
        (name, group, clean)
        for name in names
        for group in largest_groups(data, MAX_LISTED)
        if (clean := clean_confidence(data, name, group)) is not None and clean < threshold
    ]
    warnings += [
        f"{name}, {group}: {clean:.2f} on the untouched pictures, below the threshold {threshold:g}. "
        "The model, not the exposure, sets the limit."
        for name, group, clean in weak[:MAX_LISTED]
    ]
    if len(weak) > MAX_LISTED:
        warnings.append(f"… and {len(weak) - MAX_LISTED} more targets below the threshold when untouched.")
    warnings += [f"Skipped {row['image']}: {row['reason']}" for row in data.skipped[:MAX_LISTED]]
    if len(data.skipped) > MAX_LISTED:
        warnings.append(f"… and {len(data.skipped) - MAX_LISTED} more skipped pictures.")
    return warnings


def assumptions(data: RunData) -> list[str]:
    """What nobody stated: the fields of contracts and camera whose source says that they were assumed.

    A figure of the camera that the sweep set otherwise is not among them.
    """
    camera = data.manifest["camera"]
    set_to = [(axis, row[axis.name]) for axis in AXES for row in data.scores if not row["clean"]]
    stated = {
        axis.into.removeprefix("camera.")
        for axis, value in set_to
        if axis.into.startswith("camera.") and value != camera.get(axis.into.removeprefix("camera."), value)
    }
    parts = [(f"{model['name']}: contract", model["contract"]) for model in data.manifest["models"]]
    told = [] if data.manifest.get("grey_anchor") else [reflectance(data)]
    return [f"pictures: {each}" for each in told if each] + [
        f"{part}: {name} = {value}; {source}"
        for part, fields in [*parts, ("camera", camera)]
        for name, value, source, assumed in sourced(fields)
        if assumed and not (part == "camera" and name in stated)
    ]


def reflectance(data: RunData) -> str | None:
    """What light means of photographs and of what is anchored; None: rendered pictures are reflectance."""
    anchor = data.manifest.get("grey_anchor")
    rendered = data.manifest["images"]["kind"] == "rendered"
    return None if rendered and anchor is None else reflectance_text(anchor)


def sourced(fields: dict[str, Any]) -> list[tuple[str, str, str, bool]]:
    """(field, value, source, whether it was assumed) of a contract or camera."""
    sources = fields.get("sources", {})
    rows = []
    for name, value in fields.items():
        if name != "sources":
            source = str(sources.get(name, ""))
            rows.append((name, shown(value), source, "assum" in source.lower()))
    return rows


def shown(value: Any) -> str:
    """A value as text: six digits, lists joined and cut when long, None as 'not stated'."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict):
        value = [f"{name}: {shown(entry)}" for name, entry in value.items()]
    if isinstance(value, (list, tuple)):
        text = ", ".join(shown(entry) for entry in value)
        count = f" … ({len(value)} entries)"
        return text if len(text) <= MAX_VALUE_CHARACTERS else text[:MAX_VALUE_CHARACTERS] + count
    return "not stated" if value is None else str(value)


def run_facts(data: RunData) -> dict[str, str]:
    """The circumstances of the run, by name, with the median time of a simulated picture."""
    manifest = data.manifest
    pictures = {name: value for name, value in manifest["images"].items() if name != "notes"}
    facts = {name: manifest.get(name) for name in ("command", "seed", "threads")}
    if manifest.get("grey_anchor"):
        facts["reflectance"] = reflectance(data)
    facts |= {
        "confidence threshold": manifest["threshold"],
        "pictures": pictures,
        "cells, of all models": manifest["n_cells"],
        "target rows": manifest["n_target_rows"],
        "skipped pictures": len(data.skipped),
    }
    if held := data.settings.held_text():
        facts["held"] = held
    if manifest.get("wall_s") is not None:
        facts["wall time"] = f"{manifest['wall_s']:.1f} s"
    if manifest["simulate_ms"] is not None:
        facts["simulation per picture"] = f"{manifest['simulate_ms']:.3g} ms (median)"
    return {name: shown(value) for name, value in facts.items()}


def _cells(count: int) -> str:
    return f"{count} cell" if count == 1 else f"{count} cells"


def _joined(names: list[str], last: str = "and") -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}"
