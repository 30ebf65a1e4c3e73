"""What a run says, in words: the answer, the warnings, the assumptions and the circumstances.

Domain: confidences in [0, 1], exposures in s (written in ms). Texts are plain, never markup.
"""

from __future__ import annotations

from collections import Counter
from statistics import fmean, median
from typing import TYPE_CHECKING, Any

from blurnoise_eval.figures import largest_groups
from blurnoise_eval.pictures import exposure_text

if TYPE_CHECKING:
    from blurnoise_eval.report import RunData

MAX_LISTED = 8  # lines of one kind of warning
MAX_VALUE_CHARACTERS = 240


def window_text(answer: dict[str, Any]) -> str:
    """The exposure windows in words, such as '≤ 1 ms (shortest tested) to 22 ms'."""
    if not answer["windows_s"]:
        return "no exposure works"
    if len(answer["exposures_s"]) == 1:
        return f"{exposure_text(answer['exposures_s'][0])} (the only exposure tested)"
    ends = [[exposure_text(low), exposure_text(high)] for low, high in answer["windows_s"]]
    if answer["open_low"]:
        ends[0][0] = f"≤ {ends[0][0]} (shortest tested)"
    if answer["open_high"]:
        ends[-1][1] = f"≥ {ends[-1][1]} (longest tested)"
    return ", and ".join(low if low == high else f"{low} to {high}" for low, high in ends)


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
    """The answer in words: how often any exposure works, and the one exposure that works most often."""
    threshold = data.manifest["threshold"]
    if not data.answers:
        counts = [cell["n_detections"] for cell in data.cells if cell["error"] is None]
        mean = f" The detector reported {fmean(counts):.2g} detections per picture." if counts else ""
        return [f"The pictures hold no targets, so no exposure can be recommended.{mean}"]
    total = len(data.answers)
    working = sum(bool(answer["windows_s"]) for answer in data.answers)
    if working == 0:
        return [
            f"No tested exposure reaches a mean confidence of {threshold:g} for any target, light or speed."
        ]
    lines = [
        f"An exposure that keeps the mean confidence at or above {threshold:g} exists in {working} of "
        f"{total} combinations of target, light and speed."
    ]
    if total > 1 and (best := best_common_exposure(data.answers, threshold)):
        lines.append(
            f"If the camera must use one exposure for all of them: {exposure_text(best[0])} works in "
            f"{best[1]} of {total}; no other tested exposure works in more."
        )
    return lines


def clean_confidence(data: RunData, group: str) -> float | None:
    """Mean confidence of a group on the untouched pictures, None where they were not run."""
    found = [
        target["confidence"]
        for target in data.targets
        if target["clean"] and target["group"] == group and target["confidence"] is not None
    ]
    return fmean(found) if found else None


def alarms(data: RunData) -> list[str]:
    """What makes the whole run doubtful."""
    alarms = []
    confidences = [target["confidence"] for target in data.targets if target["confidence"] is not None]
    if confidences and not any(confidences):
        alarms.append(
            "Every target in every condition, the untouched pictures included, has confidence 0. "
            "The model file or its contract is probably wrong: colour order, scale, resize, class list, "
            "or a broken int8 export."
        )
    errors = Counter(str(cell["error"]) for cell in data.cells if cell["error"] is not None)
    alarms += [
        f"{count} of {len(data.cells)} cells failed: {text}" for text, count in errors.most_common(MAX_LISTED)
    ]
    if len(errors) > MAX_LISTED:
        alarms.append(f"… and {len(errors) - MAX_LISTED} further kinds of error; see results.csv.")
    return alarms


def warnings(data: RunData) -> list[str]:
    """What limits the answers: the run's own warnings, weak groups, skipped pictures."""
    threshold = data.manifest["threshold"]
    warnings = list(data.manifest.get("warnings", []))
    for group in largest_groups(data, MAX_LISTED):
        clean = clean_confidence(data, group)
        if clean is not None and clean < threshold:
            warnings.append(
                f"{group}: the detector gives {clean:.2f} on the untouched pictures, below the threshold "
                f"{threshold:g}. The detector, not the exposure, sets the limit."
            )
    warnings += [f"Skipped {row['image']}: {row['reason']}" for row in data.skipped[:MAX_LISTED]]
    if len(data.skipped) > MAX_LISTED:
        warnings.append(f"… and {len(data.skipped) - MAX_LISTED} more skipped pictures; see results.json.")
    return warnings


def assumptions(data: RunData) -> list[str]:
    """What nobody stated: the model's own list, then the fields whose source says that they were assumed."""
    model = data.manifest["model"]
    listed = [str(line) for line in model.get("assumptions", [])]
    for part, fields in (("contract", model.get("contract", {})), ("camera", data.manifest["camera"])):
        for name, value, source, assumed in sourced(fields):
            if assumed:
                listed.append(f"{part}: {name} = {value}; {source}")
    return listed


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
    """The circumstances of the run, by name, with the median times per picture."""
    manifest = data.manifest
    facts = {
        "command": manifest.get("command"),
        "seed": manifest.get("seed"),
        "threads": manifest.get("threads"),
    }
    facts |= {"confidence threshold": manifest["threshold"], "pictures": manifest.get("images")}
    facts |= {
        "cells": len(data.cells),
        "target rows": len(data.targets),
        "skipped pictures": len(data.skipped),
    }
    if manifest.get("wall_s") is not None:
        facts["wall time"] = f"{manifest['wall_s']:.1f} s"
    for column, name in (("simulate_ms", "simulation per picture"), ("infer_ms", "inference per picture")):
        times = [cell[column] for cell in data.cells if cell[column] is not None]
        if times:
            facts[name] = f"{median(times):.3g} ms (median of {len(times)})"
    return {name: shown(value) for name, value in facts.items()}
