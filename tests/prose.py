"""The sentences of a page in Markdown.

python tests/prose.py [PAGE ...]   # those that are too long
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MOST_WORDS = 35  # in a sentence
# Blocks that begin anew without an empty line: lists, headings, rows.
_BLOCK = re.compile(r"\n\s*\n|\n(?=\s*(?:[-*|#]|\d+\.) )")
_ABBREVIATIONS = ("al.", "approx.", "e.g.", "i.e.", "Eq.", "Fig.", "Sec.")
_ABBREVIATIONS += ("Eqs.", "Figs.", "no.", "vs.", "..")


def sentences(text: str) -> Iterator[str]:
    """Yields the sentences of a page; a cell of a table is one at least."""
    text = re.sub(r"\A---\n.*?\n---\n", "", text, flags=re.DOTALL)
    text = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^    .*$", "", text, flags=re.MULTILINE)  # code, formulas
    text = re.sub(r"!\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    for block in _BLOCK.split(text):
        for cell in re.split(r"\s\|\s|^\||\|$", " ".join(block.split())):
            yield from _split(cell)


def _split(text: str) -> Iterator[str]:
    sentence: list[str] = []
    for word in text.split():
        sentence.append(word)
        ends = word.rstrip(")*\"'`").endswith((".", "!", "?"))
        if ends and not word.endswith(_ABBREVIATIONS):
            yield " ".join(sentence)
            sentence = []
    if sentence:
        yield " ".join(sentence)


def words(sentence: str) -> int:
    """The number of words: what has a letter or a digit."""
    return sum(bool(re.search(r"\w", word)) for word in sentence.split())


def too_long(text: str) -> list[str]:
    """The sentences with more than MOST_WORDS."""
    return [one for one in sentences(text) if words(one) > MOST_WORDS]


def main(*pages: str) -> None:
    """Prints the sentences of these pages that are too long."""
    for page in pages or ROOT.glob("**/*.md"):
        for sentence in too_long(Path(page).read_text(encoding="utf-8")):
            print(f"{page} ({words(sentence)}): {sentence}")


if __name__ == "__main__":
    main(*sys.argv[1:])
