"""The site builds, its links lead somewhere, all that is public is there."""

import ast
import hashlib
import json
import re
import subprocess
import sys
import zlib
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import nadia_balance as nb
from tests import run_cache
from tests.source_files import ROOT, imports, module_name, python_files
from tests.test_docs import PAGES, blocks

SOURCES = [
    path
    for folder in ("docs", "examples", "nadia_balance", "diagrams", "models")
    for path in sorted((ROOT / folder).rglob("*.*"))
    if path.is_file() and not {"__pycache__", "api"} & {*path.parts}
]
NO_API = ("models", "scripts")


class Page(HTMLParser):
    """The anchors and the links of a page."""

    def __init__(self, text: str):
        super().__init__()
        self.anchors, self.links = {""}, set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        """Takes what a tag has of both."""
        given = dict(attrs)
        self.anchors.add(given.get("id") or "")
        for name in "href", "src":
            if given.get(name):
                self.links.add(given[name])


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> dict:
    """What is built; made once, see run_cache."""
    digests = [
        hashlib.sha256(path.read_bytes()).hexdigest()
        for path in (*SOURCES, *ROOT.glob("*.md"))
    ]

    def make() -> dict:
        out = tmp_path_factory.mktemp("site") / "html"
        flags = "-q", "-W", "--keep-going", "-c", "docs/site"
        done = subprocess.run(
            [sys.executable, "-m", "sphinx", *flags, ".", str(out)],
            cwd=ROOT,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        pages = {}
        for path in out.rglob("*.html"):
            page = Page(path.read_text("utf-8"))
            name = path.relative_to(out).as_posix()
            pages[name] = page.anchors, page.links
        files = {p.relative_to(out).as_posix() for p in out.rglob("*")}
        inventory = (out / "objects.inv").read_bytes().split(b"\n", 4)[4]
        index = (out / "searchindex.js").read_text("utf-8")
        return {
            "said": done.stderr,
            "pages": pages,
            "files": files,
            "objects": zlib.decompress(inventory).decode().splitlines(),
            "index": json.loads(
                re.fullmatch(r"Search.setIndex\((.*)\)", index)[1]
            ),
        }

    return run_cache.once(__name__, "".join(digests), make)


def test_it_builds_without_a_warning_and_has_every_page(site):
    """Oracle: Sphinx itself; the Markdown files and notebooks."""
    assert not site["said"]
    pages = (page for page in PAGES if page.parent.name != "publish")
    sources = {*pages, *ROOT.glob("docs/learn/*.ipynb")}
    names = {
        path.relative_to(ROOT).with_suffix(".html").as_posix()
        for path in sources
    }
    assert names <= site["pages"].keys()


def test_no_link_is_broken(site):
    """Oracle: the files, and the anchors in them, by another parser."""
    broken, count = [], 0
    for name, (_, links) in site["pages"].items():
        for link in links:
            url = urlsplit(link)
            if url.scheme or url.netloc:
                continue
            count += 1
            path = Path(ROOT / name).parent / unquote(url.path)
            target = path.resolve().relative_to(ROOT).as_posix()
            target = target if url.path else name
            anchors, _ = site["pages"].get(target, ({unquote(url.fragment)}, 0))
            is_there = target in site["files"]
            if not is_there or unquote(url.fragment) not in anchors:
                broken.append(f"{name}: {link}")
    assert count > 1000
    assert not broken


def test_nothing_is_loaded_from_elsewhere(site):
    """Oracle: the addresses of scripts, styles and pictures."""
    suffixes = (".js", ".css", ".png", ".gif", ".svg", ".woff2")
    assert not [
        f"{name}: {link}"
        for name, (_, links) in site["pages"].items()
        for link in links
        if "//" in link and link.endswith(suffixes)
    ]


def named_in_docs() -> set[str]:
    """The names of our modules, and in them, that the pages' Python imports."""
    named = set()
    for page in PAGES:
        for code in blocks(page.read_text("utf-8"), "python"):
            named |= {*imports(ast.parse(code))}
    return {name for name in named if name.startswith("nadia_balance.")}


def public_names() -> set[str]:
    """All public classes and functions of the rooms, by syntax tree."""
    kinds = ast.ClassDef, ast.FunctionDef
    return {
        f"{module_name(path)}.{node.name}"
        for path in python_files("nadia_balance", "diagrams")
        if not {*NO_API} & {*path.parts}
        for node in ast.parse((ROOT / path).read_text("utf-8")).body
        if isinstance(node, kinds) and not node.name.startswith("_")
        if path.name != "__init__.py"
    }


def test_every_public_docstring_has_a_page(site):
    """Oracles: the front door, the syntax trees, what the pages import."""
    objects = {line.split(" ")[0] for line in site["objects"]}
    doors = {
        f"nadia_balance.{module}.{name}" for name, module in nb._MODULES.items()
    }
    assert not doors - objects
    assert not public_names() - objects
    assert not named_in_docs() - objects


def test_it_can_be_searched(site):
    """Oracle: by hand: the page on which a word stands, as it is stemmed."""
    index = site["index"]
    pages = {index["docnames"][i] for i in index["terms"]["hysteresi"]}
    assert "docs/tuning" in pages
    assert "simulate" in {
        name for of in index["objects"].values() for *_, name in of
    }
