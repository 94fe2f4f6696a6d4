"""What an `Frf` promises: kinds converted as in the closed form, labels obeyed, nothing wrong let in."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from armonic.errors import FrfError
from armonic.response import KINDS, Frf, Kind

# One mass on a spring and a damper, at 20 Hz and 5 % of critical damping.
MASS, STIFFNESS, DAMPING = 2.0, 2.0 * (2 * np.pi * 20) ** 2, 2 * 0.05 * 2.0 * 2 * np.pi * 20
FREQ_HZ = np.linspace(1.0, 60.0, 119)
# Both sides are a handful of products and quotients of rounded numbers.
ROUNDING = 1e-13


def oscillator(kind: Kind, freq_hz: NDArray[np.float64] = FREQ_HZ) -> NDArray[np.complex128]:
    """Each kind from its own textbook form, none from another by a factor."""
    w = 2 * np.pi * freq_hz
    if kind == "receptance":
        return np.asarray(1 / (STIFFNESS - MASS * w**2 + 1j * w * DAMPING))
    if kind == "mobility":
        return np.asarray(1 / (DAMPING + 1j * (w * MASS - STIFFNESS / w)))
    return np.asarray(1 / (MASS - STIFFNESS / w**2 - 1j * DAMPING / w))


def one(kind: Kind = "receptance") -> Frf:
    return Frf(FREQ_HZ, oscillator(kind)[:, None, None], kind, ("x",), ("x",), "sensor")


def matrix() -> Frf:
    """Entry (i, j) of line k is 100 k + 10 i + j, so that every index shows."""
    k, i, j = np.meshgrid(np.arange(4), np.arange(3), np.arange(3), indexing="ij")
    values = (100 * k + 10 * i + j).astype(np.complex128)
    return Frf(np.arange(1.0, 5.0), values, "mobility", ("x", "y", "z"), ("x", "y", "z"))


@pytest.mark.parametrize("target", KINDS)
@pytest.mark.parametrize("source", KINDS)
def test_every_kind_converts_into_every_other_as_in_the_closed_form(source: Kind, target: Kind) -> None:
    converted = one(source).to(target)
    assert converted.kind == target
    assert (converted.outputs, converted.inputs, converted.frame) == (("x",), ("x",), "sensor")
    np.testing.assert_allclose(converted.values[:, 0, 0], oscillator(target), rtol=ROUNDING, atol=0)


def test_velocity_is_i_omega_times_displacement() -> None:
    displacement, velocity = one(), one().to("mobility")
    np.testing.assert_allclose(
        velocity.values[:, 0, 0], 2j * np.pi * FREQ_HZ * displacement.values[:, 0, 0], rtol=ROUNDING
    )


def test_magnitude_and_phase_at_resonance_are_those_of_the_damper_alone() -> None:
    natural = np.array([20.0])
    frf = Frf(natural, oscillator("receptance", natural)[:, None, None], "receptance", ("x",), ("x",))
    np.testing.assert_allclose(frf.magnitude, 1 / (2 * np.pi * 20 * DAMPING), rtol=1e-12)  # k - mω² cancels
    np.testing.assert_allclose(frf.phase_rad, -np.pi / 2, rtol=1e-12)


def test_multiplying_by_i_omega_is_fine_at_0_hz_and_dividing_is_an_error_that_says_what_to_do() -> None:
    frf = Frf([0.0, 1.0], np.ones((2, 1, 1)), "mobility", ("x",), ("x",))  # type: ignore[arg-type]
    assert frf.to("accelerance").values[0, 0, 0] == 0
    with pytest.raises(FrfError, match=r"0 Hz.*Drop that line"):
        frf.to("receptance")
    assert frf.band(frf.freq_hz[1], frf.freq_hz[-1]).to("receptance").freq_hz.tolist() == [1.0]


def test_a_conversion_that_overflows_is_an_error_not_infinity() -> None:
    frf = Frf(np.array([1e200]), np.full((1, 1, 1), 1e200), "receptance", ("x",), ("x",))
    with pytest.raises(FrfError, match="finite"):
        frf.to("accelerance")


def test_an_unknown_kind_is_an_error_that_lists_the_kinds() -> None:
    with pytest.raises(FrfError, match="receptance, mobility, accelerance"):
        one().to("compliance")  # type: ignore[arg-type]


def test_arrays_are_copied_and_read_only() -> None:
    freq_hz, values = FREQ_HZ.copy(), oscillator("receptance")[:, None, None].copy()
    frf = Frf(freq_hz, values, "receptance", ("x",), ("x",))
    freq_hz[0], values[0] = 1e6, 1e6
    assert frf.freq_hz[0] == FREQ_HZ[0]
    assert frf.values[0, 0, 0] == oscillator("receptance")[0]
    with pytest.raises(ValueError, match="read-only"):
        frf.freq_hz[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        frf.values[0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        frf.kind = "mobility"  # type: ignore[misc]


def test_symmetrizing_averages_or_mirrors_a_triangle() -> None:
    H = matrix()
    np.testing.assert_array_equal(
        H.symmetrized().values[0], [[0, 5.5, 11], [5.5, 11, 16.5], [11, 16.5, 22]]
    )  # means of ij and ji
    np.testing.assert_array_equal(H.symmetrized("upper").values[0], [[0, 1, 2], [1, 11, 12], [2, 12, 22]])
    np.testing.assert_array_equal(H.symmetrized("lower").values[0], [[0, 10, 20], [10, 11, 21], [20, 21, 22]])


def test_symmetrizing_needs_the_same_axes_on_both_sides() -> None:
    with pytest.raises(FrfError, match="select"):
        matrix().select(outputs=("x", "y")).symmetrized()
    with pytest.raises(FrfError, match="average, upper, lower"):
        matrix().symmetrized("both")  # type: ignore[arg-type]


def test_a_band_keeps_both_its_ends() -> None:
    band = matrix().band(2, 3)
    assert band.freq_hz.tolist() == [2, 3]
    assert band.values[:, 1, 2].tolist() == [112, 212]


@pytest.mark.parametrize(("low", "high"), [(2.1, 2.9), (3, 2), (10, 20), (float("nan"), 3)])
def test_a_band_without_lines_is_an_error(low: float, high: float) -> None:
    with pytest.raises(FrfError, match="1 to 4 Hz"):
        matrix().band(low, high)


def test_selecting_axes_takes_their_rows_and_columns_in_the_order_asked_for() -> None:
    part = matrix().select(outputs=("z", "x"), inputs="y")
    assert (part.outputs, part.inputs) == (("z", "x"), ("y",))
    assert part.values[1, :, 0].tolist() == [121, 101]
    assert matrix().select().values.shape == (4, 3, 3)


@pytest.mark.parametrize("axes", ["w", ("x", "w"), ("x", "x"), ()])
def test_selecting_an_axis_that_is_not_there_or_twice_is_an_error(axes: Any) -> None:
    with pytest.raises(FrfError, match="expected"):
        matrix().select(outputs=axes)


def test_the_text_form_is_one_readable_line() -> None:
    assert repr(one()) == "Frf(receptance, 119 lines 1 to 60 Hz, outputs x, inputs x, frame 'sensor')"


GOOD: dict[str, Any] = {
    "freq_hz": [1.0, 2.0],
    "values": np.ones((2, 1, 2)),
    "kind": "mobility",
    "outputs": ("x",),
    "inputs": ("x", "y"),
}
BAD: dict[str, tuple[dict[str, Any], str]] = {
    "unknown kind": ({"kind": "compliance"}, "compliance"),
    "frequencies in a matrix": ({"freq_hz": [[1.0, 2.0]]}, r"shape \(1, 2\)"),
    "no frequency": ({"freq_hz": [], "values": np.ones((0, 1, 2))}, "at least one line"),
    "a negative frequency": ({"freq_hz": [-1.0, 2.0]}, "-1 Hz"),
    "a frequency twice": ({"freq_hz": [1.0, 1.0]}, "1 Hz at index 1"),
    "falling frequencies": ({"freq_hz": [2.0, 1.0]}, "strictly increasing"),
    "a frequency that is not a number": ({"freq_hz": [1.0, np.nan]}, "nan at index 1"),
    "an infinite frequency": ({"freq_hz": [1.0, np.inf]}, "inf at index 1"),
    "complex frequencies": ({"freq_hz": [1.0, 2.0j]}, "real numbers"),
    "text for frequencies": ({"freq_hz": ["one", "two"]}, "real numbers"),
    "no array": ({"values": object()}, "complex numbers"),
    "ragged values": ({"values": [[[1, 2]], [[3]]]}, "complex numbers"),
    "too few lines": ({"values": np.ones((1, 1, 2))}, r"shape \(2, 1, 2\)"),
    "outputs and inputs exchanged": ({"values": np.ones((2, 2, 1))}, "lines, outputs, inputs"),
    "a value that is not a number": ({"values": [[[1, 2]], [[3, np.nan]]]}, "2 Hz in x/y"),
    "an infinite imaginary part": ({"values": [[[1, 2]], [[3, 1j * np.inf]]]}, "finite"),
    "one text for labels": ({"inputs": "xy"}, "tuple"),
    "a label twice": ({"inputs": ("x", "x")}, "different"),
    "an empty label": ({"inputs": ("x", "")}, "names"),
    "a number for a label": ({"inputs": ("x", 2)}, "names"),
    "no outputs": ({"outputs": (), "values": np.ones((2, 0, 2))}, "names"),
    "a number for the frame": ({"frame": 3}, "name of a frame"),
}


@pytest.mark.parametrize("case", BAD)
def test_nothing_wrong_becomes_an_frf(case: str) -> None:
    Frf(**GOOD)
    change, message = BAD[case]
    with pytest.raises(FrfError, match=message):
        Frf(**(GOOD | change))


def test_the_container_needs_nothing_but_numpy() -> None:
    heavy = "{'scipy', 'pyuff', 'plotly', 'pydantic', 'ruamel'}"
    code = f"import sys, armonic.response; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_only_a_matrix_of_one_frame_is_made_symmetric() -> None:
    values = np.ones((2, 1, 1), complex)
    across = Frf(np.array([1.0, 2.0]), values, "receptance", ("x",), ("x",), frame="tip", input_frame="elbow")
    with pytest.raises(FrfError, match=r"force at 'elbow' and a response at 'tip'"):
        across.symmetrized()
    assert replace(across, input_frame="tip").symmetrized().input_frame == "tip"


def test_a_band_holds_the_lines_at_its_ends_whatever_rounding_did_to_them() -> None:
    frf = Frf(np.array([4.8, 5.000000000000001, 5.2]), np.ones((3, 1, 1), complex), "receptance", ("x",), ("x",))
    assert frf.band(5, 5).freq_hz.size == 1


def test_arrays_that_nothing_can_change_any_more_are_not_copied() -> None:
    freq = np.array([1.0, 2.0])
    values = np.ones((2, 1, 1), complex)
    copied = Frf(freq, values, "accelerance", ("x",), ("x",))
    assert copied.values is not values
    values.setflags(write=False)
    assert Frf(freq, values, "accelerance", ("x",), ("x",)).values is values
    window = values[:]  # whose owner may be opened again
    assert Frf(freq, window, "accelerance", ("x",), ("x",)).values is not window
