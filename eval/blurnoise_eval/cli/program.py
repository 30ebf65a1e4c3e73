"""``blurnoise program``: compute exposure and gain for each light level, from a finished run."""

from __future__ import annotations

from typing import Annotated

from typer import Option

from blurnoise_eval.cli._options import Folder, RunRead, settings
from blurnoise_eval.plan.files import ProgramFile
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say, say_wrapped, width


@settings(
    ProgramFile,
    "model",
    "lux",
    "light",
    "speeds",
    "objective",
    "keep",
    "score",
    "fps",
    "readout_ms",
    "anti_flicker",
)
def program(
    run: RunRead,
    *,
    config: ProgramFile,
    limit: Annotated[
        bool, Option("--limit", help="compute one cap of the exposure time for auto exposure instead")
    ] = False,
    output: Folder,
) -> None:
    """Compute an exposure program from a finished run: the exposure time and gain for each light level at which a
    detector performs best over a mix of speeds. No model is evaluated again.

      blurnoise program run -o program     lights and speeds of the run
      blurnoise program run -o program --lux 1:1450 --speeds 0:0.3,200:0.7
      blurnoise program run -o program --anti-flicker 50 --objective worst
      blurnoise program run -o limit --limit --speeds 0:0.8,600:0.2     the cap for a driver's auto exposure
      blurnoise program run --save-plan program.yaml     all settings, to edit

    The gain is the gain that the camera's metering chooses for the mean brightness of the run's pictures. The
    exposure time never increases with light. For comparison, the table also lists the best fixed exposure time and
    the programs of libcamera.

    The lights and speeds must lie within those of the run. Exposures that are shorter than any of the run, in more
    light, are marked as extrapolated.

    The command writes DIR/program.csv (one row per light), program.json, program.png, and libcamera.json, an exposure
    mode for the tuning file of a Raspberry Pi camera. With --limit it writes limit.json and limit.txt: the cap in the
    words of picamera2, libcamera, V4L2, RealSense, DepthAI, Spinnaker and pylon.
    """
    import numpy as np

    from blurnoise._core.checks import in_range
    from blurnoise.camera.captures import longest_first_s
    from blurnoise_eval.program import limit_report, report
    from blurnoise_eval.program import scenario as of
    from blurnoise_eval.program.limit import best_limit, saturated_at
    from blurnoise_eval.program.optimise import optimise
    from blurnoise_eval.program.problem import Problem, inputs_of
    from blurnoise_eval.report.findings import reflectance
    from blurnoise_eval.run.run import Run
    from blurnoise_eval.system.working_folder import check_outputs, output_folder, read_run

    files = ("program.csv", "program.json", "program.png", "libcamera.json")
    check_outputs(output, *(limit_report.FILES if limit else files))
    in_range("fps", config.fps, 0.0, 1e6, above=True)
    in_range("readout_ms", config.readout_ms, 0.0, 1e3 / config.fps)
    with (
        read_run(run) as read,
        Run.open(read, config.question) as opened,
        ProgressBar("program", 2) as advance,
    ):
        inputs = inputs_of(opened, config.model)
        camera, own = inputs.metering.camera, inputs.scenario
        shortest_s = camera.sensor.row_time_s or of.PREGIUS_LEAST_S
        within_s = 1 / config.fps - config.readout_ms / 1e3
        limits = of.ExposureLimits(
            frame_rate_hz=config.fps,
            readout_s=config.readout_ms / 1e3,
            mains_hz=float(config.anti_flicker or 0),
            led=config.led,
            longest_s=longest_first_s(camera.sensor.captures, within_s) if camera.sensor.captures else 3600.0,
            gain_max_db=config.most_gain_db,
            row_time_s=config.line_time_us / 1e6,
            least_exposure_s=shortest_s
            if config.least_exposure_us is None
            else config.least_exposure_us / 1e6,
        )
        if config.lux is not None and config.light is not None:
            raise ValueError("light, lux: must not be combined; a light has its own lux")
        lights = own.lights_lux if config.lux is None else of.half_stops(*config.lux)
        if config.light is not None:
            lights = of.between_lights(config.light, inputs.metering.illuminant, inputs.lights)
        scenario = of.Scenario(
            lights_lux=lights,
            speeds_px_s=own.speeds_px_s if config.speeds is None else of.speed_shares(config.speeds),
            targets=of.target_shares(config.targets, [*inputs.planes]) if config.targets else own.targets,
            objective=config.objective,
            tail=config.tail,
            speed_unit=own.speed_unit,
        )
        advance(1)
        problem = Problem(inputs, scenario, limits)
        found = optimise(problem)
        capped = None
        if limit:
            tables = [table for table in opened.score_tables() if table.model == inputs.model]
            lux_s = [table.conditions["illuminance_lux"] * table.conditions["exposure_s"] for table in tables]
            shares = np.concatenate([table.saturated for table in tables])
            capped = best_limit(problem, saturated_at(np.concatenate(lux_s), shares))
        about_light = reflectance(opened.tables)
        advance(1)
    with output_folder(output) as folder:
        folder.path.mkdir(parents=True, exist_ok=True)
        if capped is not None:
            value = found.schedule.value
            written = limit_report.write(capped, value, folder.path, str(run), inputs.notes)
            text = limit_report.lines(capped, value, config.speeds is None, width())
        else:
            written = report.write(found, folder.path, str(run), inputs.notes)
            title = f"{inputs.model}, {camera.name}: {inputs.criterion.title}"
            written.append(report.draw(found, title, folder.path / "program.png"))
            text = report.lines(found, width())
    say(*text)
    if about_light:
        say_wrapped(f"lux: {about_light}", hanging=2)
    for note in inputs.notes:
        say_wrapped(note, error=True)
    say("", f"wrote {', '.join(path.name for path in written)} in {output}")
