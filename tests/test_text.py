"""How numbers and results read in words; what stands on the right was written by hand."""

from __future__ import annotations

import math

import pytest

from armonic import text

INF, NAN = math.inf, math.nan


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (0, "0"),
        (1, "1.000"),
        (9999.4, "9999"),
        (9999.6, "10.00e3"),
        (2.8e6, "2.800e6"),
        (11.9e6, "11.90e6"),
        (0.00123456, "0.001235"),
        (0.000999999, "0.001000"),
        (0.00099, "990.0e-6"),
        (-35.5, "-35.50"),
        (1e-7, "100.0e-9"),
        (1e300, "1.000e300"),
        (INF, "∞"),
        (-INF, "-∞"),
        (NAN, "n/a"),
    ],
)
def test_a_value_has_four_significant_digits(value: float, words: str) -> None:
    assert text.format_si(value) == words


def test_a_unit_follows_the_value() -> None:
    assert text.format_si(2.8e6, "N m/rad") == "2.800e6 N m/rad"


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [
        (5e6, 6e6, "5.000e6 … 6.000e6"),
        (0.0, INF, "open"),
        (0.0, 3.0, "open … 3.000"),
        (1.0, INF, "1.000 … open"),
        (NAN, NAN, "open"),
    ],
)
def test_an_interval_is_open_where_the_data_give_no_end(low: float, high: float, words: str) -> None:
    assert text.format_interval(low, high) == words


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [(0.99, 1.01 / 0.9999, "± 1.0 %"), (0.1, 10.0, "×/÷ 10"), (0.0, INF, "open"), (1.0, INF, "open")],
)
def test_a_spread_is_a_percentage_or_a_factor(low: float, high: float, words: str) -> None:
    assert text.format_spread(low, high) == words


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.0, "under 1 ms"),
        (0.0381, "38.1 ms"),
        (0.9996, "1 s"),
        (1.24, "1.24 s"),
        (59.96, "1 min 00 s"),
        (200.0, "3 min 20 s"),
        (7500.0, "2 h 05 min"),
    ],
)
def test_a_duration_reads_as_one_says_it(seconds: float, words: str) -> None:
    assert text.format_duration(seconds) == words


def test_percent_hz_and_counts() -> None:
    assert text.format_percent(0.01081) == "1.08 %"
    assert text.format_hz(9.9649) == "9.96"
    assert text.format_hz(0.0512345) == "0.05123"
    assert text.count(1, "line") == "1 line"
    assert text.count(0, "line") == "0 lines"
    assert text.listing(["a", "b", "c"]) == "a, b and c"


def test_paths_have_short_names() -> None:
    assert text.split_path("links.arm.elasticity.z.stiffness") == ("arm.z", "stiffness")
    assert text.split_path("links.a.b.elasticity.tx.damping") == ("a.b.tx", "damping")
    assert text.split_path("bushings.mount.damping.rx") == ("mount.rx", "damping")
    assert text.split_path("something.else") == ("something.else", "")


def test_units_of_responses_follow_kind_and_axes() -> None:
    assert text.frf_unit("accelerance", "x", "y") == "(m/s²)/N"
    assert text.frf_unit("receptance", "z", "z") == "m/N"
    assert text.frf_unit("mobility", "rx", "y") == "(rad/s)/N"
    assert text.frf_unit("receptance", "x", "rz") == "m/(N·m)"
