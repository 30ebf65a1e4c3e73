"""Does training with RandomExposure help? One network, three augmentations, several seeds, on scenes none has seen.

It trains without photometric augmentation, with Kornia's motion blur and noise, and with RandomExposure. A training
that was stopped goes on where it was. The default sizes take an hour;
`--pictures 480 --held-out 8` takes minutes.
"""

import argparse
from pathlib import Path

import kornia.augmentation as kornia
import pandas
from blurnoise_eval import datasets
from blurnoise_eval.plan.plan import SweepPlan
from blurnoise_eval.run.evaluation import evaluate
from blurnoise_models.augmentation import InShare, exposures
from blurnoise_models.export import write_onnx
from blurnoise_models.scenes import write_coco
from blurnoise_models.training import train
from scipy import stats
from torch import nn


def kornias() -> InShare:
    """Kornia's motion blur and Gaussian noise, each in four of five changed pictures."""
    blur = kornia.RandomMotionBlur((3, 61), (-180.0, 180.0), 0.0, border_type="reflect", p=0.8)
    return InShare([nn.Sequential(blur, kornia.RandomGaussianNoise(std=0.05, p=0.8), nn.Hardtanh(0.0, 1.0))])


def between_seeds(each: pandas.DataFrame) -> pandas.DataFrame:
    """Means over seeds as text, with half of Student's 95 % interval."""
    groups = each.groupby("arm")
    seeds = groups.size().iloc[0]
    half = groups.std() * (stats.t.ppf(0.975, seeds - 1) / seeds**0.5 if seeds > 1 else float("nan"))
    return groups.mean().map("{:.3f}".format) + " +- " + half.map("{:.3f}".format)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("study"))
    for name, usual in (("pictures", 12_000), ("seeds", 3), ("held-out", 120)):
        parser.add_argument(f"--{name}", type=int, default=usual)
    options = parser.parse_args()

    networks = []
    for arm, augmentation in {"none": None, "kornia": kornias(), "exposure": exposures(lit=0)}.items():
        for seed in range(options.seeds):
            path = options.folder / f"{arm}-{seed}.onnx"
            networks.append(path)
            if not path.is_file():
                checkpoint = path.with_suffix(".checkpoint")
                facts = {"arm": arm}
                network = train(
                    augmentation, pictures=options.pictures, seed=seed, facts=facts, checkpoint=checkpoint
                )
                write_onnx(network, path, facts={**facts, "seed": seed, "pictures": options.pictures})
                checkpoint.unlink(missing_ok=True)

    listing = write_coco(options.folder / "held-out", 2, options.held_out)  # of a seed that no training has
    plan = SweepPlan(
        {
            "exposure_s": (1e-3, 5e-3, 20e-3, 40e-3),
            "illuminance_lux": (10.0, 50.0, 250.0),
            "velocity_x_px_s": (0.0, 400.0, 1500.0, 3000.0),
        },
        examples=False,
    )
    pictures = datasets.coco(listing, labels=["stop sign"], keep_empty=True)
    run = evaluate(networks, pictures, plan=plan, output=options.folder / "run", strategy="grid")
    run.report()
    scores = pandas.DataFrame(run.scores)
    scores[["arm", "seed"]] = scores["model"].str.rsplit("-", n=1, expand=True)
    blur_px = scores["exposure_s"] * scores["velocity_x_px_s"]
    scores["case"] = pandas.cut(blur_px, [-1, 0, 30, 1e9], labels=["at rest", "to 30 px", "further"]).astype(
        str
    )
    scores.loc[scores["clean"].astype(bool), "case"] = "clean"
    for score in ("ap50", "false_positives_per_image"):
        each = scores.pivot_table(score, ["arm", "seed"], "case")
        each["all but clean"] = scores[scores["case"] != "clean"].groupby(["arm", "seed"])[score].mean()
        print(f"\n{score}: mean over seeds, and half of its 95 % interval")
        print(between_seeds(each).to_string())
        for other in ("none", "kornia"):
            print(f"exposure less {other}, pair by pair:")
            less = each.loc["exposure"] - each.loc[other]
            print(between_seeds(pandas.concat({"difference": less}, names=["arm"])).to_string())
