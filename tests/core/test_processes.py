"""The pool of worker processes."""

import pytest

from femfit.core.errors import DomainError
from femfit.core.processes import process_pool


@pytest.mark.parametrize("workers", [0, -1, 1.5, "all"])
def test_what_is_no_number_of_workers_is_refused_with_what_was_given(workers):
    with pytest.raises(DomainError, match=str(workers)):
        process_pool(workers)
