"""Numbers in sentences are short, and have no exponent where digits are read more easily."""

import pytest

from facets.core import short_number


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (5.53, 2, "5.5"),
        (18.4, 2, "18"),
        (99.6, 2, "100"),
        (964.0, 2, "960"),
        (21234.0, 3, "21,200"),
        (1910.0, 1, "2,000"),
        (999_600.0, 3, "1,000,000"),
        (2.5e7, 3, "2.5e+07"),
        (1.2e-5, 2, "1.2e-05"),
    ],
)
def test_a_number_has_no_exponent_from_one_to_a_million(value, digits, text):
    assert short_number(value, digits) == text
