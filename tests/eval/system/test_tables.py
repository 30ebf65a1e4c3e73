"""Tables as CSV: they read back, and no spreadsheet computes a text in them."""

import csv
import io

import pandas as pd
from blurnoise_eval.system.tables import csv_lines

TEXTS = [
    "=1+2", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", "\n=1", "\0=1", "'=1", "''+1", "'plain", "a=b", "", "-", '="a,b"',
]  # fmt: skip
GUARD = r"^'(?='*[=+\-@\t\r\n\0])"
"""As in the guide."""


def test_csv_reads_back():
    rows = [{"name": 'a "quoted", name', "value": 0.1, "none": None}, {"name": "two\nlines", "value": 1e-300}]
    text = "".join(csv_lines(["name", "value", "none"], [{"none": None, **row} for row in rows]))
    read = csv.DictReader(io.StringIO(text, newline=""))
    found = [(row["name"], float(row["value"]), row["none"]) for row in read]
    assert found == [(row["name"], row["value"], "") for row in rows]


def test_no_text_is_a_formula_and_pandas_reads_all_of_them_back():
    rows = [{"text": text, "value": -1.5, "count": -(2**40)} for text in TEXTS]
    text = "".join(csv_lines(["text", "value", "count"], rows))
    cells = [row[0] for row in csv.reader(io.StringIO(text, newline=""))]
    assert not [cell for cell in cells if cell.startswith(tuple("=+-@\t\r\n\0"))]
    table = pd.read_csv(io.StringIO(text, newline=""), keep_default_na=False, engine="python")
    assert table.replace(GUARD, "", regex=True)["text"].to_list() == TEXTS
    assert (table["value"].sum(), table["count"].max()) == (-1.5 * len(TEXTS), -(2**40))
