"""A result survives its page, and names of columns keep their places."""

import json
from pathlib import Path

import pandas as pd
import pytest

from femfit.cli.command import Outcome, command
from femfit.core.errors import OutputError
from support.command import worked


def test_a_result_whose_page_cannot_be_written_is_told_and_kept_as_json(tmp_path, capsys):
    class Found:
        def to_dict(self):
            return {"distance_m": 0.02}

        def __str__(self):
            return "20 mm"

    def page(path):
        raise OutputError(f"{path} cannot be written")

    @command()
    def measure(report: Path) -> Outcome:
        return Outcome(Found(), files=[(report, page)])

    with pytest.raises(OutputError):
        measure(tmp_path / "page.html", json=tmp_path / "result.json")
    assert capsys.readouterr().out == "20 mm\n"
    assert json.loads((tmp_path / "result.json").read_text())["distance_m"] == 0.02


def test_an_empty_name_keeps_its_place_among_the_names_of_columns(tmp_path):
    rows = [f"0.00{11 + k},{0.3 + k / 100},{0.2 + k / 100},{0.1 + k / 100}" for k in range(5)]
    (tmp_path / "matrix.csv").write_text("\n".join(rows))
    names = ("--columns", ",0 A,0.5 A,1 A", "--matrix-rows", "distance", "--unit", "distance=m")
    worked("import", tmp_path / "matrix.csv", *names, "-o", tmp_path / "out", "--accept", "all")
    assert sorted(pd.read_parquet(tmp_path / "out" / "sweep.parquet")["current_A"].unique()) == [0.0, 0.5, 1.0]
