"""Frequency responses of a universal file that do not go together: each is named, and the others are read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armonic.errors import DataFileError
from armonic.files.measured_uff import read_measured_uff
from frf_files import DOUBLE_TEXT, units
from uff_files import EVEN_HZ, NAN, UNEVEN_HZ, coherence, frf, gamma, response, save

SI = units(1, 1, 1)


def test_a_response_without_force_is_left_and_the_others_read(tmp_path: Path) -> None:
    sets = [frf((1, 1), (1, 1)), frf((1, 2), (1, 1), types=(12, 12), units=("m/s^2", "m/s^2"))]
    found = read_measured_uff(save(tmp_path / "a.uff", *sets))
    assert found.frfs is not None
    assert found.frfs.outputs == ("1.x",)
    (left,) = found.skipped
    assert left.what == "data set 58, FRF at 1:+Y per 1:+X"
    assert "expected 13 (force): a response without force" in left.reason


def test_different_resolutions_in_one_set_are_named_and_the_larger_part_kept(tmp_path: Path) -> None:
    sets = [frf((1, 1), (1, 1), 2 * EVEN_HZ), frf((1, 2), (1, 1)), frf((1, 3), (1, 1))]
    found = read_measured_uff(save(tmp_path / "a.uff", *sets))
    assert found.frfs is not None
    assert found.frfs.outputs == ("1.y", "1.z")
    (left,) = found.skipped
    assert left.dataset == 1
    assert left.reason == (
        "different resolutions in one set: 64 lines from 1 to 64 Hz, first step 1 Hz; "
        "data set 2 has 64 lines from 0.5 to 32 Hz, first step 0.5 Hz"
    )


def test_the_first_of_a_pair_that_is_there_twice_is_kept(tmp_path: Path) -> None:
    second = frf((1, -1), (1, 1), data=2 * response(EVEN_HZ, 1, 1))
    found = read_measured_uff(save(tmp_path / "a.uff", frf((1, 1), (1, 1)), second))
    assert found.frfs is not None
    np.testing.assert_allclose(found.frfs.values[:, 0, 0], response(EVEN_HZ, 1, 1), rtol=2 * DOUBLE_TEXT)
    assert found.skipped[0].reason == "1.x to 1.x again, as in data set 1, which is kept"


def with_nan(lines: Any, direction: int = 2) -> dict[str, Any]:
    data = response(EVEN_HZ, direction, 1)
    data[lines] = NAN * (1 + 1j)
    return frf((1, direction), (1, 1), data=data)


def test_lines_that_are_no_numbers_are_left_out_of_all_responses(tmp_path: Path) -> None:
    sets = [SI, frf((1, 1), (1, 1)), with_nan([0, 7]), with_nan([7, 9], 3)]
    found = read_measured_uff(save(tmp_path / "a.uff", *sets))
    assert found.frfs is not None
    kept = np.delete(np.arange(64), [0, 7, 9])
    np.testing.assert_array_equal(found.frfs.freq_hz, EVEN_HZ[kept])
    np.testing.assert_allclose(found.frfs.values[:, 0, 0], response(EVEN_HZ, 1, 1)[kept], rtol=2 * DOUBLE_TEXT)
    (told,) = found.remarks
    assert told == "3 of 64 lines are left out, the first at 0.5 Hz: no finite numbers in 1.y to 1.x and 1 more."


def test_a_response_that_is_mostly_no_numbers_is_left(tmp_path: Path) -> None:
    found = read_measured_uff(save(tmp_path / "a.uff", SI, frf((1, 1), (1, 1)), with_nan(slice(0, 40))))
    assert found.frfs is not None
    assert (found.frfs.freq_hz.size, found.frfs.outputs) == (64, ("1.x",))
    assert "40 of 64 lines that are no finite numbers" in found.skipped[0].reason


def test_coherence_that_is_missing_for_a_response_is_used_for_none(tmp_path: Path) -> None:
    sets = [SI, frf((1, 1), (1, 1)), frf((1, 2), (1, 1)), gamma((1, 1), (1, 1))]
    found = read_measured_uff(save(tmp_path / "a.uff", *sets))
    assert found.frfs is not None
    assert found.frfs.coherence is None
    assert found.remarks == ("Coherence is missing for 1 of 2 responses, 1.y to 1.x among them: none is used.",)


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (gamma((1, 1), (1, 1), data=1.5 * coherence(EVEN_HZ, 1, 1)), "expected values from 0 to 1"),
        (gamma((1, 1), (1, 1), 2 * EVEN_HZ), "expected the 64 of its response"),
        (gamma((9, 1), (1, 1)), "expected a response that is read"),
    ],
)
def test_coherence_that_cannot_be_is_left_and_named(tmp_path: Path, bad: dict[str, Any], reason: str) -> None:
    found = read_measured_uff(save(tmp_path / "a.uff", SI, frf((1, 1), (1, 1)), bad))
    assert found.frfs is not None
    assert found.frfs.coherence is None
    (left,) = found.skipped
    assert (left.what[:24], reason in left.reason) == ("data set 58, coherence a", True)


def test_coherence_without_responses_is_nothing_that_can_be_read(tmp_path: Path) -> None:
    with pytest.raises(DataFileError, match="no frequency response it could belong to"):
        read_measured_uff(save(tmp_path / "a.uff", gamma((1, 1), (1, 1))))


def test_frequencies_that_fall_are_left_and_named(tmp_path: Path) -> None:
    sets = [frf((1, 1), (1, 1), UNEVEN_HZ[::-1], even=False), frf((1, 2), (1, 1))]
    found = read_measured_uff(save(tmp_path / "a.uff", *sets))
    assert found.frfs is not None
    assert "do not increase" in found.skipped[0].reason
