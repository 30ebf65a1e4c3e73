"""An exposure program in words: the sentence that answers, the nodes, what else a camera may do; 80 columns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from blurnoise_eval.grid.axes import milliseconds
from blurnoise_eval.program.limits import Limits
from blurnoise_eval.program.making import Course, Program, Rival
from blurnoise_eval.program.metering import Metering
from blurnoise_eval.program.scenario import Scenario
from blurnoise_eval.scoring.criterion import Criterion
from blurnoise_eval.system.layout import PROSE, paragraph, table_lines

_SHOWN = 12  # lights of the table
_EXTRAPOLATED = "extrapolated: shorter than tested"


def lines(
    program: Program,
    scenario: Scenario,
    limits: Limits,
    metering: Metering,
    criterion: Criterion,
    model: str,
    width: int | None = None,
) -> Iterator[str]:
    """What the terminal shows, line by line, in so many columns."""
    prose = width and min(width, PROSE)
    yield from paragraph(sentence(program, scenario, criterion, model), prose)
    yield ""
    course = program.course
    heads = ["light, lux", "exposure, ms", "gain, dB", unit(criterion), ""]
    rows = [
        [
            _lux(scenario.lights_lux[place]),
            milliseconds(course.exposures_s[place]),
            f"{course.gains_db[place]:.1f}",
            _told(course.values[place]),
            "most gain: darker than metered"
            if course.lacks_gain[place]
            else _EXTRAPOLATED * program.extrapolates(course.exposures_s[place]),
        ]
        for place in shown_places(len(scenario.lights_lux))
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
    yield from paragraph(f"For {scenario_text(scenario)}. Limits: {', '.join(limits.words)}.", prose)
    yield from paragraph(
        f"Gain by metering to 18 % of full scale, {metering.camera.name}, pictures of "
        f"{100 * metering.mean_light:.1f} % of white on average.",
        prose,
    )
    yield ""
    compared = [
        _row("this program", course),
        _row("the best, without stages", program.best),
        *(_row(named(rival, program), rival.course, rival.reason or "") for rival in program.rivals),
    ]
    heads = ["", unit(criterion), "worst speed", "worst light", ""]
    yield from table_lines(heads, compared, (False, True, True, True, False), width)


def sentence(program: Program, scenario: Scenario, criterion: Criterion, model: str) -> str:
    """What the program gives, what a fixed time and a stock program give, and what it may lose."""
    lights = scenario.lights_lux
    interval = (
        "" if program.low is None or program.high is None else f" ({program.low:.3f}-{program.high:.3f})"
    )
    does = f"keeps {_told(program.course.value)}{interval} of {model}'s {_score(criterion)}"
    if not criterion.kept:
        does = f"gives {model} a {criterion.title} of {_told(program.course.value)}{interval}"
    others = [
        f"{named(rival, program)} {_told(rival.course.value)}"
        for rival in program.rivals
        if rival.course is not None and rival.course.value is not None
    ]
    beside = f"; {', '.join(others)}" if others else ""
    told = f"From {lights[0]:.4g} to {lights[-1]:.4g} lux this program {does}{beside}."
    pictures = f"{program.pictures} picture{'s' * (program.pictures != 1)}"
    if program.regret_95 is None:
        return f"{told} From {pictures} it cannot be said what another program could gain."
    return f"{told} Another could gain at most {program.regret_95:.3f} (95 %, {pictures})."


def named(rival: Rival, program: Program) -> str:
    """A rival with the time that it stands for."""
    if rival.name == "best fixed time" and program.best_fixed_s is not None:
        return f"{rival.name}, {milliseconds(program.best_fixed_s)} ms"
    return rival.name


def scenario_text(scenario: Scenario) -> str:
    """'0 px/s (0.3), 200 px/s (0.7); large, medium; expected'."""
    speeds = ", ".join(f"{speed:.4g} px/s ({share:.2g})" for speed, share in scenario.speeds_px_s.items())
    targets = "; ".join(f"{target} ({share:.2g})" for target, share in scenario.targets.items())
    objective = {"worst": "the worst of them", "tail": f"the worst {scenario.tail:g} of them on average"}
    return f"{speeds}; {targets}; {objective.get(scenario.objective, 'expected')}"


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


def _row(name: str, course: Course | None, reason: str = "") -> list[str]:
    if course is None or course.value is None:
        return [name, "-", "", "", reason]
    return [name, *map(_told, (course.value, course.worst_speed, course.worst_light)), ""]
