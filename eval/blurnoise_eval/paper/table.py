"""The table of items, in the paper's order, and what cannot be compared. Adding an item is one entry."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from blurnoise_eval.paper import chart_items, formulas, network_items
from blurnoise_eval.paper.item import Item

PAPER = "Lin et al., Optimizing Camera Exposure Time for Automotive Applications, Sensors 2024, 24(16), 5135"
_SIGNS = "signs of 100, 50 and 32 px, lin2024, 50 lux"
_READER = "PP-OCR of rapidocr (the paper: v3) in known boxes; read: STOP in every noise field"
ITEMS = (
    Item(
        "table-2", "Motion blur of road users", "Table 2, eq. 14",
        "f-theta lens, 4096 px over 99.32 degrees (printed as 99)", formulas.table_2,
    ),
    Item("quanta", "Light to quanta", "eq. 9-13", "lin2024, white at 50 lux, 30 ms", formulas.quanta),
    Item(
        "frequencies", "Frequencies that a sign holds", "section 4.2.1",
        "noise-free sign, profile through its centre", formulas.frequencies,
    ),
    Item(
        "mtf50", "MTF50 over exposure", "Figures 12, 13", "slanted edge, lin2024, 50 lux",
        chart_items.mtf50_over_exposure,
    ),
    Item(
        "mtf50-dx", "MTF50 over speed", "Figure 14", "slanted edge, lin2024, 30 ms, 20 and 50 lux",
        chart_items.mtf50_over_speed,
    ),
    Item(
        "patch-snr", "Patch SNR over speed", "Figure 15", "even patches, lin2024, 30 ms, 50 lux",
        chart_items.patch_snr,
    ),
    Item(
        "edge-snr", "Edge SNR over exposure", "Figure 16", "slanted edge, lin2024, 50 lux, DX 0 to 1000",
        chart_items.edge_snr,
    ),
    Item(
        "clipping", "Where edge SNR jumps", "Figure 17", "slanted edge, lin2024, 20 to 200 lux, at rest",
        chart_items.clipping,
    ),
    Item(
        "sic", "Shannon information capacity", "Figure 18", "both edges, lin2024, 50 lux, DX 0 to 1000",
        partial(chart_items.peaks, "sic_square", "SIC", "bits/px"),
    ),
    Item(
        "neq", "Noise equivalent quanta", "Figure 19", "both edges, lin2024, 50 lux, DX 0 to 1000",
        partial(chart_items.peaks, "neq_integral", "NEQ", "quanta/px"),
    ),
    Item(
        "detection", "Signs found", "Figures 22, 23", f"{_SIGNS}; another detector than YOLOv5m",
        network_items.detection, "paper",
    ),
    Item(
        "maps", "Performance maps", "Figures 24-29",
        f"sign of 32 px, {network_items.MAP_CAMERA}, {network_items.MAP_LUX:g} lux", network_items.maps, "camera",
    ),
    Item("ocr", "STOP read over exposure", "Figure 30", f"{_SIGNS}; {_READER}", network_items.reading, "paper"),
    Item(
        "ocr-dx", "STOP read over speed", "Figure 31", f"{_SIGNS}, 30 ms; {_READER}",
        network_items.reading_over_speed, "paper",
    ),
)  # fmt: skip
NOT_COMPARED: tuple[tuple[str, str], ...] = (
    ("Figure 2", "a real photograph, not published with its light"),
    ("Figures 10, 11", "pictures of BDD100K, whose exposures and lights are not known"),
    ("Figure 14, the peak at DX 20", "the tool's blur has integer lengths, and none up to 1.5 px"),
    ("Figures 12 to 19, the numbers", "Imatest's, of its own charts; here: the shapes, by open methods"),
    ("Figures 22, 23, the confidences", "weights of the paper's YOLOv5m; here: the order of the sizes"),
    (
        "Figures 24 to 29, with lin2024",
        "its black level is 0 DN: where noise limits the detector its charts clip, and only blur is left to rank",
    ),
    ("Figures 30, 31, the confidences", "another version of PP-OCR; here: where STOP is read"),
)
"""Place, and why nothing is held to it."""


def chosen(names: Sequence[str]) -> tuple[Item, ...]:
    """The items of these names, in the table's order; all for none. Raises ``ValueError`` that lists them."""
    known = [item.name for item in ITEMS]
    for name in names:
        if name not in known:
            raise ValueError(f"only = {name!r}: must be one of {', '.join(known)}")
    return tuple(item for item in ITEMS if item.name in names or not names)
