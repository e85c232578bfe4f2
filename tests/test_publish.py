"""The texts of docs/publish have the form that their readers ask for."""

import re

import yaml

from tests.source_files import ROOT

FOLDER = ROOT / "docs" / "publish"
# What the Journal of Open Source Software requires, in its order.
SECTIONS = [
    "Summary",
    "Statement of need",
    "State of the field",
    "Software design",
    "Research impact statement",
    "AI usage disclosure",
    "Acknowledgements",
    "References",
]


def test_the_paper_has_the_form_of_its_journal():
    """Oracle: the journal's rules: sections, metadata, 750 words or more."""
    text = (FOLDER / "paper.md").read_text("utf-8")
    _, head, body = text.split("---\n", 2)
    assert re.findall(r"^# (.*)$", body, re.M) == SECTIONS
    assert 750 <= len(body.split()) <= 900
    metadata = yaml.safe_load(head)
    assert metadata["bibliography"] == "paper.bib"
    assert {"title", "tags", "authors", "affiliations", "date"} < {*metadata}
    bibliography = (FOLDER / "paper.bib").read_text("utf-8")
    entries = re.findall(r"^@\w+\{(\w+),", bibliography, re.M)
    assert len(entries) == len({*entries})
    assert {*re.findall(r"@(\w+)", body)} == {*entries}
    assert bibliography.count("{") == bibliography.count("}")


def test_the_entry_is_as_the_gallery_writes_them():
    """Oracle: doc/_pages/gallery.md of Drake: heading, picture, source."""
    entry = (FOLDER / "drake_gallery.md").read_text("utf-8")
    _, entry = entry.split("\n---\n")
    assert re.match(r"\n# \w", entry)
    (picture,) = re.findall(r'<img class="gallery".*/raw/main/(.*?)"', entry)
    assert (ROOT / picture).exists()
    assert entry.rstrip().splitlines()[-1].startswith("*Source Code:* [")


def test_the_version_is_one():
    """Oracle: pyproject.toml."""
    version = re.search(
        r'^version = "(.*)"', (ROOT / "pyproject.toml").read_text(), re.M
    )[1]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert citation["version"] == version
    changes = (ROOT / "CHANGELOG.md").read_text("utf-8")
    assert re.findall(r"^## \[(\d.*?)\]", changes, re.M)[0] == version
