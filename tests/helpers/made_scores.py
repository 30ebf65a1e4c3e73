"""An engine that computes no picture: every target has a score that is known in closed form."""

from dataclasses import replace

from blurnoise_eval.store.store import PictureFacts
from stored_rows import clean_result, result


class MadeScores:
    """Every target scores 0.9 on the original pictures, and 0.9 of what ``kept`` says elsewhere.

    kept: of a condition's values by axis; cells: how many were computed, and conditions: which.
    """

    def __init__(self, pictures, camera, kept):
        self.pictures, self.camera, self.kept = pictures, camera, kept
        self.cells, self.conditions = 0, {}

    def map(self, work, blocks):
        for block in blocks:
            self.cells += len(block.cells)
            yield block, [self._scored(work.models[0].name, cell) for cell in block.cells]

    def _scored(self, model, cell):
        shared = {"cell_id": cell.cell_id, "image": cell.image, "model": model, "repeat": cell.repeat}
        if cell.conditions is None:
            found, kept = clean_result(0, **shared), 1.0
        else:
            self.conditions[cell.conditions] = None
            at = cell.conditions.on(self.camera)
            found, kept = result(0, **shared, **at, blur_px=0.0), self.kept(at)
        targets = tuple(
            replace(row, target=replace(row.target, confidence=0.9 * kept)) for row in found.targets
        )
        (identity,) = (each.identity for each in self.pictures if each.name == cell.image)
        return replace(found, targets=targets, picture=PictureFacts(identity, "", 320, 320, ""))
