"""Pictures and what is in them: files of several kinds, or targets rendered on the spot.

A picture is read when it is needed and not before, so a set of any size streams through. Labels are read
strictly: what cannot be meant is a ``ValueError`` of one line that names the file and the place in it.
"""

from blurnoise_eval.datasets.bdd_labels import bdd
from blurnoise_eval.datasets.coco_labels import coco
from blurnoise_eval.datasets.cut_outs import check_cut, check_labelled, cut_out, outlines, target_mask
from blurnoise_eval.datasets.folder import image_folder, picture_doubts
from blurnoise_eval.datasets.images import (
    content,
    decode,
    decode_any,
    eight_bit,
    encode,
    read_picture,
    sample,
    size_px,
    unit,
    write_light,
    write_picture,
)
from blurnoise_eval.datasets.records import (
    DOUBTFUL_LABELS,
    Coded,
    Image,
    Picture,
    PictureSet,
    Target,
    UnreadablePicture,
    size_group,
)
from blurnoise_eval.datasets.rendered import RENDERED_SIZE_PX, rendered_signs, rendered_texts
from blurnoise_eval.datasets.text_labels import texts
from blurnoise_eval.datasets.voc_labels import voc
from blurnoise_eval.datasets.yolo_labels import yolo

__all__ = [
    "DOUBTFUL_LABELS", "RENDERED_SIZE_PX", "Coded", "Image", "Picture", "PictureSet", "Target",
    "UnreadablePicture", "bdd", "check_cut", "check_labelled", "coco", "content", "cut_out", "decode",
    "decode_any", "eight_bit", "encode", "image_folder", "outlines", "picture_doubts", "read_picture",
    "rendered_signs", "rendered_texts", "sample", "size_group", "size_px", "target_mask", "texts", "unit", "voc",
    "write_light", "write_picture", "yolo",
]  # fmt: skip
