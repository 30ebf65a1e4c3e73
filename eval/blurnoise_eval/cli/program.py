"""``blurnoise program``: from a finished run to exposure and gain for every light."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Option

from blurnoise_eval.cli._options import Folder, Json, Range, RunRead, bounds
from blurnoise_eval.cli.report import Cluster, Keep, Score, Threshold
from blurnoise_eval.system.progress import ProgressBar
from blurnoise_eval.system.terminal import say, say_json, width

if TYPE_CHECKING:
    from blurnoise.optics.camera import Camera

_what = partial(Option, rich_help_panel="What it is for")
_limit = partial(Option, rich_help_panel="Limits")


def program(
    run: RunRead,
    *,
    model: Annotated[
        str | None, _what(metavar="NAME", help="of the run's models (default: its only one)")
    ] = None,
    lux: Annotated[
        Range | None,
        _what(
            parser=bounds,
            metavar="LOW:HIGH",
            help="lights, half a stop apart (default: what the run was asked)",
        ),
    ] = None,
    speeds: Annotated[
        str | None,
        _what(metavar="V:SHARE,...", help="speeds and how often each is met (default: the run's, alike)"),
    ] = None,
    speed_unit: Annotated[
        Literal["px_s", "kmh"], _what(help="of --speeds: px/s, or km/h across the line of sight")
    ] = "px_s",
    distance_m: Annotated[float | None, _what(metavar="M", help="with km/h: from camera to target")] = None,
    focal_mm: Annotated[
        float | None, _what(metavar="MM", help="with km/h: of a rectilinear lens, in place of the angle")
    ] = None,
    hfov_deg: Annotated[
        float | None, _what(metavar="DEG", help="with km/h: horizontal angle of view (default: the camera's)")
    ] = None,
    targets: Annotated[
        str | None,
        _what(metavar="WORD:SHARE,...", help="kinds of target, by part of their name (default: all, alike)"),
    ] = None,
    objective: Annotated[
        Literal["expected", "worst", "tail"],
        _what(help="over speeds and targets: their mean, the worst, or the mean of the worst --tail"),
    ] = "expected",
    tail: Annotated[float, _what(metavar="SHARE", help="of the cases, for --objective tail")] = 0.2,
    keep: Keep = None,
    threshold: Threshold = None,
    score: Score = None,
    cluster: Cluster = None,
    fps: Annotated[
        float, _limit(metavar="N", help="frames a second: an exposure ends before the next frame")
    ] = 30.0,
    readout_ms: Annotated[float, _limit(metavar="MS", help="that each frame's read-out takes of it")] = 0.0,
    anti_flicker: Annotated[
        Literal["50", "60"] | None, _limit(help="Hz of the mains: whole periods of its light alone")
    ] = None,
    banding: Annotated[
        bool, _limit("--banding", help="with --anti-flicker: below one period any exposure all the same")
    ] = False,
    led: Annotated[
        bool, _limit("--led", help="1/90 s or more, so that no pulse of an LED is missed")
    ] = False,
    most_gain_db: Annotated[
        float | None, _limit(metavar="DB", help="largest gain, where that is less than the camera's")
    ] = None,
    line_time_us: Annotated[
        float, _limit(metavar="US", help="exposures are whole lines of the sensor")
    ] = 0.0,
    least_exposure_us: Annotated[
        float | None,
        _limit(
            metavar="US", help="the sensor's shortest exposure (default: its line time; global shutters 20)"
        ),
    ] = None,
    mode_name: Annotated[
        Literal["normal", "short", "long", "custom"], Option(help="of libcamera's exposure mode")
    ] = "custom",
    stages: Annotated[
        int | None, Option(metavar="N", help="how many, 1 to 7 (default: as few as lose less than 0.002)")
    ] = None,
    output: Folder,
    as_json: Json = False,
) -> None:
    """Make an exposure program from a finished run, without new calls: for every light the exposure and gain that
    keep most of a detector's performance over a mix of speeds, in few stages, as cameras hold them.

      blurnoise program run -o program                                     the run's lights and speeds
      blurnoise program run -o program --lux 1:1450 --speeds 0:0.3,200:0.5,800:0.2 --fps 30 --readout-ms 3
      blurnoise program run -o program --speeds 0:0.3,30:0.5,120:0.2 --speed-unit kmh --distance-m 30 --focal-mm 8
      blurnoise program run -o program --anti-flicker 50 --objective tail --tail 0.1

    Gains are those of the camera's own metering, for the mean light of the run's pictures; exposures never become
    longer in more light. Beside it stands what the best fixed time, a stock program and whole periods of the mains
    would keep. Lights and speeds that the run has not tested are refused; exposures shorter than tested, for more
    light, are marked as extrapolated.

    Writes DIR/program.csv (a row per light), program.json, libcamera.json (an exposure mode for a Raspberry Pi tuning
    file), ae_route.json (time in us, gain 1024 for 1, at most 16 nodes), v4l2.csv (times in 100 us and in
    lines, codes of analogue gain) and program.png.
    """
    from blurnoise_eval.program import export, figure, reading, text
    from blurnoise_eval.program.limits import PREGIUS_LEAST_S, Limits, least_exposure_s
    from blurnoise_eval.program.making import make
    from blurnoise_eval.program.response import Response
    from blurnoise_eval.program.scenario import Scenario, chosen_targets, half_stops, scaled_note
    from blurnoise_eval.program.stages import MOST
    from blurnoise_eval.store.checked import check_rows
    from blurnoise_eval.store.store import Store
    from blurnoise_eval.sweep.run_surfaces import criterion_of
    from blurnoise_eval.system.working_folder import output_folder, read_run

    if stages is not None and not 1 <= stages <= MOST:
        raise ValueError(
            f"stages = {stages}: must be 1 to {MOST}; with more an AE route would have over 16 nodes"
        )
    limits = Limits(
        fps=fps,
        readout_s=readout_ms / 1e3,
        mains_hz=float(anti_flicker or 0),
        banding=banding,
        led=led,
        most_gain_db=120.0 if most_gain_db is None else most_gain_db,
        line_time_s=line_time_us / 1e6,
        least_exposure_s=PREGIUS_LEAST_S if least_exposure_us is None else least_exposure_us / 1e6,
    )
    with read_run(run) as read, Store(read.path) as store, ProgressBar("program", 2) as advance:
        advance.note("reads the run")
        check_rows(store)
        criterion = criterion_of(store, threshold, keep, score)
        found = reading.read(store, criterion, cluster, model)
        camera = found.metering.camera
        if least_exposure_us is None:
            limits = replace(limits, least_exposure_s=least_exposure_s(camera))
        scenario = Scenario(
            lights_lux=half_stops(*(lux or found.lights_lux)),
            speeds_px_s=_speeds(
                speeds, found.speeds_px_s, speed_unit, distance_m, focal_mm, hfov_deg, camera
            ),
            targets=chosen_targets(targets, list(found.planes)),
            objective=objective,
            tail=tail,
        )
        advance(1)
        advance.note("tries exposures at every light")
        response = Response(scenario, found.planes, found.exposures_s)
        made = make(response, found.metering, limits, stages, found.recommended_for(scenario))
        advance(1)
    notes = [*found.notes, *scaled_note("speeds", speeds), *scaled_note("targets", targets)]
    about: dict[str, Any] = {
        "run": str(run),
        "model": found.model,
        "criterion": criterion.row(),
        "camera": camera.name,
        "mean_light": found.metering.mean_light,
        "scenario": {
            "lights_lux": list(scenario.lights_lux),
            "speeds_px_s": [
                {"speed": speed, "share": share} for speed, share in scenario.speeds_px_s.items()
            ],
            "targets": dict(scenario.targets),
            "objective": text.scenario_text(scenario).rpartition("; ")[2],
        },
        "limits": limits.words,
        "notes": notes,
    }
    title = f"{found.model}, {camera.name}: {criterion.title}"
    with output_folder(output) as folder:
        folder.path.mkdir(parents=True, exist_ok=True)
        written = export.write(
            made,
            scenario.lights_lux,
            about,
            folder.path,
            limits=limits,
            metering=found.metering,
            mode=mode_name,
        )
        written.append(
            figure.write(made, scenario, limits, found.metering, title, folder.path / "program.png")
        )
    if as_json:
        document = export.document(made, scenario.lights_lux, about)
        say_json({"output": str(output), "files": [folder.told(path) for path in written], **document})
        return
    say(*text.lines(made, scenario, limits, found.metering, criterion, found.model, width()))
    say(*notes, error=True)
    say(
        "", *(line for kind, lines in export.how_to_use(mode_name).items() for line in _numbered(kind, lines))
    )
    say("", f"wrote {', '.join(path.name for path in written)} in {output}")


def _numbered(kind: str, lines: list[str]) -> Iterator[str]:
    """'libcamera 1: ...', folded."""
    from blurnoise_eval.system.layout import paragraph

    for number, line in enumerate(lines, start=1):
        yield from paragraph(f"{kind} {number}: {line}", width())


def _speeds(
    stated: str | None,
    own: tuple[float, ...],
    unit: str,
    distance_m: float | None,
    focal_mm: float | None,
    hfov_deg: float | None,
    camera: Camera,
) -> dict[float, float]:
    """Shares by px/s."""
    from blurnoise_eval.program.scenario import add_share, named_shares

    if unit == "px_s":
        for name, value in (("distance_m", distance_m), ("focal_mm", focal_mm), ("hfov_deg", hfov_deg)):
            if value is not None:
                raise ValueError(f"{name} = {value:g}: goes with --speed-unit kmh")
    elif stated is None or distance_m is None:
        raise ValueError("speed_unit = 'kmh': needs --speeds and --distance-m")
    if stated is None:
        return dict.fromkeys(own, 1.0)
    shares: dict[float, float] = {}
    for key, share in named_shares("speeds", stated).items():
        try:
            speed = float(key)
        except ValueError:
            raise ValueError(f"speeds = {stated!r}: must be as 0:0.3,200:0.7, or without shares") from None
        if unit == "kmh":
            speed = _px_s(speed, distance_m or 0.0, focal_mm, hfov_deg, camera)
        add_share(shares, "speeds", speed, share)
    return shares


def _px_s(
    kmh: float, distance_m: float, focal_mm: float | None, hfov_deg: float | None, camera: Camera
) -> float:
    """Of what crosses the axis. A small target, so that its own width does not tell."""
    from blurnoise._core.checks import in_range
    from blurnoise.motion.ego import velocity_px_s

    lens: Literal["f-theta", "rectilinear"] = "f-theta"
    angle = camera.hfov_deg if hfov_deg is None else hfov_deg
    if focal_mm is not None:
        if hfov_deg is not None:
            raise ValueError(f"focal_mm = {focal_mm:g}: must stand in place of --hfov-deg")
        in_range("focal_mm", focal_mm, 1e-3, 1e6)
        angle = math.degrees(2 * math.atan(camera.width_px * camera.pixel_pitch_um / 2e3 / focal_mm))
        lens = "rectilinear"
    return velocity_px_s(
        kmh / 3.6,
        distance_m,
        target_width_m=distance_m / 1e3,
        width_px=camera.width_px,
        hfov_deg=angle,
        lens=lens,
    )
