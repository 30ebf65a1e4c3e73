"""The rest of a report in words: alarms, warnings, assumptions, and how the run was made."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from blurnoise_eval.plan.axes import AXES, LIGHT
from blurnoise_eval.plan.conditions import reflectance_text
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.words import counted, joined

MAX_LISTED = 8  # lines of one kind of warning
MAX_VALUE_CHARACTERS = 240
FEW_ASSUMED = 3
"""So many names stand in a sentence; more are counted."""
OF_LIGHT = ("f number", "transmission", "quantum efficiency")
"""Figures of a camera to which the light on the sensor is proportional, or to their square."""
OF_NOISE = ("noise", "dark", "prnu", "dsnu", "black level", "photon transfer")
"""What the names of figures of noise have in common."""


def alarms(data: RunData) -> list[str]:
    """What makes the whole answer of a model doubtful."""
    lines = []
    if missing := data.manifest["missing_cells"]:
        lines.append(unfinished(missing))
    for model in data.manifest["models"]:
        name = model["name"]
        if count := model.get("non_finite_values"):
            lines.append(f"{name}: {count} output values were NaN or infinite.")
        lines += [f"{name}: {suspicion}" for suspicion in model.get("suspicions", [])]
    if same := data.manifest.get("repeated"):
        lines.append(same)
    failed = (
        f"{row['model']}: {counted(row['cells'], 'cell')} failed: {row['error']}"
        for row in data.manifest["errors"]
    )
    return lines + _first(failed, "further kinds of error; see results.csv")


def unfinished(missing_cells: int) -> str:
    """What is said of a run that was stopped.

    >>> unfinished(2)
    'The run is not finished: 2 cells missing. Repeat the command of the sweep to compute the rest.'
    """
    return (
        f"The run is not finished: {counted(missing_cells, 'cell')} missing. "
        "Repeat the command of the sweep to compute the rest."
    )


def _first(lines: Iterable[str], more: str) -> list[str]:
    """At most ``MAX_LISTED`` of the lines, and how many more there are."""
    every = list(lines)
    left = len(every) - MAX_LISTED
    return every if left <= 0 else [*every[:MAX_LISTED], f"… and {left} {more}."]


def warnings(data: RunData) -> list[str]:
    """The run's warnings, and the pictures that were skipped."""
    skipped = (f"Skipped {row.image}: {row.reason}" for row in data.skipped)
    return [*data.manifest["warnings"], *_first(skipped, "more skipped pictures")]


def assumptions(data: RunData) -> list[str]:
    """What was assumed, in sentences: a line for each model, for the camera and for the pictures."""
    camera = data.manifest["camera"]
    lines = [
        f"{part}: assumed {', '.join(names)}"
        if len(names) <= FEW_ASSUMED
        else _assumed_of(part, names, camera)
        for part, names in assumed(data).items()
    ]
    light = None if data.manifest.get("grey_anchor") else reflectance(data)
    return lines + [f"pictures: {light}"] * bool(light)


def _assumed_of(part: str, names: Sequence[str], camera: Mapping[str, Any]) -> str:
    """How many figures are assumed, and what they change."""
    if part != camera.get("name", "camera"):
        return f"{part}: {len(names)} settings are assumed."
    light = [name for name in names if name in OF_LIGHT]
    noise = [name for name in names if any(word in name for word in OF_NOISE)]
    known = sum(bool(source) for _, _, source, _ in sourced(camera))
    text = f"{part}: {len(names)} of {known} figures are assumed, as no source gives them."
    if light:
        text += f" An error of {joined(light)} shifts every exposure."
    others = len(names) - len(light) - len(noise)
    verbs = {1: "1 is"}
    of = [f"{verbs.get(len(noise), f'{len(noise)} are')} of noise, which counts in the dark"] * bool(noise)
    of += [f"{verbs.get(others, f'{others} are')} of gain, colour or lens"] * (others > 0)
    return text + f" Of the others, {', and '.join(of)}." * bool(of)


def assumed(data: RunData) -> dict[str, list[str]]:
    """The names of what was assumed, by model and camera.

    These are the fields of contracts and camera whose source says so, without those that the sweep varied.
    """
    camera = data.manifest["camera"]
    of_camera = {axis.into.removeprefix("camera."): axis for axis in AXES if axis.into.startswith("camera.")}
    swept_over = {
        name
        for name, axis in of_camera.items()
        if any(
            row.conditions[axis.name] != camera.get(name, row.conditions[axis.name])
            for row in data.exposed_scores
        )
    }
    parts = [(model["name"], model["contract"], set[str]()) for model in data.manifest["models"]]
    found: dict[str, list[str]] = {}
    for part, fields, given in [*parts, (camera.get("name", "camera"), camera, swept_over)]:
        # What the sweep varied was not assumed, whatever the source of the camera's own figure says.
        names = [name for name, _, _, guessed in sourced(fields) if guessed and name not in given]
        if names:
            found[part] = [name.replace("_", " ") for name in names]
    return found


def reflectance(data: RunData) -> str | None:
    """How the light of a photograph becomes reflectance; None for rendered pictures, which are reflectance."""
    anchor = data.manifest.get("grey_anchor")
    rendered = data.manifest["images"]["kind"] == "rendered"
    spread_ev = data.manifest.get("light_spread_ev")
    return None if rendered and anchor is None else reflectance_text(anchor, "--grey-anchor", spread_ev)


def sourced(fields: Mapping[str, Any]) -> list[tuple[str, str, str, bool]]:
    """(field, value, source, whether it was assumed) of a contract or camera."""
    sources = {name: str(source) for name, source in fields.get("sources", {}).items()}
    return [
        (name, shown(value), sources.get(name, ""), "assum" in sources.get(name, "").lower())
        for name, value in fields.items()
        if name != "sources"
    ]


def shown(value: Any) -> str:
    """A value as text: six digits, lists joined and cut when long, None as 'not specified'."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict):
        value = [f"{name}: {shown(entry)}" for name, entry in value.items()]
    if isinstance(value, (list, tuple)):
        text = ", ".join(shown(entry) for entry in value)
        count = f" … ({len(value)} entries)"
        return text if len(text) <= MAX_VALUE_CHARACTERS else text[:MAX_VALUE_CHARACTERS] + count
    return "not specified" if value is None else str(value)


def versions(manifest: Mapping[str, Any]) -> dict[str, str]:
    """The versions of the software that computed the run, by the ``computed_by`` of its cells."""
    every: dict[str, dict[str, str]] = manifest.get("software") or {"": manifest.get("versions", {})}
    facts = {"computed_by": ", ".join(every)}
    return facts | {f"{key} {name}": version for key, own in every.items() for name, version in own.items()}


def white_luminances(data: RunData) -> list[str]:
    """Of a matt surface that reflects all light, E / pi, beside every lux of the run, without headlamps."""
    every = sorted({row.conditions.illuminance_lux for row in data.exposed_scores})
    # Three digits without a power of ten.
    return [f"{float(f'{lux / math.pi:.3g}'):.10g} cd/m2 at {LIGHT.text(lux)}" for lux in every]


def model_facts(model: Mapping[str, Any]) -> dict[str, str]:
    """Name, kind, file and hash of a model."""
    return {key: model[key] for key in ("name", "kind", "file", "sha256") if key in model}


def run_facts(data: RunData) -> dict[str, str]:
    """How the run was made, by name, with the median time of a simulated picture."""
    manifest = data.manifest
    facts = {name: manifest.get(name) for name in ("command", "seed", "threads")}
    if manifest.get("grey_anchor"):
        facts["reflectance"] = reflectance(data)
    if tone := manifest.get("plan", {}).get("picture_tone"):
        words = tone if isinstance(tone, str) else f"{len(tone)} points"
        facts["picture tone"] = f"{words}, removed from the pictures"
    if held := manifest.get("trajectory"):
        facts["trajectory"] = f"{held['text']}; blur and speeds are of the uniform motion beside it"
    if ego := manifest.get("plan", {}).get("ego"):
        facts["ego"] = ", ".join(f"{name} {value}" for name, value in ego.items() if value is not None)
    if lamps := manifest.get("plan", {}).get("lamps"):
        facts["lamps"] = ", ".join(f"{name} {shown(value)}" for name, value in lamps.items() if value)
    facts["hdr_white"] = manifest.get("plan", {}).get("hdr_white")
    facts |= {
        "criterion": manifest["criterion"]["text"],
        "pictures": {name: value for name, value in manifest["images"].items() if name != "notes"},
        "cells, of all models": manifest["n_cells"],
        "held": data.settings.held or None,
        "luminance of a white surface": white_luminances(data) or None,
        "wall time, s": manifest.get("wall_s"),
        "simulation per picture, ms (median)": manifest["simulate_ms"],
    }
    return {name: shown(value) for name, value in facts.items() if value is not None}
