"""What else a run says, in words: the alarms, the warnings, the assumptions and the circumstances.

Domain: confidences in [0, 1], exposures in s (written in ms). Texts are plain, never markup.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from blurnoise_eval.detectors.baked import baked_text
from blurnoise_eval.grid.axes import AXES
from blurnoise_eval.grid.objects import Objects
from blurnoise_eval.grid.reflectance import reflectance_text
from blurnoise_eval.grid.trajectory_spec import TrajectorySpec
from blurnoise_eval.report.run import RunData
from blurnoise_eval.report.words import counted

MAX_LISTED = 8  # lines of one kind of warning
MAX_VALUE_CHARACTERS = 240
INVENTED = 0.1  # of targets' area, from which on the report says that what is seen behind them is invented
SWEPT_DIFFERENCE = 0.1  # of a detection rate, from which on the page says what the box decides


def swept(data: RunData) -> list[str]:
    """Where it matters most whether a target's box is that at mid-exposure or all that its motion sweeps."""
    lines = []
    for name in data.model_names:
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


def invented(data: RunData) -> list[str]:
    """How much of what is visible behind cut-out targets was invented; nothing where that is little."""
    shares = [row for row in data.exposed_scores if row.get("invented_share") is not None]
    much = [row for row in shares if row["invented_share"] >= INVENTED]
    if not much:
        return []
    row = max(much, key=lambda each: float(each["invented_share"]))
    return [
        f"Behind targets the background was invented, and what is seen of it is {100 * INVENTED:.0f} % of their area "
        f"and more in {len(much)} of {len(shares)} conditions, most at {data.settings.condition_text(row)}: "
        f"{100 * row['invented_share']:.0f} %. Pictures without the targets (--plates) would show what is there."
    ]


def alarms(data: RunData) -> list[str]:
    """What makes a model's whole answer doubtful."""
    found = []
    if missing := data.manifest["missing_cells"]:
        found.append(
            f"The run is not finished: {counted(missing, 'cell')} missing. "
            "The sweep's command, given again, computes the rest."
        )
    for model in data.manifest["models"]:
        name = model["name"]
        highest = [row["highest_confidence"] for row in data.groups if row["model"] == name]
        if highest and not any(highest):
            found.append(
                f"{name}: every target in every condition, the untouched pictures included, has confidence 0. "
                "The model file or its contract is probably wrong: colour order, scale, resize, class list, "
                "or a broken int8 export."
            )
        if count := model.get("non_finite_values"):
            found.append(f"{name}: {count} output values were NaN or infinite.")
        found += [f"{name}: {suspicion}" for suspicion in model.get("suspicions", [])]
    if same := data.manifest.get("repeated"):
        found.append(same)
    failed = (
        f"{row['model']}: {counted(row['cells'], 'cell')} failed: {row['error']}"
        for row in data.manifest["errors"]
    )
    return found + _first(failed, "further kinds of error; see results.csv")


def _first(lines: Iterable[str], more: str) -> list[str]:
    """At most ``MAX_LISTED`` of the lines, and how many more there are."""
    every = list(lines)
    left = len(every) - MAX_LISTED
    return every if left <= 0 else [*every[:MAX_LISTED], f"… and {left} {more}."]


def warnings(data: RunData) -> list[str]:
    """What limits the answers: the run's warnings, weak groups, skipped pictures."""
    threshold, names = data.criterion.level, data.model_names
    found = [*data.manifest["warnings"], *invented(data)]
    if len(names) > 1 and not data.manifest["images"].get("labelled", True):
        found.append(
            "The pictures have no labels: each model is held to what it found itself in the untouched pictures, "
            "so the models answer for different targets."
        )
    weak = (
        f"{name}, {group}: {clean:.2f} on the untouched pictures, below the threshold {threshold:g}. "
        "The model, not the exposure, sets the limit."
        for name in names
        for group in data.largest_groups(MAX_LISTED)
        if not data.criterion.kept
        and (clean := data.clean_confidence(name, group)) is not None
        and clean < threshold
    )
    found += _first(weak, "more targets below the threshold when untouched")
    skipped = (f"Skipped {row['image']}: {row['reason']}" for row in data.skipped)
    return found + _first(skipped, "more skipped pictures")


def assumptions(data: RunData) -> list[tuple[str, list[str]]]:
    """What was assumed: per model, of the camera and of the pictures one line, and what it is made of.

    Of contracts and camera it is the fields whose source says so; a figure of the camera that the sweep set otherwise
    is not among them.
    """
    camera, swept_over = data.manifest["camera"], set()
    for axis in (axis for axis in AXES if axis.into.startswith("camera.")):
        name = axis.into.removeprefix("camera.")
        if any(row[axis.name] != camera.get(name, row[axis.name]) for row in data.exposed_scores):
            swept_over.add(name)
    parts = [(model["name"], model["contract"], set[str]()) for model in data.manifest["models"]]
    found = []
    for part, fields, given in [*parts, (camera.get("name", "camera"), camera, swept_over)]:
        assumed = {
            name: f"{name} = {value}; {source}"
            for name, value, source, guessed in sourced(fields)
            if guessed and name not in given
        }
        if assumed:
            names = ", ".join(name.replace("_", " ") for name in assumed)
            found.append((f"{part}: assumed {names}", list(assumed.values())))
    light = None if data.manifest.get("grey_anchor") else reflectance(data)
    return found + [(f"pictures: {light}", [])] * bool(light)


def reflectance(data: RunData) -> str | None:
    """What light means of photographs and of what is anchored; None: rendered pictures are reflectance."""
    anchor = data.manifest.get("grey_anchor")
    rendered = data.manifest["images"]["kind"] == "rendered"
    return None if rendered and anchor is None else reflectance_text(anchor)


def sourced(fields: Mapping[str, Any]) -> list[tuple[str, str, str, bool]]:
    """(field, value, source, whether it was assumed) of a contract or camera."""
    sources = {name: str(source) for name, source in fields.get("sources", {}).items()}
    return [
        (name, shown(value), sources.get(name, ""), "assum" in sources.get(name, "").lower())
        for name, value in fields.items()
        if name != "sources"
    ]


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


def versions(manifest: Mapping[str, Any]) -> dict[str, str]:
    """What computed the run, with ``computed_by`` of its cells; of several the versions of each."""
    every: dict[str, dict[str, str]] = manifest.get("software") or {"": manifest.get("versions", {})}
    facts = {"computed_by": ", ".join(every)} if any(every) else {}
    for key, own in every.items():
        lead = f"{key}: " if len(every) > 1 else ""
        facts |= {f"{lead}{name}": version for name, version in own.items()}
    return facts


def model_facts(model: Mapping[str, Any]) -> dict[str, str]:
    """Which model it is, and what its graph limits."""
    facts = {key: model[key] for key in ("name", "kind", "file", "sha256") if key in model}
    return facts | ({"limits": baked_text(model["baked"])} if model.get("baked") else {})


def run_facts(data: RunData) -> dict[str, str]:
    """The circumstances of the run, by name, with the median time of a simulated picture."""
    manifest = data.manifest
    facts = {name: manifest.get(name) for name in ("command", "seed", "threads")}
    if manifest.get("grey_anchor"):
        facts["reflectance"] = reflectance(data)
    facts |= _motions(manifest)
    facts |= {
        "criterion": manifest["criterion"]["text"],
        "pictures": {name: value for name, value in manifest["images"].items() if name != "notes"},
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


def _motions(manifest: Mapping[str, Any]) -> dict[str, str]:
    """What moves beside the velocity of a picture."""
    found, plan = dict[str, str](), manifest.get("plan", {})
    if held := manifest.get("trajectory"):
        spec = TrajectorySpec(held["text"], held["content"])
        each = ""
        if spec.kind == "shake":
            each = f", another in every picture, so far in {1e3 * held['longest_s']:g} ms"
        found["trajectory"] = f"{spec.identity}{each}; blur and speeds are of the uniform motion beside it"
    if plan.get("ego"):
        figures = ", ".join(f"{name} {value}" for name, value in plan["ego"].items() if value is not None)
        found["ego"] = (
            f"{figures}; over a flat road: what stands on it moves as the road behind it does, and not above the "
            "horizon; blur_px of a target is that of its middle"
        )
    crossings = []
    for label, of in Objects(**plan.get("objects", {})).by_class.items():
        size = f"{of.width_m:g} m wide" if of.width_m is not None else f"{of.away_m:g} m away"
        crossings.append(f"{label} {of.kmh:g} km/h, {size}")
    if crossings:
        found["crossings"] = f"{'; '.join(crossings)}; blur_px of such a target is its own"
    return found
