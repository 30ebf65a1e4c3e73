"""``blurnoise program``: from a finished run to exposure and gain for every light."""

from __future__ import annotations

from blurnoise_eval.cli._options import Folder, RunRead, settings
from blurnoise_eval.grid.plan_file import ProgramFile
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say, width


@settings(
    ProgramFile, "model", "lux", "speeds", "objective", "keep", "score", "fps", "readout_ms", "anti_flicker"
)
def program(run: RunRead, *, given: ProgramFile, output: Folder) -> None:
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
    from blurnoise.optics.camera import longest_first_s
    from blurnoise_eval.program import report
    from blurnoise_eval.program import scenario as of
    from blurnoise_eval.program.optimise import optimise
    from blurnoise_eval.program.problem import Problem, inputs_of
    from blurnoise_eval.store.store import Store
    from blurnoise_eval.sweep.score_tables import question_of
    from blurnoise_eval.system.working_folder import output_folder, read_run

    with read_run(run) as read, Store(read.path) as store, ProgressBar("program", 2) as advance:
        question = question_of(store, given.threshold, given.keep, given.score, given.cluster)
        inputs = inputs_of(store, *question, given.model)
        camera, own = inputs.metering.camera, inputs.scenario
        shortest_s = camera.row_time_s or of.PREGIUS_LEAST_S
        within_s = 1 / given.fps - given.readout_ms / 1e3
        limits = of.Limits(
            frame_rate_hz=given.fps,
            readout_s=given.readout_ms / 1e3,
            mains_hz=float(given.anti_flicker or 0),
            led=given.led,
            longest_s=longest_first_s(camera.captures, within_s) if camera.captures else 3600.0,
            gain_max_db=given.most_gain_db,
            row_time_s=given.line_time_us / 1e6,
            least_exposure_s=shortest_s if given.least_exposure_us is None else given.least_exposure_us / 1e6,
        )
        scenario = of.Scenario(
            lights_lux=own.lights_lux if given.lux is None else of.half_stops(*given.lux),
            speeds_px_s=own.speeds_px_s if given.speeds is None else of.speed_shares(given.speeds),
            targets=of.target_shares(given.targets, [*inputs.planes]) if given.targets else own.targets,
            objective=given.objective,
            tail=given.tail,
        )
        advance(1)
        found = optimise(Problem(inputs, scenario, limits))
        advance(1)
    with output_folder(output) as folder:
        folder.path.mkdir(parents=True, exist_ok=True)
        written = report.write(found, folder.path, str(run), inputs.notes)
        title = f"{inputs.model}, {camera.name}: {inputs.criterion.title}"
        written.append(report.draw(found, title, folder.path / "program.png"))
    say(*report.lines(found, width()))
    say(*inputs.notes, error=True)
    say("", f"wrote {', '.join(path.name for path in written)} in {output}")
