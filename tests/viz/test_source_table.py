import io

import numpy as np
from rich.console import Console

from avssl_pyro.localization.posterior import LocalizedSource
from avssl_pyro.viz.source_table import source_table


def rows(table):
    console = Console(file=io.StringIO(), width=120)
    console.print(table)
    return [line.split() for line in console.file.getvalue().splitlines() if line.strip()][2:]


def source(azimuth_deg, level):
    return LocalizedSource(np.deg2rad(azimuth_deg), np.deg2rad(1.5), level, 0.01, level, 0)


def test_every_source_has_a_row_with_the_nearest_talker_even_across_the_seam():
    table = source_table({"guide": [source(179, 0.4), source(-31, 0.25)], "none": []}, np.deg2rad([-178, -30]))
    assert rows(table) == [
        ["guide", "+179.0", "1.5", "0.40", "0.010", "-3.0"],
        ["-31.0", "1.5", "0.25", "0.010", "-1.0"],
        ["none", *"–––––"],
    ]


def test_without_a_truth_there_is_no_column_for_it():
    table = source_table({"guide": [source(10, 0.4)]})
    assert len(table.columns) == 5
    assert rows(table) == [["guide", "+10.0", "1.5", "0.40", "0.010"]]
