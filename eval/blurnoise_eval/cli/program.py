"""``blurnoise program``: from a finished run to exposure and gain for every light."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from blurnoise_eval.cli._options import Folder, Json, RunRead, settings
from blurnoise_eval.grid.program_file import ProgramFile
from blurnoise_eval.grid.values import bounds
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say, say_json, width


@settings(
    ProgramFile, "model", "lux", "speeds", "objective", "keep", "score", "fps", "readout_ms", "anti_flicker"
)
def program(run: RunRead, *, given: ProgramFile, output: Folder, as_json: Json = False) -> None:
    """Make an exposure program from a finished run, without new calls: for every light the exposure and gain that
    keep most of a detector's performance over a mix of speeds, in few stages, as cameras hold them.

      blurnoise program run -o program                 its lights and speeds
      blurnoise program run -o program --lux 1:1450 --speeds 0:0.3,200:0.7
      blurnoise program run -o program --anti-flicker 50 --objective worst
      blurnoise program run --save-plan program.yaml   gains, lines, targets

    Gains are those of the camera's own metering, for the mean light of the run's pictures; exposures never become
    longer in more light. Beside it stands what the best fixed time, a stock program and whole periods of the mains
    would keep. Lights and speeds that the run has not tested are refused; exposures shorter than tested, for more
    light, are marked as extrapolated.

    Writes DIR/program.csv (a row per light), program.json, libcamera.json (an exposure mode for a Raspberry Pi tuning
    file), ae_route.json (time in us, gain 1024 for 1, at most 16 nodes), v4l2.csv (times in 100 us and in
    lines, codes of analogue gain) and program.png.
    """
    from blurnoise_eval.program import export, view
    from blurnoise_eval.program.inputs import inputs_of
    from blurnoise_eval.program.limits import PREGIUS_LEAST_S, Limits
    from blurnoise_eval.program.optimise import optimise
    from blurnoise_eval.program.problem import Problem
    from blurnoise_eval.program.scenario import Scenario, half_stops, speed_shares, target_shares
    from blurnoise_eval.program.stages import MOST
    from blurnoise_eval.store.store import Store
    from blurnoise_eval.sweep.score_tables import criterion_of
    from blurnoise_eval.system.working_folder import output_folder, read_run

    if given.stages is not None and not 1 <= given.stages <= MOST:
        raise ValueError(
            f"stages = {given.stages}: must be 1 to {MOST}; with more an AE route would have over 16 nodes"
        )
    least_us = given.least_exposure_us
    limits = Limits(
        fps=given.fps,
        readout_s=given.readout_ms / 1e3,
        mains_hz=float(given.anti_flicker or 0),
        banding=given.banding,
        led=given.led,
        most_gain_db=given.most_gain_db,
        line_time_s=given.line_time_us / 1e6,
        least_exposure_s=PREGIUS_LEAST_S if least_us is None else least_us / 1e6,
    )
    with read_run(run) as read, Store(read.path) as store, ProgressBar("program", 2) as advance:
        advance.note("reads the run")
        inputs = inputs_of(
            store, criterion_of(store, given.threshold, given.keep, given.score), given.cluster, given.model
        )
        camera = inputs.metering.camera
        if least_us is None:
            limits = replace(limits, least_exposure_s=camera.row_time_s or PREGIUS_LEAST_S)
        speeds, of_speeds = speed_shares(given.speeds, inputs.speeds_px_s)
        targets, of_targets = target_shares(given.targets, list(inputs.planes))
        scenario = Scenario(
            lights_lux=half_stops(*(inputs.lights_lux if given.lux is None else bounds(given.lux))),
            speeds_px_s=speeds,
            targets=targets,
            objective=given.objective,
            tail=given.tail,
        )
        advance(1)
        advance.note("tries exposures at every light")
        problem = Problem(inputs, scenario, limits)
        found = optimise(problem, given.stages, inputs.recommended_for(scenario))
        advance(1)
    notes = [*inputs.notes, *of_speeds, *of_targets]
    with output_folder(output) as folder:
        folder.path.mkdir(parents=True, exist_ok=True)
        written = export.write(found, folder.path, str(run), notes, given.mode_name)
        title = f"{inputs.model}, {camera.name}: {inputs.criterion.title}"
        written.append(view.draw(found, title, folder.path / "program.png"))
    if as_json:
        document = export.document(found, str(run), notes)
        say_json({"output": str(output), "files": [folder.told(path) for path in written], **document})
        return
    say(*view.lines(found, width()))
    say(*notes, error=True)
    say(
        "",
        *(
            line
            for kind, lines in export.how_to_use(given.mode_name).items()
            for line in _numbered(kind, lines)
        ),
    )
    say("", f"wrote {', '.join(path.name for path in written)} in {output}")


def _numbered(kind: str, lines: list[str]) -> Iterator[str]:
    """'libcamera 1: ...', folded."""
    from blurnoise_eval.system.terminal import paragraph

    for number, line in enumerate(lines, start=1):
        yield from paragraph(f"{kind} {number}: {line}", width())
