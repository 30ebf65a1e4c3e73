"""An exposure program in words: the sentence that answers, the nodes, what else a camera may do; 80 columns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from blurnoise_eval.answers.criterion import Criterion
from blurnoise_eval.grid.axes import milliseconds
from blurnoise_eval.program.optimise import Baseline, Program, Schedule
from blurnoise_eval.program.scenario import Scenario
from blurnoise_eval.system.terminal import PROSE, paragraph, table_lines

_SHOWN = 12  # lights of the table
_EXTRAPOLATED = "extrapolated: shorter than tested"


def lines(program: Program, width: int | None = None) -> Iterator[str]:
    """What the terminal shows, line by line, in so many columns."""
    prose = width and min(width, PROSE)
    yield from paragraph(sentence(program), prose)
    yield ""
    schedule, metering, limits = program.schedule, program.problem.metering, program.problem.limits
    lights = program.problem.lights_lux
    kept = "keeps" if program.problem.criterion.kept else "reaches"
    heads = ["light, lux", "exposure, ms", "gain, dB", kept, ""]
    rows = [
        [
            _lux(lights[place]),
            milliseconds(schedule.exposures_s[place]),
            f"{schedule.gains_db[place]:.1f}",
            _told(schedule.values[place]),
            "most gain: darker than metered"
            if schedule.lacks_gain[place]
            else _EXTRAPOLATED * program.extrapolates(schedule.exposures_s[place]),
        ]
        for place in shown_places(len(lights))
    ]
    least_s, unity = program.stages.times_s[0], metering.total_s(1.0)
    if program.extrapolates(least_s):
        rows.append([_lux(unity / least_s), milliseconds(least_s), "0.0", "-", _EXTRAPOLATED])
    yield from table_lines(heads, rows, (True, True, True, True, False), width)
    yield ""
    stages = "; ".join(
        f"{milliseconds(time)} ms, x{gain:.3g}"
        for time, gain in zip(program.stages.times_s, program.stages.gains, strict=True)
    )
    yield from paragraph(f"Stages (time first, then gain): {stages}.", prose)
    if program.extrapolates(least_s):
        yield from paragraph(
            f"Exposures below {milliseconds(program.tested_s)} ms, the shortest tested, are extrapolated: they are "
            f"for more than {_lux(unity / program.tested_s)} lux, and keep daylight from being overexposed.",
            prose,
        )
    yield from paragraph(
        f"For {scenario_text(program.problem.response.scenario)}. Limits: {', '.join(limits.words)}.", prose
    )
    yield from paragraph(
        f"Gain by metering to 18 % of full scale, {metering.camera.name}, pictures of "
        f"{100 * metering.mean_light:.1f} % of white on average.",
        prose,
    )
    yield ""
    compared = [
        _row("this program", schedule),
        _row("the best, without stages", program.best),
        *(_row(named(each, program), each.schedule, each.reason) for each in program.baselines),
    ]
    heads = ["", kept, "worst speed", "worst light", ""]
    yield from table_lines(heads, compared, (False, True, True, True, False), width)


def sentence(program: Program) -> str:
    """What the program gives, what a fixed time and a stock program give, and what it may lose."""
    model, criterion, lights = program.problem.model, program.problem.criterion, program.problem.lights_lux
    interval = (
        "" if program.low is None or program.high is None else f" ({program.low:.3f}-{program.high:.3f})"
    )
    does = f"keeps {_told(program.schedule.value)}{interval} of {model}'s {_score(criterion)}"
    if not criterion.kept:
        does = f"gives {model} a {criterion.title} of {_told(program.schedule.value)}{interval}"
    others = [
        f"{named(baseline, program)} {_told(baseline.schedule.value)}"
        for baseline in program.baselines
        if baseline.schedule is not None and baseline.schedule.value is not None
    ]
    beside = f"; {', '.join(others)}" if others else ""
    told = f"From {lights[0]:.4g} to {lights[-1]:.4g} lux this program {does}{beside}."
    pictures = f"{program.pictures} picture{'s' * (program.pictures != 1)}"
    if program.regret_95 is None:
        return f"{told} From {pictures} it cannot be said what another program could gain."
    return f"{told} Another could gain at most {program.regret_95:.3f} (95 %, {pictures})."


def named(baseline: Baseline, program: Program) -> str:
    """A baseline with the time that it stands for."""
    if baseline.name == "best fixed time" and program.best_fixed_s is not None:
        return f"{baseline.name}, {milliseconds(program.best_fixed_s)} ms"
    return baseline.name


def scenario_text(scenario: Scenario) -> str:
    """'0 px/s (0.3), 200 px/s (0.7); large, medium; expected'."""
    speeds = ", ".join(f"{speed:.4g} px/s ({share:.2g})" for speed, share in scenario.speeds_px_s.items())
    targets = "; ".join(f"{target} ({share:.2g})" for target, share in scenario.targets.items())
    return f"{speeds}; {targets}; {objective_text(scenario)}"


def objective_text(scenario: Scenario) -> str:
    """'expected', or 'the worst of them'."""
    words = {"worst": "the worst of them", "tail": f"the worst {scenario.tail:g} of them on average"}
    return words.get(scenario.objective, "expected")


def unit(criterion: Criterion) -> str:
    """Head of a column of values."""
    return "keeps" if criterion.kept else "reaches"


def shown_places(count: int) -> Sequence[int]:
    """About ``_SHOWN`` of the lights, the ends with them."""
    if count <= _SHOWN:
        return range(count)
    return sorted({round(k * (count - 1) / (_SHOWN - 1)) for k in range(_SHOWN)})


def _lux(light: float) -> str:
    """Four digits, and no exponent where people read none."""
    return f"{float(f'{light:.4g}'):.8g}"


def _score(criterion: Criterion) -> str:
    return criterion.title.removeprefix("kept ")


def _told(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _row(name: str, schedule: Schedule | None, reason: str = "") -> list[str]:
    if schedule is None or schedule.value is None:
        return [name, "-", "", "", reason]
    return [name, *map(_told, (schedule.value, schedule.worst_speed, schedule.worst_light)), ""]
