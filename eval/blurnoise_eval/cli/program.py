"""``blurnoise program``: from a finished run to exposure and gain for every light."""

from __future__ import annotations

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
    longer in more light. Beside it stands what the best fixed time and libcamera's programs would keep. Lights and
    speeds that the run has not tested are refused; exposures shorter than tested, for more light, are marked as
    extrapolated.

    Writes DIR/program.csv (a row per light), program.json, libcamera.json (an exposure mode for a Raspberry Pi tuning
    file) and program.png.
    """
    from blurnoise_eval.program import report
    from blurnoise_eval.program.optimise import optimise
    from blurnoise_eval.program.problem import Problem, inputs_of
    from blurnoise_eval.program.scenario import (
        PREGIUS_LEAST_S,
        Limits,
        Scenario,
        half_stops,
        speed_shares,
        target_shares,
    )
    from blurnoise_eval.store.store import Store
    from blurnoise_eval.sweep.score_tables import question_of
    from blurnoise_eval.system.working_folder import output_folder, read_run

    limits = Limits(
        frame_rate_hz=given.fps,
        readout_s=given.readout_ms / 1e3,
        mains_hz=float(given.anti_flicker or 0),
        led=given.led,
        gain_max_db=given.most_gain_db,
        row_time_s=given.line_time_us / 1e6,
        least_exposure_s=PREGIUS_LEAST_S
        if given.least_exposure_us is None
        else given.least_exposure_us / 1e6,
    )
    with read_run(run) as read, Store(read.path) as store, ProgressBar("program", 2) as advance:
        advance.note("reads the run")
        question = question_of(store, given.threshold, given.keep, given.score, given.cluster)
        inputs = inputs_of(store, *question, given.model)
        camera = inputs.metering.camera
        if given.least_exposure_us is None:
            limits = replace(limits, least_exposure_s=camera.row_time_s or PREGIUS_LEAST_S)
        asked = inputs.scenario
        scenario = Scenario(
            lights_lux=asked.lights_lux if given.lux is None else half_stops(*bounds(given.lux)),
            speeds_px_s=asked.speeds_px_s if given.speeds is None else speed_shares(given.speeds),
            targets=target_shares(given.targets, [*inputs.planes]) if given.targets else asked.targets,
            objective=given.objective,
            tail=given.tail,
        )
        advance(1)
        advance.note("tries exposures at every light")
        problem = Problem(inputs, scenario, limits)
        found = optimise(problem)
        advance(1)
    with output_folder(output) as folder:
        folder.path.mkdir(parents=True, exist_ok=True)
        written = report.write(found, folder.path, str(run), inputs.notes)
        title = f"{inputs.model}, {camera.name}: {inputs.criterion.title}"
        written.append(report.draw(found, title, folder.path / "program.png"))
    if as_json:
        document = report.document(found, str(run), inputs.notes)
        say_json({"output": str(output), "files": [folder.told(path) for path in written], **document})
        return
    say(*report.lines(found, width()))
    say(*inputs.notes, error=True)
    say("", f"wrote {', '.join(path.name for path in written)} in {output}")
