"""The pages of the API: one of the public names, one for each room."""

import importlib
import inspect
import pkgutil
from collections.abc import Iterator
from pathlib import Path

from sphinx.application import Sphinx

import nadia_balance as nb

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "api"
NO_API = ("nadia_balance.models", "nadia_balance.scripts")


def write(app: Sphinx) -> None:
    """Writes all pages into docs/api, if they have changed.

    Args:
        app: the build.
    """
    FOLDER.mkdir(exist_ok=True)
    rooms = rooms_of_package()
    texts = {name: "\n".join(room_page(name, rooms[name])) for name in rooms}
    texts["index"] = "\n".join(index_page([*rooms]))
    for name, text in texts.items():
        path = FOLDER / f"{name}.rst"
        if not path.exists() or path.read_text("utf-8") != text:
            path.write_text(text, encoding="utf-8")


def rooms_of_package() -> dict[str, list[str]]:
    """Finds the packages that have modules.

    Returns:
        The modules of each, by its name.
    """
    rooms: dict[str, list[str]] = {}
    for module in pkgutil.walk_packages(nb.__path__, "nadia_balance."):
        room, _, _ = module.name.rpartition(".")
        if not module.ispkg and room not in NO_API:
            rooms.setdefault(room, []).append(module.name)
    return dict(sorted(rooms.items()))


def room_page(room: str, modules: list[str]) -> Iterator[str]:
    """Makes the page of a room.

    Args:
        room: name of a package.
        modules: their names.

    Yields:
        Its lines.
    """
    title = room.removeprefix("nadia_balance.")
    yield from (title, "=" * len(title), "")
    if title != room:  # the front door has a page of its own
        yield from (f".. automodule:: {room}", "   :no-members:", "")
    for module in modules:
        heading = module.removeprefix(f"{room}.")
        yield from (heading, "-" * len(heading), "")
        yield from (f".. automodule:: {module}", "")


def index_page(rooms: list[str]) -> Iterator[str]:
    """Makes the page of the public names.

    Args:
        rooms: names of the packages.

    Yields:
        Its lines.
    """
    yield from ("API", "===", "")
    yield "For programmers: the names of ``import nadia_balance as nb``."
    yield "All other modules are in the rooms below."
    yield from ("", ".. list-table::", "   :widths: 35 65", "")
    for name in nb.__all__:
        path = f"nadia_balance.{nb._MODULES[name]}.{name}"
        yield f"   * - :py:obj:`nb.{name} <{path}>`"
        yield f"     - {sentence(name)}"
    yield from ("", ".. toctree::", "   :maxdepth: 1", "")
    yield from (f"   {room}" for room in rooms)


def sentence(name: str) -> str:
    """Takes the first sentence on a public name.

    Args:
        name: in `nb`.

    Returns:
        That of its docstring; for data, the comment above.
    """
    value = getattr(nb, name)
    if not callable(value):
        module = importlib.import_module(f"nadia_balance.{nb._MODULES[name]}")
        source = inspect.getsource(module)
        comment, _, _ = source.partition(f"\n{name} = ")
        return comment.rpartition("\n#: ")[2]
    text, _, _ = (inspect.getdoc(value) or "").partition("\n\n")
    return " ".join(text.split()).replace("|", r"\|")
