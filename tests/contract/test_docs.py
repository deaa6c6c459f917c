"""What the documents say is what the repository does."""

from __future__ import annotations

import ast
import json
import re
import runpy
import subprocess
import textwrap
from pathlib import Path

import pytest

from api.settings import Settings
from engine import metrics
from engine.model.verdicts import Verdict
from optimizers.search.result import Status

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
MAKEFILE = (ROOT / "Makefile").read_text()
SETTINGS = (ROOT / "docs" / "settings.md").read_text()
VARIABLE = r"^\| `(SERVOTUNE_[A-Z_]+)` \|"
OTHERS = re.findall(VARIABLE, SETTINGS.partition("## Of other programs")[2], flags=re.MULTILINE)
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])


def targets() -> set[str]:
    return set(re.findall(r"^([a-z-]+):", MAKEFILE, flags=re.MULTILINE))


def test_the_targets_of_the_readme_exist() -> None:
    named = set(re.findall(r"(?:`|^    )make ([a-z-]+)", README, flags=re.MULTILINE))
    assert {"demo", "test"} <= named <= targets()


def test_every_target_is_listed_by_help_and_is_phony() -> None:
    described = set(re.findall(r"^([a-z-]+):.*##", MAKEFILE, flags=re.MULTILINE))
    phony = set(re.search(r"^\.PHONY: (.*)$", MAKEFILE, flags=re.MULTILINE)[1].split())  # type: ignore[index]
    assert described == targets() == phony


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files(page: Path) -> None:
    for link in re.findall(r"\]\(([^)#]+)", page.read_text()):
        if not link.startswith(("http://", "https://")):
            assert (page.parent / link).exists(), link


def test_the_settings_table_is_complete() -> None:
    table = SETTINGS.partition("## Of other programs")[0]
    documented = re.findall(VARIABLE, table, flags=re.MULTILINE)
    assert sorted(documented) == sorted(f"SERVOTUNE_{name.upper()}" for name in Settings.model_fields)
    for name, field in Settings.model_fields.items():
        if isinstance(field.default, int | float | str):
            default = field.default
            row = next(line for line in table.splitlines() if f"`SERVOTUNE_{name.upper()}`" in line)
            assert re.search(
                rf"\| `?{re.escape(f'{default:g}' if isinstance(default, float) else str(default))}`? \|", row
            ), row


def test_every_variable_that_is_read_anywhere_is_in_the_one_table_of_settings() -> None:
    folders = (
        "agent",
        "api",
        "bench",
        "engine",
        "examples",
        "optimizers",
        "rig_simulator",
        "servotune",
        "storage",
        "tests",
    )
    code = [ROOT / "Makefile", ROOT / "web" / "vite.config.ts"]
    code += [path for folder in folders for path in (ROOT / folder).rglob("*.py")]
    read = {name for path in code for name in re.findall(r"\bSERVOTUNE_[A-Z]+(?:_[A-Z]+)*\b(?!_)", path.read_text())}
    documented = re.findall(VARIABLE, SETTINGS, flags=re.MULTILINE)
    assert len(documented) == len(set(documented))
    assert read - {f"SERVOTUNE_{name.upper()}" for name in Settings.model_fields} == set(OTHERS)


@pytest.mark.parametrize("page", [page for page in PAGES if page.name != "settings.md"], ids=lambda page: page.name)
def test_no_other_page_has_a_table_of_settings(page: Path) -> None:
    assert re.findall(VARIABLE, page.read_text(), flags=re.MULTILINE) == []


def test_the_glossary_speaks_the_language_of_the_code() -> None:
    glossary = (ROOT / "docs" / "glossary.md").read_text()
    code = "\n".join(
        path.read_text() for room in ("engine", "optimizers", "storage", "api") for path in (ROOT / room).rglob("*.py")
    )
    for row in re.findall(r"^\| (`[^|]+) \|", glossary, flags=re.MULTILINE):
        for name in re.findall(r"`([a-z_0-9]+)`", row):
            assert re.search(rf"\b{name}s?\b", code, flags=re.IGNORECASE), f"{name} is in the glossary, not in the code"


def test_the_glossary_or_the_catalogue_explains_every_word_of_a_reply() -> None:
    explained = "\n".join(page.read_text() for page in (ROOT / "docs").rglob("*.md"))
    for word in [*Verdict, *Status, *metrics.catalogue()]:
        assert f"`{word}`" in explained, word


def test_the_catalogue_pages_are_those_of_the_code() -> None:
    rendered = runpy.run_path(str(ROOT / "docs" / "catalogue" / "generate.py"))["pages"]()
    written = {page.name: page.read_text() for page in (ROOT / "docs" / "catalogue").glob("*.md")}
    assert written == rendered, "run `make catalogue`"


def test_decisions_are_numbered_without_gaps_and_listed() -> None:
    folder = ROOT / "docs" / "adr"
    records = sorted(path.name for path in folder.glob("[0-9]*.md"))
    assert [int(name[:4]) for name in records] == list(range(1, len(records) + 1))
    index = (folder / "README.md").read_text()
    for name in records:
        assert f"({name})" in index, name
        for heading in ("**Context.**", "**Decision.**", "**Consequences.**"):
            assert heading in (folder / name).read_text(), (name, heading)


def blocks(page: Path, *languages: str) -> list[str]:
    """Return the fenced blocks of a page in one of the languages."""
    words = "|".join(languages)
    found = re.findall(rf"^( *)```(?:{words})\n(.*?)^ *```", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    return [textwrap.dedent(text) for _, text in found]


def test_every_block_of_code_is_well_formed() -> None:
    counted = 0
    for page in PAGES:
        for text in blocks(page, "python"):
            ast.parse(text, filename=str(page))
        for text in blocks(page, "json"):
            json.loads(text)
        for text in blocks(page, "sh"):
            done = subprocess.run(["bash", "-n"], input=text, capture_output=True, text=True, check=False)
            assert done.returncode == 0, (page, done.stderr)
        counted += len(blocks(page, "python", "json", "sh"))
    assert counted >= 40


def test_the_page_of_the_command_line_is_what_the_commands_say() -> None:
    written = (ROOT / "docs" / "reference" / "cli.md").read_text()
    assert written == runpy.run_path(str(ROOT / "docs" / "reference" / "generate.py"))["page"](), "run `make catalogue`"


def test_the_files_that_make_the_agent_a_service_are_what_the_command_writes() -> None:
    files = runpy.run_path(str(ROOT / "docs" / "reference" / "generate.py"))["services"]()
    assert set(files) == {path.name for path in (ROOT / "docs" / "deploy").iterdir() if path.suffix != ".md"}
    for name, content in files.items():
        assert (ROOT / "docs" / "deploy" / name).read_text() == content, "run `make catalogue`"


@pytest.mark.parametrize(
    "notebook", sorted((ROOT / "examples" / "notebooks").glob("*.ipynb")), ids=lambda path: path.stem
)
def test_a_tutorial_says_what_its_notebook_says(notebook: Path) -> None:
    page = ROOT / "docs" / "tutorials" / f"{notebook.stem}.md"
    cells = [(cell["cell_type"], "".join(cell["source"])) for cell in json.loads(notebook.read_text())["cells"]]
    assert blocks(page, "python") == [f"{text.removesuffix(';')}\n" for kind, text in cells if kind == "code"], (
        "run `make tutorials`"
    )
    for kind, text in cells:
        assert kind == "code" or text in page.read_text(), "run `make tutorials`"


def test_the_readme_is_one_screen() -> None:
    assert len(README.splitlines()) <= 60
    assert len(re.findall(r"!\[", README)) == 1
    assert len(blocks(ROOT / "README.md", "python")) == 1
