"""Fast reading of decimal numbers, compared with Python's own."""

import numpy as np
import pytest

from gimpmd_strain.decimals import rows_of_decimals


def read(text: bytes, wanted: list[int]) -> np.ndarray | None:
    return rows_of_decimals(text, text.count(b"\n"), np.array(wanted))


def test_numbers_as_lammps_writes_them():
    rng = np.random.default_rng(1)
    values = rng.uniform(-10, 10, size=(2000, 4)).round(6) * 10.0 ** rng.integers(
        -8, 13, size=(2000, 4)
    )
    text = "".join(" ".join(f"{v:.9g}" for v in row) + " \n" for row in values)
    expected = np.array([[float(word) for word in row.split()] for row in text.splitlines()])
    np.testing.assert_array_equal(read(text.encode(), [0, 1, 2, 3]), expected)


def test_columns_in_the_order_asked_for():
    text = b"1 2.5 -3e-02\t4\n-5 Cu +7.25E+1 8\n"
    np.testing.assert_array_equal(read(text, [2, 0]), [[-0.03, 1.0], [72.5, -5.0]])
    np.testing.assert_array_equal(read(text, [0, 2, 0])[1], [-5.0, 72.5, -5.0])


@pytest.mark.parametrize("word", ["1e-300", "-4.9e-320", "123456789e-31", "1e300", "0e99", "-0"])
def test_numbers_beyond_exact_powers(word):
    ((value,),) = read(f"{word}\n".encode(), [0])
    assert value == pytest.approx(float(word), rel=1e-15, abs=5e-324)
    assert np.signbit(value) == word.startswith("-")


@pytest.mark.parametrize(
    "text",
    [b"1 nan\n", b"1\n", b"1 2x\n", b"1 1.2.3\n", b"1 -\n", b"1 1e\n", b"1 1e+1234\n", b"\n"],
)
def test_what_is_no_number(text):
    assert read(text, [0, 1]) is None


def test_too_many_digits():
    assert read(b"123456789012345678\n", [0]) is None
