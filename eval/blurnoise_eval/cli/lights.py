"""``blurnoise lights``: the named lights."""

from __future__ import annotations

from blurnoise_eval.system.terminal import show


def lights() -> None:
    """List the named lights: the lux on the scene, the spectrum, the headlamps, and the source of the lux.

      blurnoise sweep --light street,lit-street,dusk,daylight -o run
      blurnoise simulate photo.jpg -o out.png --light sodium-street

    Lux and spectrum are those of the surroundings, without the headlamps. Where the source gives lux alone, spectrum
    and headlamps are assumed. Compare lights of one lux by --lux and --illuminant.
    """
    from rich import box
    from rich.table import Table

    from blurnoise.light.lights import named_lights

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    for head in ("light", "lux", "spectrum", "headlamps", "source"):
        table.add_column(head, justify="right" if head == "lux" else "left", no_wrap=head != "source")
    for light in named_lights().values():
        table.add_row(light.name, f"{light.lux:g}", light.illuminant, light.headlamp, light.source)
    show(table)
