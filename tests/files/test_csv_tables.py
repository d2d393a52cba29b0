"""A table is written as pandas writes it, byte for byte."""

import numpy as np
import pandas as pd
import pytest

from rock2d.files.csv_tables import ROWS_AT_ONCE, write_csv


def written(tmp_path, table):
    """What `write_csv` and pandas make of a table."""
    write_csv(tmp_path / "own.csv", table)
    table.to_csv(tmp_path / "pandas.csv", index=False, lineterminator="\n")
    return (tmp_path / "own.csv").read_bytes(), (tmp_path / "pandas.csv").read_bytes()


def test_numbers_of_every_size(tmp_path):
    # random bits are all sizes from 1e-308 to 1e308; the others are where the form of a number changes
    rng = np.random.default_rng(1)
    bits = rng.integers(0, 2**64, 30_000, dtype=np.uint64).view(np.float64)
    usual = rng.normal(size=30_000) * 10.0 ** rng.integers(-6, 19, 30_000)
    powers = np.concatenate([s * np.nextafter(10.0 ** np.arange(-8, 24), to) for s in (1, -1) for to in (0, 1e30)])
    named = [0.0, -0.0, 1.0, -3.0, 1e-4, 9.999e-5, 1e15, 1e16, 2.0**53, 5e-324, np.nan, np.inf, -np.inf, 0.1 + 0.2]
    values = np.concatenate([bits, usual, powers, named])
    own, of_pandas = written(tmp_path, pd.DataFrame({"value": values, "release": np.arange(len(values))}))
    assert own == of_pandas


def test_a_table_longer_than_one_part(tmp_path):
    n = 2 * ROWS_AT_ONCE + 1
    table = pd.DataFrame({"release": np.arange(n), "block": np.repeat("ball", n), "t_s": np.arange(n) / 50.0})
    own, of_pandas = written(tmp_path, table)
    assert own == of_pandas and own.count(b"\n") == n + 1


@pytest.mark.parametrize(
    "column",
    [
        ["rock", "scree", "ditch"],
        ["a,b", 'c"d', "e\nf"],
        ["rock", None, np.nan],
        ["", " ", "ü"],
        [True, False, True],
        [1, 2.5, "x"],
        np.array([0.1, 0.2, 0.3], np.float32),
        np.array([1, 2, 3], np.uint8),
        pd.array([1, None, 3], dtype="Int64"),
        pd.Categorical(["a", "b", "a"]),
    ],
    ids=["names", "quoted", "missing", "blank", "bool", "mixed", "float32", "uint8", "missing integer", "category"],
)
def test_columns_of_every_kind(tmp_path, column):
    table = pd.DataFrame({"x_m": [1.0, 2.0, 3.0], "column": column})
    for cut in (table, table.iloc[:0], table[["column"]], table.rename(columns={"column": "a,b"})):
        own, of_pandas = written(tmp_path, cut)
        assert own == of_pandas
