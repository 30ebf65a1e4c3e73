"""Comparison of the contract of a detector with other variants of its input.

Domain: 8-bit RGB pictures; colour order, value range with mean and standard deviation, resize, and what the columns
of the outputs are, where the values of the outputs allow several readings, are varied.

A network that is fed wrongly finds nothing, or much at random. So each picture enters as it is and mirrored, cropped
and thereby enlarged, and detections in both count: the same class, boxes that overlap by half. Labels, where there
are any, are one more view of the picture. With A, the sum of scores times overlaps that agree, and F, the sum of
scores found, the merit of a variant in a picture is sqrt(max(0, A - F/10 - F^2/1000)). Variants are compared by the
mean difference of their merits over the pictures, with Student's t.

A field without a source is chosen where every variant that differs in it is surely worse; it stays assumed where some
are only probably worse, or make no difference that matters; else it is doubtful, and a doubt names the best of them.
What somebody stated, and a resize, are doubted only where another one is significantly better (one-sided, 97.5 %).

Measured with YOLOX-Nano and FastestDet behind ten inputs and 35 photographs: garbage that finds 4600 objects agrees
to 91, the right variant finds 374 and agrees to 155. Of 100 others the right one is surely better than 98 from 24
pictures on, 89 from 10, 60 from 4.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from blurnoise_eval.contracts.mirrored_views import detected, shifted_classes
from blurnoise_eval.contracts.reduced_noise import resize_doubt
from blurnoise_eval.contracts.variants import FACTORS, PROBABLE, Image, Known, Variant, factors, other_inputs
from blurnoise_eval.datasets import PictureSet, sample
from blurnoise_eval.detectors.contract import EXPORTER, Contract
from blurnoise_eval.detectors.contract_files import contract_option
from blurnoise_eval.detectors.detector import Detector
from blurnoise_eval.detectors.python_models import FAMILY
from blurnoise_eval.detectors.records import Detections
from blurnoise_eval.scoring.on_picture import Model
from blurnoise_eval.system.terminal import say_wrapped

_ROUNDS = (2, 4, 8, 16, 32)  # pictures after which the variants that are surely worse are given up
MOST_PICTURES = _ROUNDS[-1]
_MOST_INFERENCES = 600  # a round that would lead beyond them is left out
_NOTHING_FROM = 8  # pictures in which nothing is found again, after which no further ones are shown
_MAY_BE = " may be wrong"
_READ, _READINGS = 8, 5  # pictures whose values are read, and readings that are compared
_READ_SHARE = 0.3  # of what another reading of the outputs finds, that has to agree
_GARBAGE_SHARE, _GARBAGE_FOUND = 0.15, 1.0  # less than this share agrees, of more than so much a picture


@dataclass(frozen=True)
class ContractComparison:
    """Result of a comparison: the contract with its choices and their sources, doubts as sentences, and the cost."""

    contract: Contract
    doubts: tuple[str, ...] = ()
    variants: int = 0
    pictures: int = 0
    inferences: int = 0

    @property
    def text(self) -> str:
        """Choice and cost in a sentence; "" where nothing was compared."""
        if not self.variants:
            return ""
        return (
            f"input {_text(self.contract)}; {', '.join(factors(self.contract, 'chosen')) or 'nothing'} chosen by "
            f"comparing {self.variants} variants on {_pictures(self.pictures)} ({self.inferences} inferences)"
        )


def contracts_chosen(
    models: Sequence[Model], pictures: PictureSet, *, say: bool | None = None
) -> tuple[list[Model], dict[str, ContractComparison]]:
    """The models with the contracts that the pictures chose, and by name the comparison of each detector.

    pictures: of the whole run, so that each part of it chooses alike; rendered ones choose nothing. say: whether to
    write choices and doubts to standard error.
    """
    chosen, comparisons = list(models), dict[str, ContractComparison]()
    for index, model in enumerate(models):
        if not isinstance(model, Detector) or model.contract.family == FAMILY or pictures.kind == "rendered":
            continue
        comparison = comparisons[model.name] = compared(model, _known(model, pictures))
        chosen[index] = model.with_contract(comparison.contract)
        if say and factors(comparison.contract, "chosen", "assumed") and comparison.text:
            say_wrapped(f"{model.name}: {comparison.text}", hanging=2, error=True)
    doubted = dict[str, list[tuple[str, str]]]()
    for name, comparison in comparisons.items() if say else ():
        for doubt in comparison.doubts:
            doubted.setdefault(doubt.partition(_MAY_BE)[0], []).append((name, doubt))
    for (name, doubt), *others in doubted.values():
        more = f". The same fields of {', '.join(other for other, _ in others)}" if others else ""
        say_wrapped(f"{name}: doubtful contract: {doubt}{more}", hanging=2, error=True)
    return chosen, comparisons


def _known(detector: Detector, pictures: PictureSet) -> Iterator[Known]:
    """At most 32 of the pictures, with those labels that the detector knows; without, if these are doubtful."""
    ids = {name: number for number, name in enumerate(detector.contract.classes)}
    for picture, image in sample(pictures, MOST_PICTURES):
        targets = None if pictures.doubtful else picture.targets
        known = [target for target in targets or () if target.label in ids and not target.crowd]
        boxes = np.array([target.box_xyxy for target in known], np.float32)
        class_ids = np.array([ids[target.label] for target in known], np.int64)
        yield image, Detections(boxes, np.ones(len(known), np.float32), class_ids) if known else None


def compared(detector: Detector, pictures: Iterable[Known]) -> ContractComparison:
    """Compare a detector's contract with the other variants of its input, on up to 32 pictures.

    Fields without a source are chosen; others are never changed, only doubted. What an exporter's code fixes, as its
    metadata say, is not questioned. The same pictures give the same choice. Costs two inferences for each picture and
    variant that is still in question, 100 to 500.
    """
    shown = list(pictures)[:MOST_PICTURES]
    detector, readings, notes = _read_by_values(detector, shown[:_READ])
    variants = [Variant(detector.contract), *map(Variant, readings)]
    if not any(EXPORTER in detector.contract.sources[name] for name in ("colour", "value_range")):
        variants += map(Variant, other_inputs(detector))
    count, inferences = _show(detector, variants, shown) if len(variants) > 1 else (0, 0)
    final, sources, doubts = _decided(variants, count, labelled=any(labels for _, labels in shown))
    if not final.problems:  # nothing was compared, but outputs may show that the contract is wrong
        inferences += len(shown)
        read = detector.with_contract(final.contract)
        answers = [detected(read, image) for image, _ in shown]
        final.seen, final.problems = (
            ([*column] for column in zip(*answers, strict=True)) if answers else ([], [])
        )
    if shifted := shifted_classes(final.seen, [labels for _, labels in shown[: len(final.seen)]]):
        doubts.append(shifted)
        sources = {name: source for name, source in sources.items() if name != "outputs"}
    if wrong := _common(final.problems):
        final, sources, doubts = variants[0], {}, wrong
    contract = replace(final.contract, sources={**detector.contract.sources, **sources})
    n_variants = len(variants) if count else 0
    reduced = resize_doubt(detector.with_contract(contract), [image for image, _ in shown])
    return ContractComparison(
        contract, (*notes, *doubts, *[reduced] * bool(reduced)), n_variants, count or len(shown), inferences
    )


def _show(detector: Detector, variants: list[Variant], shown: Sequence[Known]) -> tuple[int, int]:
    """Show the pictures to the variants, in rounds, and give up those that are surely worse.

    The best variant is added with its other resize. Returns the numbers of pictures and of inferences.
    """
    count, inferences = 0, 0
    for upto in _ROUNDS:
        left = [variant for variant in variants if not variant.given_up]
        cost = 2 * len(left) * (min(upto, len(shown)) - count)
        if not cost or len(left) == 1 or inferences + cost > _MOST_INFERENCES:
            break
        count = min(upto, len(shown))
        inferences += sum(variant.show(detector, shown[:count]) for variant in left)
        best = _best_of_its_resize(variants[0], left)
        if count >= _NOTHING_FROM and best.merit == 0:
            break
        for variant in left[1:]:
            variant.given_up = variant is not best and best.surely_beats(variant)
        if best.contract.resize != "none":  # that a letterbox is centred hardly matters: AP50 .410 and .407
            resize: Any = "letterbox" if best.contract.resize == "stretch" else "stretch"
            other = Variant(replace(best.contract, resize=resize))
            if all(variant.contract != other.contract for variant in variants):
                inferences += other.show(detector, shown[:count])
                variants.append(other)
    return count, inferences


def _read_by_values(detector: Detector, shown: Sequence[Known]) -> tuple[Detector, list[Contract], list[str]]:
    """The detector by the reading of its outputs that their values allow, the contracts of the others, and notes.

    A reading that somebody stated is kept, and doubted where the values refute it.
    """
    own, notes = detector.contract, list(detector.false_shapes)
    if own.outputs is None or not shown:
        return detector, [], notes
    free = own.sources["outputs"].startswith("assumed")
    others_too = free and detector.family.by_shape
    images = [image for image, _ in shown]
    allowed, why = detector.readings(
        images, [own, *(other_inputs(detector) if free else ())], others=others_too
    )
    pictures = _pictures(len(shown))
    if not why:
        return detector, [replace(own, outputs=outputs) for outputs in allowed[1:_READINGS]], notes
    others = " or ".join(f"{outputs!r}" for outputs in allowed[:_READINGS])
    advice = (
        f"set outputs in the contract: {others} may be right" if others else "no reading that is known fits"
    )
    if not free or not allowed:
        doubt = f"outputs{_MAY_BE} ({own.sources['outputs']}): in {pictures} {why}; {advice}"
        return detector, [], [*notes, doubt]
    source = f"chosen by the values of {pictures}: {why} with {own.outputs!r}"
    if len(allowed) > 1:
        source = f"assumed, since {why} with {own.outputs!r}"
    read = replace(own, outputs=allowed[0], sources={**own.sources, "outputs": source})
    return (
        detector.with_contract(read),
        [replace(read, outputs=outputs) for outputs in allowed[1:_READINGS]],
        notes,
    )


def _best_of_its_resize(own: Variant, among: Sequence[Variant]) -> Variant:
    """Colours and values are compared with the contract's own resize: between two resizes there may be a tie."""
    return max(
        (variant for variant in among if "resize" not in variant.differs(own)),
        key=lambda variant: variant.merit,
    )


def _decided(
    variants: Sequence[Variant], count: int, *, labelled: bool
) -> tuple[Variant, dict[str, str], list[str]]:
    """The variant that so many pictures choose, sources of fields that nothing states, and doubts."""
    own, left = variants[0], [variant for variant in variants if not variant.given_up]
    if not count:
        return own, {}, []
    if not labelled and any(_alike(variant) for variant in left if variant.seen):
        text = f"the model finds the same in each of {_pictures(count)}, so they confirm no contract"
        return own, {}, [text]
    assumed, shown = factors(own.contract, "assumed"), _pictures(count)
    free = [variant for variant in left if set(variant.differs(own)) <= set(assumed)]
    best = _best_of_its_resize(own, free)
    final = best if best.lead(own, PROBABLE) > 0 and _may_be_read(best, own) else own
    resized = (
        variant for variant in free if variant.differs(final) == ["resize"] and variant.surely_beats(final)
    )
    final = next(resized, final)
    found, agreed = sum(final.found), sum(final.agreed)
    wrong = [
        f"only {agreed / max(found, 1e-9):.0%} of its detections (sum of scores {found:.3g}) are found again in the "
        f"mirrored, cropped view of {shown}; family, input or export are probably wrong"
    ]
    if found < _GARBAGE_FOUND * count or agreed >= _GARBAGE_SHARE * found:
        wrong = []
    if not any(variant.merit for variant in left):
        nothing = (
            f"no detection is found again in {shown} with any contract, so the contract is not confirmed"
        )
        return own, {}, wrong or [nothing] * bool(assumed)
    others = [
        (variant, variant.standing(final, stated=variant not in free))
        for variant in variants
        if variant is not final
    ]
    sources = dict[str, str]()
    for factor in assumed:
        standings = {standing for variant, standing in others if factor in variant.differs(final)}
        for name in FACTORS[factor] if standings else ():
            if (source := own.contract.sources[name]).startswith("assumed"):
                sources[name] = _source(source, standings, f"{len(variants)} variants on {shown}")
    rivals = [variant for variant, standing in others if standing == "rival"]
    return final, sources, [_doubt(final, rivals, shown)] if rivals else wrong


def _may_be_read(best: Variant, own: Variant) -> bool:
    """Whether another reading of the outputs is chosen: if surely better, and much of what it finds agrees."""
    if "outputs" not in best.differs(own):
        return True
    return best.surely_beats(own) and sum(best.agreed) >= _READ_SHARE * sum(best.found)


def _alike(variant: Variant) -> bool:
    """Whether a graph answers every picture alike, so that mirrored ones say nothing."""
    first, *others = variant.seen
    same = (np.array_equal(first.boxes_xyxy, other.boxes_xyxy) for other in others)
    return len(first) > 0 and len(others) > 0 and all(same)


def _doubt(final: Variant, rivals: Sequence[Variant], shown: str) -> str:
    """Why a contract may be wrong, by the best of the variants that may be better."""
    rival = max(rivals, key=lambda each: (round(each.merit, 6), -len(each.differs(final))))
    differing = rival.differs(final)
    sources = dict.fromkeys(final.contract.sources[name] for factor in differing for name in FACTORS[factor])
    sums, own = (f"{sum(each.agreed):.3g} of {sum(each.found):.3g}" for each in (rival, final))
    option = contract_option(rival.contract)
    return (
        f"{', '.join(differing)}{_MAY_BE} ({'; '.join(sources)}). Sum of scores found again in the mirrored, "
        f"cropped view of {shown}: {sums} with {_text(rival.contract)}, {own} with {_text(final.contract)}"
        f"{f'. If the former is right, use --contract {option}' if option else ''}"
    )


def _source(source: str, standings: set[str], compared: str) -> str:
    """Where a field comes from that nothing states, by the standings of the variants that differ in it."""
    if "rival" in standings:
        return f"assumed, doubtful: {compared} do not decide"
    if "open" in standings:
        return f"{source}; {compared} do not decide, as others find much the same"
    if "less likely" in standings:
        return f"assumed, probable by comparing {compared}"
    return f"chosen by comparing {compared}"


def _pictures(count: int) -> str:
    return f"{count} picture{'s' if count > 1 else ''}"


def _text(contract: Contract) -> str:
    """How a picture enters: "rgb, 0-1, letterbox"."""
    values = ((name, getattr(contract, name)) for name in ("mean", "std"))
    stated = [f"{name} {list(each)}" for name, each in values if each]
    outputs = [f"outputs {contract.outputs!r}"] if "chosen" in contract.sources["outputs"] else []
    return ", ".join([contract.colour, contract.value_range, *stated, contract.resize, *outputs])


def output_problems(detector: Detector, image: Image) -> list[str]:
    """What in the outputs of one RGB picture (h, w, 3) shows that contract or export are wrong: values that are not
    finite, scores that are all exactly 0, or above 1; columns that are something else than stated, or may be."""
    detector, others, notes = _read_by_values(detector, [(image, None)])
    if others:
        readings = " or ".join(repr(other.outputs) for other in others)
        own = detector.contract
        notes.append(
            f"outputs{_MAY_BE} ({own.sources['outputs']}): a test picture leaves open whether they are "
            f"{own.outputs!r} or {readings}; --probe PICTURES compares them, outputs in the contract sets them"
        )
    if any(_MAY_BE in note for note in notes):
        return notes
    return [*notes, *filter(None, [detected(detector, image)[1]])]


def _common(problems: Sequence[str]) -> list[str]:
    """Problems that at least half of the pictures show, each in the words of the first."""
    alike: dict[str, list[str]] = {}
    for text in filter(None, problems):
        alike.setdefault(text.split()[0], []).append(text)
    common = [texts for texts in alike.values() if 2 * len(texts) >= len(problems)]
    return [f"{len(texts)} of {_pictures(len(problems))}: {texts[0]}" for texts in common]
