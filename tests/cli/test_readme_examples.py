"""What the README shows of compare, suggest and audit is what the commands print."""

import re
from pathlib import Path

import numpy as np

from femfit.model.json_file import write_model
from support.campaign import campaign
from support.command import femfit

ROOT = Path(__file__).parents[2]


def shown(command):
    """The lines below a command in the README."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    block = re.search(rf"\n\s*\$ {re.escape(command)}\n(.+?)\n\s*```", text, flags=re.DOTALL)
    assert block, f"the README does not show {command}"
    return [line.strip() for line in block[1].splitlines() if line.strip() != "..."]


def test_audit_prints_what_the_readme_shows():
    done = femfit("audit", "data/chowdhury2016.toml", cwd=ROOT)
    assert done.returncode == 0, done.stderr
    printed = done.stdout.splitlines()
    lines = shown("femfit audit data/chowdhury2016.toml")
    assert len(lines) > 3
    assert [line for line in lines if line not in printed] == []


def test_compare_prints_what_the_readme_shows(levitation_model, tmp_path):
    def soft_corner(readings, rows):  # the core gives way where field and current are large
        low = np.where((rows["current_A"] > 0.8) & (rows["distance_m"] < 0.02), 0.06, 0.0)
        return readings | {"force_N": readings["force_N"] * (1.0 - low)}

    write_model(levitation_model, tmp_path / "model.json")
    table = campaign(levitation_model, 6, change=soft_corner, runs=5)
    table.rows.drop(columns=["voltage_V"]).to_csv(tmp_path / "bench.csv", index=False)
    done = femfit("compare", "model.json", "bench.csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    printed = done.stdout.splitlines()
    lines = shown("femfit compare model.json bench.csv")
    assert [line for line in lines if line not in printed] == []
    assert lines[-1] == printed[-1]


def test_suggest_prints_what_the_readme_shows(tmp_path):
    for command in (
        ("sweep", ROOT / "geometry" / "emaws-rig.toml", "-o", "rig"),
        ("fit", "rig", "--model", "coenergy", "-o", "model.json"),
    ):
        done = femfit(*command, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    rows = (ROOT / "data" / "levitation_bench.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "force.csv").write_text("".join(",".join(row.split(",")[:9]) + "\n" for row in rows))
    done = femfit("suggest", "model.json", "force.csv", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    lines = shown("femfit suggest model.json force.csv")
    assert len(lines) > 2
    assert lines == done.stdout.splitlines()
