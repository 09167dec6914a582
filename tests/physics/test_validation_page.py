"""The field solver has every known answer of the validation page, which says what is computed."""

import pytest

from support import pot_transfers
from support.reference import needs_reference
from support.validation_page import PAGE, cells_of, reference_of, rows

ROWS = {row.case: row for row in rows()}
SAME = 1e-5
"""Relative: six digits round by up to 5e-6, and the mesh of another build of Netgen moves the last of them."""


def lines():
    """Cells of each line of the page by case."""
    table = [[cell.strip() for cell in line.strip("|").split("|")] for line in PAGE.read_text("utf-8").splitlines()]
    return {cells[0]: cells for cells in table if cells[0] in ROWS}


def number(cell):
    return float(cell.removesuffix("%"))


def check(name):
    row, printed = ROWS[name], lines()[name]
    ours, reference = row.ours(), reference_of(row)
    if reference is None:  # a difference, printed in hundredths of a per cent
        again, slack = 0.01 * number(printed[4]), 2e-4
        assert ours < row.bound
    else:
        again, slack = number(printed[4]), SAME * abs(ours)
        assert ours == pytest.approx(reference, rel=row.bound)
    assert again == pytest.approx(ours, abs=slack)
    assert printed[:4] == cells_of(row, again)[:4]  # source, unit and reference
    if reference is not None:
        assert number(printed[5]) == pytest.approx(100.0 * (again / reference - 1.0), abs=1e-4)


def test_the_page_has_every_case_and_no_other():
    assert list(lines()) == list(ROWS)
    assert len([text for text in PAGE.read_text("utf-8").splitlines() if text.startswith("| ")]) == len(ROWS) + len(
        {row.section for row in ROWS.values()}
    )


@pytest.mark.parametrize("name", [name for name, row in ROWS.items() if row.cheap])
def test_the_page_says_what_is_computed(name):
    check(name)


@pytest.mark.nightly
@needs_reference
@pytest.mark.parametrize("name", [name for name, row in ROWS.items() if not row.cheap])
def test_the_page_says_what_takes_longer_to_compute(name):
    check(name)


@pytest.mark.nightly
def test_the_solid_pot_has_as_many_states_as_the_page_says():
    assert pot_transfers.states() == 8
