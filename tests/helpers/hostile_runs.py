"""Runs that somebody else made, wrongly or to do harm: a small one of ours, changed in one way each, harmlessly.

Each change takes the folder and its open database. ``REFUSED`` are no runs; ``READ`` are, and commands say what they
think of them.
"""

import json
import os
import shutil
import sqlite3
import struct
import zlib
from contextlib import closing
from pathlib import Path

from blurnoise_eval.datasets import rendered_signs
from blurnoise_eval.plan.axes import NAMES
from blurnoise_eval.run.evaluation import evaluate
from plans import plan
from signs_in_memory import CAMERA

SENTINEL = "of the user.txt"
"""Beside the run; no command may change it."""
ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n)"
BACKTRACKS = "(s+)+(t+)+(o+)+$|((((-?.?)+)+)+)+#"


def small_run(folder, model):
    """A run of one rendered picture, eight conditions and a detector."""
    grid = plan((0.002, 0.01), (20.0, 400.0), (0.0, 300.0), gain_db=("auto",))
    signs = rendered_signs((50,), count=1)
    evaluate(model, signs, CAMERA, grid, output=folder, strategy="grid", progress=False)
    return folder


def changed(run, place, change):
    """A copy of the run in ``place``/run, unsigned as of another account, changed, beside a file of the user's."""
    folder = shutil.copytree(run, place / "run")
    (place / SENTINEL).write_text("mine")
    with closing(sqlite3.connect(folder / "results.sqlite")) as db:
        db.execute("UPDATE about SET signature = NULL")
        change(folder, db)
        db.commit()
    for late in LATE.get(change, ()):
        late(folder)
    return folder


def sql(*statements):
    def change(folder, db):
        for statement in statements:
            db.execute(statement)

    return change


def instead(table, query):
    """A view in place of a table."""
    return sql(f"ALTER TABLE {table} RENAME TO hidden", f"CREATE VIEW {table} AS {query}")


def rewritten(old, new):
    """The statement that made a table, as the file has it, changed."""
    replaced = f"replace(sql, '{old}', '{new}')"
    return sql(
        "PRAGMA writable_schema = ON", f"UPDATE sqlite_master SET sql = {replaced} WHERE type = 'table'"
    )


def document(key, change):
    """A document made another by a function, or replaced by a text."""

    def apply(folder, db):
        text = change
        if callable(change):
            ((held,),) = db.execute("SELECT value FROM about WHERE key = ?", (key,)).fetchall() or [("null",)]
            text = json.dumps(change(json.loads(held)))
        db.execute("INSERT OR REPLACE INTO about VALUES (?, ?, NULL)", (key, text))

    return apply


def at(path, value):
    """A document with another value at a path of keys."""

    def change(held):
        *above, last = path
        inner = held
        for key in above:
            inner = inner[key]
        if value is KeyError:
            del inner[last]
        else:
            inner[last] = value
        return held

    return change


def truth(change):
    """The run's instances.json made another."""

    def apply(folder, db):
        path = folder / "coco" / "instances.json"
        path.write_text(json.dumps(change(json.loads(path.read_text()))))

    return apply


def file(make, name="results.sqlite"):
    """A file of the run made another once the database is closed."""

    def change(folder, db):
        pass

    LATE[change] = [lambda folder: make(folder / name)]
    return change


LATE: dict[object, list] = {}


def everywhere(column, value):
    return sql(*(f"UPDATE {table} SET {column} = {value}" for table in ("cells", "targets")))


def renamed_picture(name):
    """A picture's name in rows and labels alike."""

    def change(folder, db):
        for table in ("cells", "targets", "pictures"):
            db.execute(f"UPDATE {table} SET image = ?", (name,))
        path = folder / "coco" / "instances.json"
        held = json.loads(path.read_text())
        held["images"][0]["file_name"] = name
        path.write_text(json.dumps(held))

    return change


def shortened(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def pipe(path):
    path.unlink(missing_ok=True)
    os.mkfifo(path)


def outside(path):
    """A link to the user's file."""
    path.unlink(missing_ok=True)
    path.symlink_to(path.parents[0 if path.parent.name == "run" else 1].parent / SENTINEL)


def journal_of_another(path):
    with closing(sqlite3.connect(path.parent / "other")) as db:
        db.execute("PRAGMA journal_mode = WAL")
        db.execute("CREATE TABLE cells (a)")
        db.commit()
        shutil.copy(path.parent / "other-wal", path)
    with path.with_name("results.sqlite").open("r+b") as main:  # it says that it has a journal
        main.seek(18)
        main.write(b"\2\2")


def huge_picture(path):
    """A PNG of 30 000 x 30 000 px by its header."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", 30_000, 30_000, 8, 2, 0, 0, 0)
    packed, row = zlib.compressobj(1), bytes(90_001)
    rows = b"".join([*(packed.compress(row) for _ in range(30_000)), packed.flush()])
    for each in path.parent.glob("*.png"):
        each.write_bytes(
            b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
        )


def endless_tree(path):
    """Inner pages of the table of cells, eighteen deep, each of which points to the next two hundred times."""
    with closing(sqlite3.connect(path)) as db:
        ((root, size),) = db.execute(
            "SELECT rootpage, (SELECT page_size FROM pragma_page_size) FROM sqlite_master WHERE name = 'cells'"
        )
    data = bytearray(path.read_bytes())
    n_pages, start = len(data) // size, (root - 1) * size
    leaf = n_pages + 1
    inner = range(n_pages + 2, n_pages + 18)
    data += data[start : start + size]  # what the root was, a leaf or no
    for number, child in zip((root, *inner), (*inner, leaf), strict=True):
        cells = [struct.pack(">I", child) + b"\x01" for _ in range(200)]
        page = bytearray(size)
        page[:12] = struct.pack(">BHHHBI", 5, 0, len(cells), size - 5 * len(cells), 0, child)
        for place, cell in enumerate(cells):
            at_byte = size - 5 * (place + 1)
            page[at_byte : at_byte + 5] = cell
            page[12 + 2 * place : 14 + 2 * place] = struct.pack(">H", at_byte)
        if number == root:
            data[start : start + size] = page
        else:
            data += page
    data[28:32] = struct.pack(">I", len(data) // size)
    path.write_bytes(data)


def flipped(path):
    data = bytearray(path.read_bytes())
    data[5000::997] = bytes(255 - value for value in data[5000::997])
    path.write_bytes(data)


MANIFEST = ("manifest",)
PLAN = ("plan", "grid")
DEEP = "[" * 100_000 + "]" * 100_000
TABLES = {
    "a view in place of a table": instead("cells", "SELECT * FROM hidden"),
    "an endless view": instead("targets", f"{ENDLESS} SELECT i FROM n"),
    "an endless view of documents": instead(
        "about", f"{ENDLESS} SELECT 'manifest' AS key, i AS value, 1 FROM n"
    ),
    "an endless view of pictures": instead("pictures", f"{ENDLESS} SELECT i AS image FROM n"),
    "a trigger": sql("CREATE TRIGGER t AFTER INSERT ON about BEGIN DELETE FROM cells; END"),
    "a computed column": sql("ALTER TABLE cells ADD COLUMN more AS (seed + 1)"),
    "a virtual table": sql(
        "DROP TABLE skipped", "CREATE VIRTUAL TABLE skipped USING rtree(image, low, high)"
    ),
    "a table more": sql("CREATE TABLE more (a)"),
    "a table less": sql("DROP TABLE skipped"),
    "an index less": sql("DROP INDEX cells_by_image"),
    "an index of an expression": sql("CREATE INDEX more ON cells (abs(seed))"),
    "columns of another type": rewritten('"brightness" REAL', '"brightness" TEXT'),
    "a check": rewritten('"brightness" REAL', '"brightness" REAL CHECK (1)'),
    "a default": rewritten('"brightness" REAL', '"brightness" REAL DEFAULT 7'),
    "a column of lamps of another type": sql("ALTER TABLE cells ADD COLUMN pwm_phase TEXT"),
    "another version": sql("PRAGMA user_version = 7"),
    "no version": sql("PRAGMA user_version = 0"),
    "another application": sql("PRAGMA application_id = 252006674"),
    "statistics of an optimiser": sql("ANALYZE"),
}
ROWS = {
    "text for a number": sql("UPDATE cells SET brightness = 'bright'"),
    "a blob for a number": sql("UPDATE targets SET confidence = x'00ff'"),
    "infinite speed": everywhere("velocity_x_px_s", "9e999 * (1 - clean)"),
    "an exposure below 0": everywhere("exposure_s", "-exposure_s"),
    "an enormous exposure": everywhere("exposure_s", "1e300 * exposure_s"),
    "an unknown exposure": everywhere("exposure_s", "NULL"),
    "an original picture that moves": everywhere("velocity_x_px_s", "1.0"),
    "a confidence of seven": sql("UPDATE targets SET confidence = 7.0"),
    "an id that leaves the folder": everywhere("cell_id", "'../../x' || substr(cell_id, 8)"),
    "a short id": everywhere("cell_id", "substr(cell_id, 1, 9)"),
    "an id of capitals": everywhere("cell_id", "upper(cell_id)"),
    "a picture's name that leaves the folder": renamed_picture("../../x"),
    "a picture's name from the root": renamed_picture("/etc/hostname"),
    "a picture's name with a zero": renamed_picture("a\0b"),
    "a picture without a name": renamed_picture(""),
    "an enormous name": renamed_picture("x" * 2_000_000),
    "an example that leaves the folder": sql(f"UPDATE cells SET example = '../{SENTINEL}'"),
    "an example from the root": sql("UPDATE cells SET example = '/dev/zero'"),
    "a model that is none of the run": everywhere("model", "'other'"),
    "an enormous target": sql("UPDATE targets SET target_id = target_id + 1000000000000"),
    "a target below 0": sql("UPDATE targets SET target_id = -1 - target_id"),
    "targets of no cell": sql("UPDATE targets SET repeat = 3"),
    "a picture that no table has": sql("DELETE FROM pictures"),
    "an enormous picture": sql("UPDATE pictures SET width_px = 1000000000000"),
    "text that is none": sql("UPDATE pictures SET identity = CAST(x'ff00fe' AS TEXT)"),
    "a look that is no number": sql("UPDATE pictures SET look = 'zz'"),
    "a repeat of text": everywhere("repeat", "'first'"),
    "half a detection": sql("UPDATE cells SET detections = x'000102'"),
    "detections that are not finite": sql(f"UPDATE cells SET detections = x'{'0000c07f' * 6}'"),
    "detections of no class": sql(f"UPDATE cells SET detections = x'{'0000003f' * 5}ffffff7f'"),
    "text for detections": sql("UPDATE cells SET detections = 'none'"),
    "names behind a zero": everywhere("camera", "char(0) || hex(zeroblob(1000000))"),
    "a million detections": sql("UPDATE cells SET detections = zeroblob(24000000)"),
    "an enormous value": sql("UPDATE cells SET error = hex(zeroblob(20000000)) WHERE clean"),
}
DOCUMENTS = {
    "a null manifest": document("manifest", "null"),
    "a null identity": document("identity", "null"),
    "null versions": document("manifest", at(("versions",), None)),
    "a null plan": document("identity", at(("plan",), None)),
    "no plan": document("identity", at(("plan",), KeyError)),
    "null models": document("manifest", at(("models",), None)),
    "no models": document("manifest", at(("models",), [])),
    "models of one name": document("manifest", lambda held: {**held, "models": held["models"] * 2}),
    "a null camera": document("manifest", at(("camera",), None)),
    "a camera with a table in a file": document(
        "manifest", at(("camera", "quantum_efficiency"), {"csv": f"../{SENTINEL}"})
    ),
    "null pictures": document("manifest", at(("images",), None)),
    "a count of text": document("manifest", at(("images", "count"), "many")),
    "classes of numbers": document("manifest", at(("models", 0, "contract", "classes"), [1])),
    "no classes": document("manifest", at(("models", 0, "contract", "classes"), KeyError)),
    "a list for a manifest": document("manifest", "[1, 2]"),
    "text for a manifest": document("manifest", '"text"'),
    "an enormous document": document("manifest", "[" + "[]," * 6_000_000 + "[]]"),
    "no JSON": document("manifest", "{"),
    "deep JSON": document("manifest", DEEP),
    "rather deep JSON": document(
        "manifest", at(("models", 0, "contract", "head"), json.loads(DEEP[99_900:100_100]))
    ),
    "NaN": document("manifest", at(("camera", "f_number"), float("nan"))),
    "an integer of 4000 digits": document("manifest", at(("seed",), 10**4000)),
    "a grid without dy": document("identity", at((*PLAN, "velocity_y_px_s"), KeyError)),
    "a grid without light": document("identity", at((*PLAN, "illuminance_lux"), KeyError)),
    "an enormous grid": document(
        "identity",
        lambda held: at(("plan", "grid", "velocity_x_px_s"), [float(n) for n in range(20_000)])(
            at(("plan", "grid", "velocity_y_px_s"), [float(n) for n in range(20_000)])(held)
        ),
    ),
    "a grid of text": document("identity", at((*PLAN, "exposure_s"), ["long"])),
    "an unknown axis": document("identity", at((*PLAN, "weather"), [1.0])),
    "a billion repeats": document("identity", at(("plan", "repeats"), 10**9)),
    "a plan with a trajectory in a file": document("identity", at(("plan", "trajectory"), SENTINEL)),
    "a trajectory that is none": document(
        "manifest", at(("trajectory",), {"text": "x", "content": "y", "longest_s": 1.0})
    ),
    "batches of text": document("asked", '["first"]'),
    "batches of an unknown axis": document(
        "asked", '[{"n_pictures": 1, "places": [], "conditions": [{"weather": 1.0}]}]'
    ),
    "a batch of many conditions": document(
        "asked", json.dumps([{"n_pictures": 1, "places": [], "conditions": [{"exposure_s": 0.1}] * 200_000}])
    ),
    "a negative number of pictures": document(
        "asked", '[{"n_pictures": -1, "places": [], "conditions": []}]'
    ),
    "a threshold of text": document("enough", at(("threshold",), "high")),
    "time of text": document("wall_s", '"long"'),
}
FILES = {
    "half a file": file(shortened),
    "an empty file": file(lambda path: path.write_bytes(b"")),
    "no database": file(lambda path: path.write_bytes(bytes(range(256)) * 40)),
    "a pipe for a file": file(pipe),
    "a link to a file outside": file(outside),
    "the journal of another": file(journal_of_another, "results.sqlite-wal"),
    "a pipe for a journal": file(pipe, "results.sqlite-wal"),
    "a link for the journal's index": file(outside, "results.sqlite-shm"),
    "a link for the old journal": file(outside, "results.sqlite-journal"),
    "an endless tree": file(endless_tree),
    "flipped bytes": file(flipped),
}
REFUSED = TABLES | ROWS | DOCUMENTS | FILES
"""No runs: whoever opens them says so in one line."""
READ = {
    "nothing": sql(),
    "a pattern that backtracks": document("enough", at(("cluster",), BACKTRACKS)),
    "a pattern that is none": document("enough", at(("cluster",), "(")),
    "a level beyond all": document("enough", at(("threshold",), 7.0)),
    "an unknown score": document("enough", at(("score",), "beauty")),
    "scores that nobody computed": document("scores", '{"of": 9, "found": [[[]]]}'),
    "a question that is none": document("question", '{"grid": {"exposure_s": [0.1]}, "because": []}'),
    "an enormous question": document(
        "question",
        json.dumps(
            {
                "grid": {name: [float(n) for n in range(1, 900)] for name in NAMES[:4]},
                "because": [],
            }
        ),
    ),
    "a question of text": document("question", '"what"'),
    "pictures at a pipe": lambda folder, db: (
        os.mkfifo(folder.parent / "pipe"),
        db.execute("UPDATE pictures SET identity = 'a.png 1 2'"),
        document("manifest", at(("images", "source"), str(folder.parent / "pipe")))(folder, db),
        document("manifest", at(("images", "kind"), "coco"))(folder, db),
    ),
    "a picture of billions": sql("UPDATE pictures SET identity = 'rendered 50 px, 999999999 of seed 0'"),
    "a picture of no size": sql("UPDATE pictures SET identity = 'rendered .-..-5 px, 0 of seed 0'"),
    "a title that steers the terminal": document(
        "manifest", at(("title",), "\x1b[2J<script>alert(1)</script>")
    ),
    "an enormous PNG": file(huge_picture, "examples/any"),
    "an enormous file for an example": file(
        lambda path: [os.truncate(each, 20 << 30) for each in path.parent.glob("*.png")], "examples/any"
    ),
    "a pipe for an example": file(
        lambda path: [pipe(each) for each in path.parent.glob("*.png")], "examples/any"
    ),
    "a link for an example": file(
        lambda path: [outside(each) for each in path.parent.glob("*.png")], "examples/any"
    ),
    "labels that lack the picture": truth(lambda held: {**held, "images": []}),
    "labels of an unknown class": truth(lambda held: {**held, "categories": []}),
    "labels that are not finite": truth(at(("annotations", 0, "bbox"), [float("nan")] * 4)),
    "labels of text": truth(at(("annotations", 0, "area"), "large")),
    "null labels": truth(lambda held: None),
    "deep labels": lambda folder, db: Path(folder, "coco", "instances.json").write_text(DEEP),
    "a pipe for labels": file(pipe, "coco/instances.json"),
    "a link for labels": file(outside, "coco/instances.json"),
}
"""Runs in which something is wrong, or rather only strange."""
