"""Made-up rows of a report for the tests of its tables."""

from typing import Any

from avssl_pyro.benchmarks.result_tables import ResultRow


def result_row(method: str, f_measure: float, **cell: Any) -> ResultRow:
    """One row with an F-measure; ``cell`` says where it belongs, and whatever else matters to a test."""
    usual = {
        "condition": "some-silent",
        "microphones": 6,
        "sources": "all",
        "tolerance_deg": 10.0,
        "precision": 0.5,
        "recall": 0.5,
        "count_accuracy": 0.5,
        "localization_error_deg": 3.0,
        "clips": 20,
        "f_low": f_measure - 0.05,
        "f_high": f_measure + 0.05,
    }
    return ResultRow(method=method, f_measure=f_measure, **usual | cell)
