"""Comparison of a detector's contract with the other variants of its input: what is chosen, confirmed or doubted.

Of what nothing stated, a field is chosen where every variant that differs in it is surely worse; it stays assumed
where the others make no difference that matters; else it is doubtful, and a doubt names the best of them.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from blurnoise_eval.detectors.contract import EXPORTER, Contract, ModelError
from blurnoise_eval.detectors.contract_files import contract_option
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.scoring.matching import FOUND_SCORE
from blurnoise_eval.scoring.uncertainty import interval_of, left_out
from blurnoise_eval.sweep.input_variants import (
    FACTORS,
    Image,
    Known,
    Variant,
    agreement,
    input_text,
    other_inputs,
    part_text,
    resized,
)

_ROUNDS = (2, 4, 8, 16, 32)  # pictures after which the variants that are surely worse are given up
MOST_PICTURES = _ROUNDS[-1]
_MATTERS = 0.05  # relative gain in merit; another resize that may gain more is a doubt
_SAME = 0.98  # of what two variants find, from where on it does not matter which one is right
_MOST_INFERENCES = 600  # a round that would lead beyond them is left out
_NOTHING_FROM = 8  # pictures in which nothing is found again, after which no further ones are shown
_LIKELY, _PROBABLE = 0.975, 0.84  # one-sided levels of Student's t
_GARBAGE_SHARE = 0.15  # of what is found agrees less
_GARBAGE_FOUND = 1.0  # though so much is found in a picture, in sum of scores


@dataclass(frozen=True)
class Comparison:
    """Result of a comparison. contract: the detector's, with what was chosen and where from; doubts: sentences.

    pictures, inferences, seconds: what it cost. variants: a row for each, the best first.
    """

    contract: Contract
    doubts: tuple[str, ...] = ()
    pictures: int = 0
    inferences: int = 0
    seconds: float = 0.0
    variants: tuple[dict[str, Any], ...] = ()

    @property
    def text(self) -> str:
        """What was chosen, or that nothing was, and the cost, in a sentence; nothing where nothing was compared."""
        if not self.variants:
            return ""
        cost = f"{len(self.variants)} variants on {_pictures(self.pictures)}"
        cost += f" ({self.inferences} inferences, {self.seconds:.1f} s)"
        chosen, open_ = (
            ", ".join(
                factor
                for factor, names in FACTORS.items()
                if any(self.contract.sources[name].startswith(status) for name in names)
            )
            for status in ("chosen", "assumed")
        )
        told = f"{chosen} chosen by comparing" if chosen else "compared"
        untold = f", which do not tell {open_}" if open_ else ""
        return f"input {input_text(self.contract)}; {told} {cost}{untold}"

    def row(self) -> dict[str, Any]:
        """As a run records it."""
        return {name: value for name, value in asdict(self).items() if name not in ("contract", "doubts")}


def output_problems(detector: Detector, image: Image) -> list[str]:
    """What in the answer to one RGB picture (h, w, 3) shows that contract or export are wrong, whatever is seen.

    NaN or infinite outputs, scores that are all exactly 0, or above 1. Costs one inference.
    """
    blob, placement = detector.prepare(image)
    outputs = detector.run(blob)
    if count := sum(int(output.size - np.isfinite(output).sum()) for output in outputs):
        return [f"the outputs hold {count} values that are NaN or infinite"]
    # Graphs that suppress double answers themselves pad with zeros, or answer nothing.
    if detector.contract.nms_iou is not None and detector.top_score(outputs) == 0:
        return [
            "every score is exactly 0: is it an int8 export whose one output scale rounds all scores away?"
        ]
    try:
        detector.decode(outputs, placement, min_score=FOUND_SCORE)
    except ModelError as error:
        return [str(error)]
    return []


def compared(detector: Detector, pictures: Iterable[Known]) -> Comparison:
    """Compare a detector's contract with the other variants of its input, on up to 32 pictures.

    Fields that nothing stated are chosen by it; others are never changed. Where a variant of what nothing stated is
    not surely worse and its choice may matter, or where one of what is stated is probably better, that is a doubt.
    What an exporter's code fixes, as its metadata say, is not questioned. The same pictures give the same choice.
    Costs two inferences for each picture and variant that is still in question, 100 to 500.
    """
    began = time.perf_counter()
    shown = list(pictures)[:MOST_PICTURES]
    own, variants = detector.contract, [Variant(detector.contract)]
    if not any(EXPORTER in own.sources[name] for name in ("colour", "value_range")):
        variants += [Variant(other) for other in other_inputs(detector)]
    inferences, count = 0, 0
    for upto in _ROUNDS if len(variants) > 1 else ():
        left = [each for each in variants if not each.given_up]
        cost = 2 * len(left) * (min(upto, len(shown)) - count)
        if not cost or len(left) == 1 or inferences + cost > _MOST_INFERENCES:
            break
        count = min(upto, len(shown))
        inferences += sum(each.show(detector, shown[:count]) for each in left)
        best = _best_of_its_resize(variants[0], left)
        if count >= _NOTHING_FROM and best.merit == 0:
            break
        for each in left[1:]:
            each.given_up = each is not best and best.surely_beats(each)
        added = resized(best, variants)
        inferences += sum(each.show(detector, shown[:count]) for each in added)
        variants += added
    contract, doubts = _judged(variants, shown[:count]) if count else (own, [])
    count = count or len(shown)
    if problems := _common_problems(detector.with_contract(contract), shown[:count]):
        contract, doubts = own, problems
    rows = sorted((_row(each, shown) for each in variants if each.agreed), key=lambda row: -row["merit"])
    seconds = time.perf_counter() - began
    return Comparison(contract, tuple(doubts), count, inferences + count, seconds, tuple(rows))


def _best_of_its_resize(own: Variant, among: Sequence[Variant]) -> Variant:
    """Colours and values are compared with the contract's own resize: between two resizes there may be a tie."""
    return max((each for each in among if not each.differs(own, "resize")), key=lambda each: each.merit)


def _surely_worse(rival: Variant, final: Variant, shown: Sequence[Known]) -> bool:
    """Whether a variant is surely worse: by its AP50, where the pictures have labels, else by its merit."""
    ap50, own_ap50 = rival.ap50(shown), final.ap50(shown)
    if ap50 is not None and own_ap50 is not None:
        high = interval_of(left_out(ap50 - own_ap50), None)[1]
        if high is not None and high < 0:
            return True
    return final.surely_beats(rival)


def _only_resized(one: Variant, other: Variant) -> bool:
    return [factor for factor in FACTORS if one.differs(other, factor)] == ["resize"]


def _is_open(rival: Variant, final: Variant, *, stated: bool = False) -> bool:
    """Whether a variant may be right instead of one that is not surely better, and it matters.

    Other colours and values matter unless what is found is the same, another resize if it may gain much. stated: in
    place of what somebody stated, which it probably has to beat.
    """
    if _same(rival, final) >= _SAME:
        return False
    gain = rival.lead(final, _PROBABLE) if stated else -final.lead(rival, _LIKELY)
    return gain > (_MATTERS * final.merit if _only_resized(rival, final) else 0)


def _same(one: Variant, other: Variant) -> float:
    """The share of what two variants find in the pictures that is the same, by scores and overlaps."""
    same = sum(map(agreement, one.counted, other.counted))
    every = sum(float(each.scores.sum()) for variant in (one, other) for each in variant.counted) / 2
    return same / max(every, 1e-9)


def _judged(variants: Sequence[Variant], shown: Sequence[Known]) -> tuple[Contract, list[str]]:
    """The contract with what the pictures chose, and the doubts that they raise."""
    own, left, count = variants[0], [each for each in variants if not each.given_up], len(shown)
    sources = dict(own.contract.sources)
    open_factors = [f for f, names in FACTORS.items() if any(sources[n].startswith("assumed") for n in names)]
    free = [each for each in left if not any(each.differs(own, f) for f in FACTORS if f not in open_factors)]
    best = _best_of_its_resize(own, free)
    final = best if best.lead(own, _PROBABLE) > 0 else own
    final = next((each for each in free if _only_resized(each, final) and each.surely_beats(final)), final)
    rivals = [
        each
        for each in left
        if each is not final
        and not _surely_worse(each, final, shown)
        and _is_open(each, final, stated=each not in free)
    ]
    found, agreed = sum(final.found), sum(final.agreed)
    something = any(each.merit for each in left)
    doubts: list[str] = []
    if something and rivals:
        doubts = [_doubt(final, rivals, shown)]
    elif found >= _GARBAGE_FOUND * count and agreed < _GARBAGE_SHARE * found:
        doubts = [
            f"what it finds ({found:.3g} in sum of scores) is not found again when {_pictures(count)} are mirrored "
            f"and cropped ({agreed / found:.0%} is): family, input or export are probably wrong"
        ]
    elif open_factors and not something:
        doubts = [
            f"nothing is found again in {_pictures(count)}, however they enter: nothing confirms the contract"
        ]
    if not something:
        return own.contract, doubts
    for factor in open_factors:
        for name in FACTORS[factor]:
            if sources[name].startswith("assumed"):
                sources[name] = _source(sources[name], variants, final, factor, shown)
    return replace(final.contract, sources=sources), doubts


def _doubt(final: Variant, rivals: Sequence[Variant], shown: Sequence[Known]) -> str:
    """Why a contract may be wrong, by the best of the variants that may be better."""
    factors = {id(each): [factor for factor in FACTORS if each.differs(final, factor)] for each in rivals}
    rival = max(rivals, key=lambda each: (round(each.merit, 6), -len(factors[id(each)])))
    differing = factors[id(rival)]
    whence = dict.fromkeys(final.contract.sources[name] for factor in differing for name in FACTORS[factor])
    sure = "surely " * rival.surely_beats(final)
    again = f"{sure}more" if rival.merit > final.merit else "nearly as much"
    parts = [
        f"{', '.join(differing)} may be wrong ({'; '.join(whence)}): read as {rival} instead of {final}, {again} "
        f"is found again where "
        f"{_pictures(len(shown))} are mirrored and cropped ({sum(rival.agreed):.3g} of {sum(rival.found):.3g} in sum "
        f"of scores, instead of {sum(final.agreed):.3g} of {sum(final.found):.3g})",
        f"{_same(rival, final):.0%} of what the two find is the same",
    ]
    ap50, own_ap50 = rival.ap50(shown), final.ap50(shown)
    if ap50 is not None and own_ap50 is not None:
        low, high = interval_of(left_out(ap50 - own_ap50), None)
        span = "" if low is None or high is None else f", {low:+.3f} to {high:+.3f}"
        parts.append(f"AP50 {ap50[0]:.3f} instead of {own_ap50[0]:.3f}{span}")
    if len(rivals) > 1:
        parts.append(f"further variants that are open: {len(rivals) - 1}")
    parts.append("more pictures would tell" if len(shown) < MOST_PICTURES else "the pictures do not tell")
    if option := contract_option(rival.contract):
        parts.append(f"if the former is right: --contract {option}")
    return "; ".join(parts)


def _source(
    source: str, variants: Sequence[Variant], final: Variant, factor: str, shown: Sequence[Known]
) -> str:
    """Where a field comes from that nothing states."""
    rivals = [each for each in variants if each.differs(final, factor)]
    open_ = [each for each in rivals if not each.given_up and not _surely_worse(each, final, shown)]
    compared = f"{len(variants)} variants on {_pictures(len(shown))}"
    if not rivals:
        return source
    if not open_:
        return f"chosen by comparing {compared}"
    near = max(open_, key=lambda each: (_is_open(each, final), each.merit))
    untold = f"{compared} do not tell it from {part_text(near.contract, factor)}"
    if _is_open(near, final):
        return f"assumed, doubtful: {untold}"
    if (same := _same(near, final)) >= _SAME:
        return f"{source}; {untold}, by which {same:.0%} of what is found is the same"
    return f"{source}; {untold}, whose merit is at most {_MATTERS:.0%} higher"


def _pictures(count: int) -> str:
    return f"{count} picture{'s' if count > 1 else ''}"


def _row(variant: Variant, shown: Sequence[Known]) -> dict[str, Any]:
    contract, ap50 = variant.contract.to_dict(), variant.ap50(shown)
    return {
        **{name: contract[name] for names in FACTORS.values() for name in names},
        "pictures": len(variant.agreed),
        "found": sum(variant.found),
        "agreed": sum(variant.agreed),
        "merit": variant.merit,
        "classes": len({class_id for each in variant.counted for class_id in each.class_ids.tolist()}),
        "ap50": None if ap50 is None else float(ap50[0]),
    }


def _common_problems(detector: Detector, shown: Sequence[Known]) -> list[str]:
    """Problems of the outputs that at least half of the pictures show, each in the words of the first."""
    raised: dict[str, list[str]] = {}
    for image, _ in shown:
        try:
            problems = output_problems(detector, image)
        except ModelError:
            continue
        for text in problems:
            raised.setdefault(text.split()[0], []).append(text)
    return [
        f"{len(texts)} of {_pictures(len(shown))}: {texts[0]}"
        for texts in raised.values()
        if 2 * len(texts) >= len(shown)
    ]
