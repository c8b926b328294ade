from io import StringIO

import pytest
from result_rows import result_row
from rich.console import Console

from avssl_pyro.benchmarks.paper.paper_tables import behind, overall_table, paper_tables, sweep_tables
from avssl_pyro.benchmarks.paper.published_results import PAPER_TABLES, TABLE_I, TABLE_II, TABLE_III
from avssl_pyro.benchmarks.result_tables import method_order
from avssl_pyro.evaluation.tables import print_tables

CONDITIONS = ("all-speak", "some-silent")
HALF = {"all-speak": 0.02, "some-silent": 0.03}


def row(condition, microphones, sources, method, f_measure, count, tolerance_deg=10.0):
    half = HALF[condition]
    return result_row(
        method,
        f_measure,
        condition=condition,
        microphones=microphones,
        sources=sources,
        tolerance_deg=tolerance_deg,
        count_accuracy=count,
        f_low=f_measure - half,
        f_high=f_measure + half,
        count_low=count - 0.1,
        count_high=count + 0.1,
    )


def rows(microphones=(2, 4, 6), tolerances=(10.0,), **changes):
    """Every method is better than the one before it, and its numbers tell its cell apart."""
    made = []
    for condition in CONDITIONS:
        for m in microphones:
            for sources in (2, 3, "all"):
                for tolerance in tolerances:
                    for rank, method in enumerate(method_order()):
                        name = method.replace("-", "_").replace(" ", "_")
                        value = changes.get(name, 0.85 + 0.01 * rank + 0.001 * m + 0.002 * tolerance / 10)
                        count = 1.0 if method == "random" else changes.get(f"{name}_count", value)
                        made.append(row(condition, m, sources, method, value, count, tolerance))
    return made


def lines(table):
    return table.texts()


def test_the_papers_figures_are_in_their_places():
    assert [(table.number, table.measure, table.condition) for table in PAPER_TABLES] == [
        ("I", "F-measure", "all-speak"),
        ("II", "F-measure", "some-silent"),
        ("III", "count accuracy", "some-silent"),
    ]
    assert TABLE_I.figures["Proposed"][2, 3] == 0.66
    assert TABLE_I.figures["w/o Aud"][4, 2] == 0.85
    assert TABLE_II.figures["MUSIC"] == {(4, 2): 0.73, (4, 3): 0.64, (6, 2): 0.85, (6, 3): 0.77}
    assert TABLE_III.figures["SRP-PHAT"][2, 3] == 0.01
    assert TABLE_III.figures["Proposed"][6, 3] == 0.47


def test_our_rows_stand_above_the_papers_in_its_columns():
    first, second, third = paper_tables(rows(amortized=0.913, amortized_count=0.613))
    columns = ("M=2 L=2", "M=2 L=3", "M=4 L=2", "M=4 L=3", "M=6 L=2", "M=6 L=3")
    for table in (first, second, third):
        assert table.headers[1:] == columns
        theirs = ["SRP-PHAT (paper)", "MUSIC (paper)", "w/o Aud (paper)", "Proposed (paper)"]
        assert list(table.texts()) == [*method_order(), *theirs]
        assert any("measured by its authors on other data" in note for note in table.notes)
    assert lines(first)["amortized"] == ["0.91 ±.02"] * 6
    assert lines(second)["amortized"] == ["0.91 ±.03"] * 6
    assert lines(third)["amortized"] == ["0.61 ±.10"] * 6
    assert lines(first)["Proposed (paper)"] == ["0.74", "0.66", "0.86", "0.83", "0.85", "0.84"]
    assert lines(second)["Proposed (paper)"] == ["0.70", "0.70", "0.77", "0.73", "0.78", "0.74"]
    assert lines(third)["MUSIC (paper)"] == ["–", "–", "0.59", "0.27", "0.83", "0.59"]


def test_each_cell_takes_the_row_of_its_own_condition_array_and_count():
    made = [
        row(condition, m, sources, "refined", 0.1 * m + 0.01 * sources + 0.3 * (condition == "some-silent"), 0.5)
        for condition in CONDITIONS
        for m in (2, 4, 6)
        for sources in (2, 3)
    ]
    first, second, _ = paper_tables([*made, row("all-speak", 2, 2, "refined", 0.99, 0.5, tolerance_deg=5.0)])
    assert [text.split()[0] for text in lines(first)["refined"]] == ["0.22", "0.23", "0.42", "0.43", "0.62", "0.63"]
    assert [text.split()[0] for text in lines(second)["refined"]] == ["0.52", "0.53", "0.72", "0.73", "0.92", "0.93"]


def test_the_best_of_ours_is_marked_and_never_a_told_count_or_a_figure_of_the_paper():
    low = {name.replace("-", "_").replace(" ", "_"): 0.1 for name in method_order()}
    first, _, third = paper_tables(rows(**low | {"music": 0.2}))
    best = {cells[0].text for cells in first.cells() if any(cell.best for cell in cells)}
    assert best == {"music"}
    assert {cells[0].text for cells in third.cells() if any(cell.best for cell in cells)} == {"music"}


def test_arrays_that_were_not_run_are_dashes_and_others_get_columns():
    first, *_ = paper_tables(rows(microphones=(4, 5)))
    assert first.headers[5:7] == ("M=5 L=2", "M=5 L=3")
    assert lines(first)["refined"][:2] == ["–", "–"]
    assert lines(first)["Proposed (paper)"][2:6] == ["0.86", "0.83", "–", "–"]


def test_overall_and_sweep_have_every_array_and_tolerance():
    made = rows(tolerances=(5.0, 10.0, 15.0, 20.0))
    overall = overall_table(made)
    assert overall.headers[1:3] == ("all-speak M=2", "all-speak M=4")
    assert len(overall.headers) == 7
    assert all(len(texts) == 6 for texts in overall.texts().values())
    sweeps = sweep_tables(made)
    assert [table.title for table in sweeps] == [f"F-measure by tolerance, {condition}" for condition in CONDITIONS]
    assert sweeps[0].headers[1:6] == ("M=2 5°", "M=2 10°", "M=2 15°", "M=2 20°", "M=4 5°")
    assert len(lines(sweeps[0])["refined"]) == 12


def test_a_terminal_of_80_columns_shows_them_uncut():
    made = rows(tolerances=(5.0, 10.0, 15.0, 20.0))
    out = StringIO()
    print_tables([*paper_tables(made), *sweep_tables(made)], Console(file=out, width=80))
    assert "…" not in out.getvalue()
    assert max(map(len, out.getvalue().splitlines())) <= 80
    refined = [line.split() for line in out.getvalue().splitlines() if line.strip().startswith("refined")]
    assert [len(line) for line in refined] == [13, 13, 13, 13, 13]


def test_ahead_everywhere_is_an_empty_list():
    assert behind(rows()) == []


def test_cells_below_the_paper_are_named():
    sentences = behind(rows(amortized=0.73, amortized_count=0.9))
    expected = {"Table I, M=2, L=2", *(f"Table I, M={m}, L={talkers}" for m in (4, 6) for talkers in (2, 3))}
    expected |= {"Table II, M=4, L=2", "Table II, M=6, L=2", "Table II, M=6, L=3"}
    assert {sentence.split(":")[0] for sentence in sentences} == expected
    assert "amortized 0.73 is below 0.74, the paper's Proposed (other data)." in sentences[0]


def test_our_figure_is_rounded_as_the_papers_before_they_are_compared():
    def first_cell(value):
        return [s for s in behind([row("all-speak", 2, 2, "amortized", value, 0.5)]) if "M=2, L=2" in s]

    assert first_cell(0.7361) == []
    assert len(first_cell(0.7349)) == 1


@pytest.mark.parametrize("music", [0.95, 0.951])
def test_a_baseline_that_refined_does_not_beat_is_named_in_every_cell(music):
    sentences = behind(rows(refined=0.95, refined_count=0.99, music=music))
    assert len(sentences) == 12
    assert all(f"refined 0.950 is not ahead of music {music:.3f} (same clips)." in sentence for sentence in sentences)


def test_a_constant_count_is_no_baseline():
    assert behind(rows(constant_count=0.99, constant_count_count=1.0)) == []
