"""What options and commands of before are called now: one line each."""

from __future__ import annotations

from blurnoise_eval.grid.axes import AXES
from blurnoise_eval.grid.settings import Settings

MODULES = {
    "bench": "blurnoise_eval.bench",
    "maps": "blurnoise_eval.maps",
    "paper": "blurnoise_eval.paper",
    "scenes": "blurnoise_eval.scenes",
}
"""Commands of before that are modules: ``python -m``."""
COMMANDS_MOVED = {
    **{name: f"python -m {module}" for name, module in MODULES.items()},
    "detections": "blurnoise report RUN --coco",
}
_VEHICLE = ("height_m", "pitch_deg", "heading_deg", "plane_m", "hfov_deg", "lens", "yaw_deg_s")
_IN_FILES: dict[str, str] = {
    **{name: f"vehicle: {{{name}: ...}}" for name in _VEHICLE},
    "frame_rate": "auto_exposure: {frame_rate_hz: ...}",
    "mains": "auto_exposure: {mains_hz: ...}",
    **{name: f"objects: {{{name}: ...}}" for name in ("mattes", "plates", "boxes")},
    "object_speed": "objects: {speeds: {CLASS: FACTOR}}",
    "object_kmh": "objects: {crossings: {CLASS: {kmh: ...}}}",
    "object_m": "objects: {crossings: {CLASS: {away_m: ...}}}",
    "object_width_m": "objects: {crossings: {CLASS: {width_m: ...}}}",
}
_ELSEWHERE = {
    "PlanFile": {
        "ocr": "--model ppocr (reads known boxes) or --model ppocr-find (finds text first)",
        "speed": "--dx",
        "workers": "--threads",
        **dict.fromkeys(("yolo", "bdd", "text"), "--labels"),
        "parquet": "'blurnoise report RUN --parquet'",
        "no_refine": "'refine: false' in --plan FILE.yaml",
        "cache_gb": "gone: the cache has no limit, and BLURNOISE_CACHE names its folder",
    },
    "SceneFile": {
        "ego": "--ego-kmh, and vehicle: {yaw_deg_s: ..., pitch_deg_s: ...} in --scene FILE.yaml",
        "object_dx": "--moves targets --dx, or 'object_dx: ...' in --scene FILE.yaml",
        "object_dy": "--moves targets --dy, or 'object_dy: ...' in --scene FILE.yaml",
    },
    "ProgramFile": dict.fromkeys(
        ("speed_unit", "distance_m", "focal_mm", "hfov_deg"),
        "gone: 'blurnoise motion' gives px/s for --speeds",
    ),
}


_MOTION = {
    **dict.fromkeys(("height_m", "pitch_deg", "heading_deg"), "--mount M[,DEG[,DEG]]"),
    "values": "--map OUT.csv or OUT.npy, beside or in place of a picture",
    "height_px": "gone: a picture has the camera's ratio",
}


_EXPLORE = {
    "sign": "picture=sign-N",
    "picture": "picture=run/NAME",
    "figure": "NAME=NUMBER",
    "seed": "seed=N",
}


def now_called(command: str, option: str) -> str | None:
    """What an option of before is now; None where there never was such a one."""
    name = option.lstrip("-").replace("-", "_")
    if command == "motion":
        return f"{option} is now {_MOTION[name]}" if name in _MOTION else None
    if command == "explore":
        names = {axis.option.lstrip("-") for axis in AXES}
        told = _EXPLORE.get(name) or (f"{option.lstrip('-')}=..." if option.lstrip("-") in names else None)
        return told and f"{option} is now --at '{told}', the query of the page's address"
    file, kind = files().get(command, ("", None))
    if kind is None:
        return None
    known = {each: f"{each}: ..." for each in kind.names()}
    known |= {each: text for each, text in _IN_FILES.items() if text.partition(":")[0] in known}
    if name in _ELSEWHERE[kind.__name__]:
        return f"{option} is now {_ELSEWHERE[kind.__name__][name]}"
    if name not in known:
        return None
    writer = "sweep" if command in ("decide", "quality") else command
    where = f"--{file} FILE.yaml ('blurnoise {writer} --save-{file} FILE.yaml' writes one)"
    return f"{option} is now '{known[name]}' in {where}"


def files() -> dict[str, tuple[str, type[Settings]]]:
    """Of a command: its file's option, and what the file holds."""
    from blurnoise_eval.grid.plan_file import PlanFile
    from blurnoise_eval.grid.program_file import ProgramFile
    from blurnoise_eval.grid.scene_file import SceneFile

    plan = ("plan", PlanFile)
    return {
        **dict.fromkeys(("sweep", "decide", "quality"), plan),
        "simulate": ("scene", SceneFile),
        "program": ("plan", ProgramFile),
    }
