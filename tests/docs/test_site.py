"""The documentation is built without a warning, works from disk, and says only what femfit does."""

import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from cyclopts import CycloptsError

import femfit
from actuator_file import TABLES
from femfit.cli.main import build_app
from femfit.device import schema
from femfit.device.keys import keys_of
from femfit.device.rewrite import read_variants
from femfit.effects.catalogue import BUILT_IN

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *(path for path in DOCS.rglob("*.md") if "generated" not in path.parts)]
EXAMPLES = [DOCS / "reference" / f"every-key{kind}.toml" for kind in ("", "-circuits")]
FROM_A_NETWORK = re.compile(
    r"""<(?:script|img|iframe)[^>]*\bsrc=["'](?:https?:)?//|<link[^>]*rel=["']stylesheet["'][^>]*href=["'](?:https?:)?//"""
)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    target = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", str(DOCS), str(target)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return target


@pytest.mark.nightly
def test_every_page_can_be_read_from_disk_and_every_effect_and_public_name_has_its_place(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > len(BUILT_IN) + 20
    assert [page.name for page in pages if FROM_A_NETWORK.search(page.read_text(encoding="utf-8"))] == []
    for effect in BUILT_IN:
        page = (site / "generated" / "effects" / f"{effect.name}.html").read_text(encoding="utf-8")
        assert f"{effect.name}.svg" in page
    page = (site / "generated" / "library.html").read_text(encoding="utf-8")
    assert [name for name in femfit.__all__ if name[0] != "_" and f'id="femfit.{name}"' not in page] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_of_a_page_leads_somewhere_in_a_clone_without_the_site(page):
    links = re.findall(r"\]\((?!https?:|#)([^)#\s]+)", page.read_text(encoding="utf-8"))
    assert [link for link in links if not (page.parent / link).exists()] == []


@pytest.mark.nightly
def test_every_tutorial_shows_what_its_notebook_answered(site):
    for notebook in (ROOT / "notebooks").glob("*.ipynb"):
        page = (site / "tutorial" / f"{notebook.stem}.html").read_text(encoding="utf-8")
        assert 'class="cell_output' in page
        assert "<img" in page


def test_the_example_file_uses_every_key():
    assert not [variant for path in EXAMPLES for variant in read_variants(path).variants if variant.problem]
    text = "\n".join(path.read_text() for path in EXAMPLES)
    keys = set(re.findall(r"[\w.$]+(?=\"? *=)", text))
    tables = set(re.findall(r"^\[(?:mechanics\.)?(\w+)", text, flags=re.MULTILINE))
    records = [schema.FileEntry, *(record for _, _, record in TABLES)]
    wanted = {name for record in records for name in keys_of(record)}
    assert wanted - keys - tables <= {"regions", "parameters"}


@pytest.mark.nightly
def test_a_key_of_the_actuator_file_has_an_example_from_its_own_table(site):
    page = (site / "generated" / "actuator_file.html").read_text(encoding="utf-8")
    sections = {part.split('"')[0]: part for part in page.split('<section id="')}
    example, later = (tomllib.loads(path.read_text()) for path in EXAMPLES)
    fixed, magnet = later["fixed"]["regions"]["magnet"], example["moving"]["regions"]["magnet"]
    for section, table, key in (
        ("fixed-regions-name", fixed, "r_mm"),
        ("coils-name", example["coils"]["coil"], "temperature_C"),
        ("moving-regions-name", magnet, "z_mm"),
        ("moving-regions-name", magnet, "temperature_C"),
        ("sensors-name-hall-element", example["sensors"]["hall"], "z_mm"),
    ):
        (row,) = [row for row in sections[section].split("<tr") if f">{key}<" in row]
        assert re.sub("<[^>]*>", "", row.split("<td>")[-1]).strip() == str(table[key]), (section, key)


def commands():
    """Every femfit command line that a page or a notebook shows."""
    blocks = re.compile(r"^ *```\w*\n(.*?)^ *```", flags=re.MULTILINE | re.DOTALL)
    for path in PAGES:
        for block in blocks.findall(path.read_text(encoding="utf-8")):
            for line in re.findall(r"^ *(?:\$ )?(?:.*/)?(femfit .+)$", block, flags=re.MULTILINE):
                for part in line.split("#")[0].split("&&"):
                    yield pytest.param(part.strip(), id=f"{path.name}: {part.strip()[:60]}")


@pytest.mark.parametrize("line", [one for one in commands() if one.values[0].startswith("femfit ")])
def test_commands_that_the_pages_show_exist(line):
    _, *words = shlex.split(line)
    try:
        build_app(()).parse_args(words, exit_on_error=False, print_error=False)
    except CycloptsError as error:
        pytest.fail(str(error))


def test_the_first_page_of_the_repository_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) < 150


def test_the_versions_of_the_documents_agree():
    assert tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"] == femfit.__version__


def test_scripts_that_the_pages_name_exist():
    script = re.compile(r"(?:tests|notebooks|docs|geometry|data)/[\w./-]+\.(?:py|ipynb|toml|csv|md)")
    named = {(path.name, name) for path in PAGES for name in script.findall(path.read_text())}
    assert [pair for pair in named if not (ROOT / pair[1]).is_file()] == []
