import json
from io import StringIO

import pytest
from result_rows import result_row
from rich.console import Console

from avssl_pyro.benchmarks import result_tables
from avssl_pyro.benchmarks.result_tables import order_methods, print_report, write_report
from avssl_pyro.evaluation.baselines import BASELINES, Music

KEYS = {
    *("condition", "microphones", "sources", "method", "tolerance_deg", "f_measure", "precision", "recall"),
    *("count_accuracy", "localization_error_deg", "clips", "f_low", "f_high"),
    *("count_low", "count_high"),
}


def rows():
    methods = {"refined": 0.95, "my-own": 0.7, "amortized": 0.8, "music": 0.75, "random": 0.13}
    return [
        result_row(
            method,
            value,
            sources=sources,
            tolerance_deg=tolerance_deg,
            count_accuracy=1.0 if method == "random" else 0.5,
            clips=40 if sources == "all" else 20,
        )
        for tolerance_deg in (5.0, 10.0)
        for method, value in methods.items()
        for sources in (2, 3, "all")
    ]


def markdown_lines(folder, start):
    text = (folder / "report.md").read_text(encoding="utf-8")
    return [line for line in text.splitlines() if line.startswith(f"| {start}")]


def test_json_is_a_list_of_rows_with_null_for_what_is_undefined(tmp_path):
    write_report(
        [result_row("music", 0.0, localization_error_deg=float("nan")), result_row("music", 0.5, sources=2)],
        tmp_path / "new" / "run",
    )
    data = json.loads((tmp_path / "new" / "run" / "report.json").read_text(encoding="utf-8"))
    assert [set(item) for item in data] == [KEYS, KEYS]
    assert data[0]["localization_error_deg"] is None
    assert (data[1]["sources"], data[1]["f_measure"], data[0]["sources"]) == (2, 0.5, "all")


def test_methods_go_from_trivial_to_refined_and_strangers_last(tmp_path):
    write_report(rows(), tmp_path)
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    places = [text.index(f"| {name} |") for name in ("random", "music", "amortized", "refined", "my-own")]
    assert places == sorted(places)


def test_a_registered_baseline_stands_behind_the_others(monkeypatch):
    class Mine(Music):
        name = "my-own"

    names = ["refined", "my-own", "strange", "norm-music", "random"]
    assert order_methods(names) == ["random", "norm-music", "refined", "my-own", "strange"]
    monkeypatch.setattr(result_tables, "BASELINES", [*BASELINES, Mine])
    assert order_methods(names) == ["random", "norm-music", "my-own", "refined", "strange"]


def test_the_headline_tolerance_is_shown_and_the_best_is_bold(tmp_path):
    write_report(rows(), tmp_path)
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "some-silent, 6 microphones, tolerance 10°" in text
    assert "F by tolerance" in text
    assert "40 clips (20 with L=2, 20 with L=3)" in text
    assert "**0.95 ±.05**" in markdown_lines(tmp_path, "refined")[0]
    assert "**0.80" not in text
    # Its count of 1.00 was given to it, so the best count is another's.
    assert "**1.00**" not in text
    assert "**0.50**" in markdown_lines(tmp_path, "music")[0]


def test_a_failed_write_keeps_the_old_report_and_leaves_no_other_file(tmp_path, request):
    write_report(rows(), tmp_path)
    before = (tmp_path / "report.json").read_bytes()

    request.getfixturevalue("full_disk")
    with pytest.raises(OSError, match="No space"):
        write_report(rows()[:1], tmp_path)
    assert (tmp_path / "report.json").read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["report.json", "report.md"]


def test_the_terminal_table_fits_80_columns_uncut():
    out = StringIO()
    print_report(rows(), Console(file=out, width=80))
    text = out.getvalue()
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= 80
    refined = next(line for line in text.splitlines() if line.strip().startswith("refined"))
    assert refined.split() == ["refined", "0.95", "±.05", "0.95", "0.95", *["0.50"] * 5, "3.0"]


def test_every_condition_and_array_has_its_own_table(tmp_path):
    write_report([result_row("music", 0.5, microphones=2), result_row("music", 0.7, microphones=6)], tmp_path)
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert text.index("2 microphones") < text.index("0.50 ±") < text.index("6 microphones") < text.index("0.70 ±")
