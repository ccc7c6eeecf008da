"""Tables from files: every number stays in its column, or there is an error that says why."""

import pandas as pd
import pytest

import hybridsurrogate as hs
from hybridsurrogate.simulation.table_file import read_csv

TABLE = pd.DataFrame({"a": [1.0, 2.0], "b": [3.0, 4.0], "y": [5.0, 6.0]})


def read(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "table.csv"
    path.write_bytes(text.encode(encoding))
    return read_csv(path)


@pytest.mark.parametrize(
    "text",
    [
        "a,b,y\n1,3,5\n2,4,6\n",
        "# made by hand\na,b,y # metres\n1,3,5 # calm\n2,4,6\n",
        "a , b ,y \n1, 3, 5\n2, 4, 6\n",
        # lines that end in a comma shifted all columns by one, without a word
        "a,b,y\n1,3,5,\n2,4,6,\n",
        "a,b,y\n1,3,5,,\n2,4,6,,\n",
        "a,b,y,\n1,3,5,\n2,4,6,\n",
    ],
)
def test_columns_hold_what_stands_under_their_names(tmp_path, text):
    table = read(tmp_path, text)
    pd.testing.assert_frame_equal(table[["a", "b", "y"]], TABLE, check_dtype=False)


def test_the_sign_of_a_comment_may_be_part_of_a_name(tmp_path):
    """As the header was cut there, and no other line, all columns were shifted by one."""
    table = read(tmp_path, "# two runs\na,b,run #,y\n1,3,7,5\n2,4,8,6\n")
    assert list(table.columns) == ["a", "b", "run #", "y"]
    pd.testing.assert_frame_equal(table[["a", "b", "y"]], TABLE, check_dtype=False)


@pytest.mark.parametrize(
    ("text", "encoding", "message"),
    [
        ("a,b,y\n1,3,5,9\n2,4,6,9\n", "utf-8", "more cells than the header"),
        ("a,b,y\n1,3,5\n2,4,6,9\n", "utf-8", "Expected 3 fields in line 3, saw 4"),
        ("", "utf-8", "no columns"),
        ("a,b [°C],y\n1,3,5\n", "latin-1", "UTF-8"),
        ("a,b,y\n1,3,5\n", "utf-16", "UTF-8"),
    ],
)
def test_what_cannot_be_read_is_told_with_its_file(tmp_path, text, encoding, message):
    with pytest.raises(ValueError, match=message) as error:
        read(tmp_path, text, encoding)
    assert "table.csv" in str(error.value)


def test_runs_are_read_as_they_stand(tmp_path):
    rows = "".join(f"{k},{k % 7},{k % 5},{k % 3},\n" for k in range(40))
    (tmp_path / "runs.csv").write_text("t,rate,batch #,y\n" + rows)
    runs = hs.read_simulation(
        tmp_path / "runs.csv", ["t"], {"rate": hs.truncated_normal(3, 2, 0, 7)}, "y"
    )
    assert runs.y.tolist() == [k % 3 for k in range(40)]
    assert runs.X[:, 0].tolist() == list(range(40))


@pytest.mark.parametrize("ending", ["xlsx", "xls", "ods", "XLSX"])
def test_a_spreadsheet_is_refused_with_the_cure(tmp_path, ending):
    path = tmp_path / f"runs.{ending}"
    path.write_bytes(b"PK\x03\x04\xff")
    match = r"save the sheet as CSV, or read it with pandas\.read_excel and give the table to "
    with pytest.raises(ValueError, match=match + r"SimulationData\.from_frame"):
        hs.read_simulation(path, ["t"], {"rate": hs.truncated_normal(3, 2, 0, 7)}, "y")
