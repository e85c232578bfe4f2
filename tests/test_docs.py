"""What README.md and docs/ say of the code is true; their examples run."""

import contextlib
import importlib
import inspect
import io
import json
import math
import re
import shlex
import textwrap
import tomllib
from collections.abc import Callable, Iterator

import numpy as np
import pytest
import yaml
from matplotlib import pyplot
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem

import nadia_balance as nb
import reference
from nadia_balance.diagrams.terrain import Terrain
from nadia_balance.results.log import signal_view
from nadia_balance.robot.params import RobotParams
from nadia_balance.scripts import push, simulate
from nadia_balance.scripts.command_line import CommandLine
from nadia_balance.scripts.envelope import parser_of, sweep_from, sweeps_of_row
from nadia_balance.sweep import push_v1
from nadia_balance.sweep.search import SearchParams
from nadia_balance.systems.signals import PHASES
from tests import prose, run_cache
from tests.policy import deploys
from tests.results import made_up_run
from tests.source_files import ROOT
from tests.test_fuzz import leaves

README, DIAGRAM, OWN, FIELDS = (
    (ROOT / f"{page}.md").read_text(encoding="utf-8")
    for page in "README docs/diagram docs/own_blocks docs/robot_yaml".split()
)
PAGES = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]
PAGES += ROOT.glob("models/*.md")
# The cells of each notebook, by its name.
BOOKS = {
    path.stem: json.loads(path.read_text("utf-8"))["cells"]
    for path in sorted(ROOT.glob("docs/learn/*.ipynb"))
}
# What a command line goes on to check.
MAKERS = {
    "envelope": lambda args: (
        sweeps_of_row(parser_of(), args)
        if args.protocol == push_v1.NAME
        else sweep_from(args)
    ),
    "push": push._pushed_scenario,
    "simulate": simulate._scenario,
}


def blocks(text: str, language: str) -> list[str]:
    """The code in this language in a Markdown `text`."""
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def once(page: str, block: str, make: Callable, more: str = ""):
    """What comes of a block of a page; made once, see run_cache."""
    return run_cache.once(__name__, page + block + more, make)


def said_by(code: str) -> str:
    """What the code prints."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), pyplot.rc_context():
        exec(code, {})
    pyplot.close("all")
    return said.getvalue()


def test_two_lines_push_the_robot():
    """Oracle: it recovers; the ICP has two coordinates."""
    (block,) = blocks(README, "python")
    told = once("README", block, lambda: said_by(block))
    assert re.fullmatch(r"recovered 0\.\d+\n\(\d+, 2\)\n", told)


def test_a_plant_of_ones_own_is_that_of_the_robot():
    """Oracle: `add_plant_to`: the same bodies, in the same posture."""
    block, *_ = blocks(DIAGRAM, "python")
    robot, own = nb.load_robot("nadia"), MultibodyPlant(0.001)
    exec(block, {"nb": nb, "robot": robot, "plant": own})
    made, _ = robot.add_plant_to(DiagramBuilder())
    assert own.num_bodies() == made.num_bodies()
    assert (own.GetDefaultPositions() == made.GetDefaultPositions()).all()
    for name in "contact_model", "discrete_contact_approximation":
        get = f"get_{name}"
        assert getattr(own, get)() == getattr(made, get)(), name
    assert own.has_sampled_output_ports() == made.has_sampled_output_ports()


def test_some_lines_more_are_uneven_ground():
    """Oracle: by hand: two of its steps of 0.3 m, and a sole beyond the edge
    at 0.5 m, it stands on the block of 10 cm.
    """
    *_, block, _ = blocks(DIAGRAM, "python")
    assert "num_steps=4" in block
    block = block.replace("num_steps=4", "num_steps=2")

    def climbed() -> np.ndarray:
        robot, builder = nb.load_robot("nadia"), DiagramBuilder()
        params = nb.load_scenario("stand").controller
        names = {"nb": nb, "robot": robot, "builder": builder, "params": params}
        exec(block, names)
        plant, controller = names["plant"], names["controller"]
        builder.AddSystem(controller)
        period = params.control_period
        sensor = builder.AddSystem(nb.FootForceSensor(plant, robot, period))
        nb.connect(builder, plant, controller, state="estimated_state")
        nb.connect(builder, plant, sensor, "contact_results")
        nb.connect(builder, sensor, controller, "foot_forces")
        nb.connect(builder, controller, plant, "actuation")
        simulator = Simulator(builder.Build())
        simulator.AdvanceTo(6.0)
        context = plant.GetMyContextFromRoot(simulator.get_context())
        began = plant.GetPositions(plant.CreateDefaultContext())
        return (plant.GetPositions(context) - began)[4:7]

    source = inspect.getsource(climbed)
    x, y, z = once("docs.diagram", block, climbed, source)
    assert x == pytest.approx(0.5 + 0.02 + 0.125, abs=0.05)
    assert y == pytest.approx(0.0, abs=0.05)
    assert z == pytest.approx(0.1, abs=0.01)


def test_some_lines_command_a_walk():
    """Oracle: by hand: an arc with a radius of 0.3 / 0.2 m, for 3.5 s.

    It stands at the end, and hears the command at most a step late.
    """
    *_, block = blocks(DIAGRAM, "python")
    assert "(0.5, 0.3, 0.0, 0.2), (4.0, 0.0, 0.0, 0.0)" in block
    assert "duration=8.0" in block
    block = block.replace("8.0", "6.2")

    def walked() -> list[float]:
        names = {"nb": nb}
        exec(block, names)
        log = names["run"].logs
        walking = signal_view(log, "walking_signal", -1)
        x, y = signal_view(log, "com_state", -1).position[:2]
        yaw = 0.5 * (walking.left_yaw + walking.right_yaw)
        return [float(part) for part in (x, y, yaw, walking.phase)]

    x, y, yaw, phase = once("docs.diagram.command", block, walked)
    assert phase == PHASES.index(nb.Phase.STANDING)
    assert yaw == pytest.approx(0.2 * 3.5, abs=0.2 * 0.8)
    radius = 0.3 / 0.2
    assert math.hypot(x, y) == pytest.approx(
        2.0 * radius * math.sin(0.5 * yaw), abs=0.03
    )
    assert math.atan2(y, x) == pytest.approx(0.5 * yaw, abs=0.1)


def test_some_40_lines_are_a_block_of_ones_own():
    """Oracle: the robot keeps its feet, and falls if the block is idle."""
    acts, idle = "self.B.T @", "0.0 * self.B.T @"
    block = blocks(OWN, "python")[1]
    made, *_ = re.split(r"^(?:mine|scenario) = ", block, flags=re.MULTILINE)
    assert len(made.split("\n")) - made.count("\n\n") <= 40
    assert acts in block

    def executed() -> tuple[str, str]:
        reasons = []
        for code in block, block.replace(acts, idle):
            names = {}
            exec(code, names)
            reasons.append(names["run"].fall_reason)
        return tuple(reasons)

    keeps, falls = once("docs.own_blocks", block, executed)
    assert falls and not keeps


def test_some_30_lines_are_a_footstep_planner_of_ones_own():
    """Oracles: the text; by hand: steps of 0.2 m, turned by 0.1 rad each."""
    block = blocks(OWN, "python")[0]

    def walked() -> tuple[int, float, float]:
        names = {}
        exec(block, names)
        run = names["run"]
        walking = signal_view(run.logs, "walking_signal", -1)
        feet = walking.left, walking.right
        behind, first = sorted(feet, key=lambda foot: foot[2])
        move, yaw = first - behind, behind[2]
        ahead = move[0] * math.cos(yaw) + move[1] * math.sin(yaw)
        return run.summary["steps_taken"], float(ahead), float(move[2])

    taken, ahead, turned = once("docs.own_blocks", block, walked)
    assert f'`run.summary["steps_taken"]` is {taken}.' in OWN
    assert ahead == pytest.approx(0.2, abs=0.05)
    assert turned == pytest.approx(0.1, abs=0.02)


def documented(kind: type[LeafSystem]) -> tuple[set[str], set[str]]:
    """The names of input and output ports in a system's docstring."""
    block = inspect.getdoc(kind).split(".. pydrake_system::")[1]
    ports = yaml.safe_load(textwrap.dedent(block))
    return set(ports["input_ports"]), set(ports["output_ports"])


def test_the_table_has_every_system_and_its_ports():
    """Oracle: the docstrings, which test_ports compares with the systems."""
    public = (getattr(nb, name) for name in nb.__all__)
    systems = {
        kind.__name__: documented(kind)
        for kind in public
        if inspect.isclass(kind) and issubclass(kind, LeafSystem)
    }
    rows = re.findall(r"^\| `(\w+)` \|(.*)\|(.*)\|$", DIAGRAM, re.MULTILINE)
    table = {
        name: tuple(set(re.findall(r"`(\w+)`", cell)) for cell in cells)
        for name, *cells in rows
        if name in systems
    }
    assert table == systems


def commands() -> Iterator[tuple[str, list[str]]]:
    """The scripts and their arguments, in consoles and lines of all pages."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8").replace("\\\n", "")
        lines = re.findall(r"`python ((?:scripts|docs)/[^`]+)`", text)
        for block in blocks(text, "console"):
            lines += re.findall(r"^\$ python (.*)", block, re.MULTILINE)
        for line in lines:
            script, *argv = shlex.split(line, comments=True)
            # A robot of the reader's, of which there is none.
            theirs = re.compile(r"\w+/robot\.yaml")
            yield script, [theirs.sub("atlas", arg) for arg in argv]


def test_every_command_is_understood(monkeypatch):
    """Oracle: the scripts' own parsers, and what checks their values."""
    parse, parsed = CommandLine.parse_args, []

    def parse_only(parser, args=None, namespace=None):
        parsed.append(parse(parser, args, namespace))
        parser.exit()

    monkeypatch.setattr(CommandLine, "parse_args", parse_only)
    scripts = set()
    for script, argv in commands():
        folder, name = re.fullmatch(r"([\w/]+)/(\w+)\.py", script).groups()
        where = {"scripts": f"nadia_balance.scripts.{name}"}.get(folder, name)
        main = importlib.import_module(where).main
        with pytest.raises(SystemExit) as ended:
            main(argv)
        assert not ended.value.code, argv
        args = parsed.pop()
        if name in MAKERS:
            MAKERS[name](args)
        scripts.add(name)
    files = *ROOT.glob("scripts/[!_]*.py"), *ROOT.glob("docs/figures/*.py")
    shown = {path.stem for path in files}
    assert scripts == shown - {
        "command_line",
        "drawing",
        "interrupts",
        "json_schema",
        "progress",
    }


def test_other_lines_of_a_console_are_those_of_this_checkout():
    """Oracles: the targets of the Makefile, the extras of pyproject.toml."""
    makefile = (ROOT / "Makefile").read_text("utf-8")
    targets = {*re.findall(r"^([a-z]+):", makefile, re.MULTILINE)}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    extras = {*project["project"]["optional-dependencies"]}
    made, installed = set(), set()
    for page in PAGES:
        for block in blocks(page.read_text("utf-8"), "console"):
            made |= {*re.findall(r"^\$ make (\w+)", block, re.MULTILINE)}
            installed |= {*re.findall(r"nadia_balance\[(\w+)\]", block)}
    assert {"push", "test", "site", "results", "policy"} <= made <= targets
    assert {"docs", "robots"} <= installed <= extras


def test_yaml_of_a_page_is_taken(tmp_path):
    """Oracles: by hand; the commands, and a ramp of 0.1 over 1.

    `height` is that of the plane at the mean of the corners.
    """
    pages = [
        ROOT / "docs" / f"{name}.md" for name in ("command_line", "terrain")
    ]
    commands, regions = (
        block
        for page in pages
        for block in blocks(page.read_text("utf-8"), "yaml")
    )
    scenario = nb.load_scenario("stand", text=commands)
    told = [(c.time, c.forward, c.turn) for c in scenario.commands]
    assert told == [(0.5, 0.3, 0.0), (7.0, 0.0, 0.4), (13.0, 0.0, 0.0)]
    (tmp_path / "ramp.yaml").write_text(regions)
    robot = nb.load_robot("nadia")
    ground = Terrain(name=str(tmp_path / "ramp.yaml")).ground(
        robot.sole, robot.params.size
    )
    floor, ramp = ground.regions
    assert floor.heights(np.array([[-0.2, 0.0]])) == pytest.approx([0.0])
    slope = ramp.heights(np.array([[1.25, 0.0], [2.0, 0.0]]))
    assert slope == pytest.approx([0.1, 0.175])


def test_a_policy_walks_by_three_lines(tmp_path):
    """Oracle: the class of the controller, and the source of its gains."""
    page = (ROOT / "docs" / "policy.md").read_text("utf-8")
    (block,) = blocks(page, "python")
    path, _, _ = deploys.write(tmp_path)
    names = {}
    exec(block, names)
    controller = names["walking"](str(path)).controller
    assert isinstance(controller, nb.PolicyController)
    assert controller.contract.source("stiffness") == "deploy.yaml"


def test_links_lead_somewhere():
    """Oracle: the files of the checkout, and the headings in them."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for link, anchor in re.findall(
            r"\]\((?!https?:)([^)#]*)#?([^)]*)\)", text
        ):
            file = page.parent / link if link else page
            assert file.exists(), f"{page.name}: {link}"
            if anchor:
                text = file.read_text("utf-8").lower()
                headings = re.findall(r"^#+ (.*)", text, re.M)
                slugs = (re.sub(r"[^\w -]", "", one) for one in headings)
                slugs = {slug.replace(" ", "-") for slug in slugs}
                assert anchor in slugs, f"{page.name}: {link}#{anchor}"


def test_the_table_has_every_field_of_robot_yaml_and_its_default():
    """Oracle: the dataclasses; what is required has nothing to start with."""
    row = r"^\| `([\w.]+)` \|[^|]*\| ([^|]*?) \|[^|]*\|$"
    table = dict(re.findall(row, FIELDS, re.MULTILINE))
    named = leaves(RobotParams())
    defaults = {name.replace(": {", "."): value for name, value in named}
    assert set(table) == set(defaults)
    for name, value in defaults.items():
        if table[name] == "required":
            assert not value, name
        else:
            text = f"{value:g}" if isinstance(value, float) else str(value)
            assert table[name] == text, name


def test_the_reference_is_that_of_this_code():
    """Oracles: what docs/figures/reference.py writes; a run's own names."""
    page = (ROOT / "docs" / "reference.md").read_text("utf-8")
    assert page == reference.page(), "python docs/figures/reference.py"
    for name, text in reference.schemas().items():
        assert (ROOT / "docs" / name).read_text("utf-8") == text
    run = nb.simulate("push", 0.012)
    assert {*reference.SUMMARY} == {*run.summary}
    log = made_up_run.make_log()
    (push,) = made_up_run.summary_of(log)["pushes"]
    assert {*reference.PUSHES} == {*push}
    for name in run.logs:
        assert f"| `{name}` |" in page, name


def test_the_reference_says_what_a_field_is():
    """Oracle: by hand, the doc, default and bounds of its declaration."""
    rows = [*reference.fields("search.", SearchParams())]
    assert rows[0] == (
        "`search.resolution`",
        "0.02",
        "in [0.0001, 1] m/s",
        "of the limit [m/s]",
    )
    names = [name for name, *_ in reference.fields("", nb.Scenario())]
    assert "`controller.balance.feedback_gain`" in names
    assert "`sources`" not in names  # nobody sets it


def test_the_source_of_each_file_of_a_model_is_told():
    """Oracle: the files in the folder of each model."""
    text = (ROOT / "models" / "README.md").read_text(encoding="utf-8")
    told = set(re.findall(r"`(\w+/[\w.]+)`", text))
    models = ROOT / "models"
    assert told == {
        str(path.relative_to(models))
        for pattern in ("*/LICENSE", "*/*.csv", "*/*.urdf", "*/*.yaml")
        for path in models.glob(pattern)
    }


@pytest.mark.parametrize(
    ("book", "moved"),
    [
        ("point_mass", "draw_motion(0.5, 0.15)\ndraw_escape(0.3, 0.9)"),
        ("capture_regions", "draw_regions(0.1, 0.2, 0.7, 'apart')"),
        ("robot", ""),
    ],
)
def test_a_notebook_tells_what_it_promises(book, moved):
    """Oracle: who recovers; the sliders draw without an error, too."""
    cells = [cell for cell in BOOKS[book] if cell["cell_type"] == "code"]
    code = "\n".join("".join(cell["source"]) for cell in cells) + f"\n{moved}"
    told = once("docs.learn", code, lambda: said_by(code))
    assert told.count("RECOVERED in") == 1
    assert "FELL" not in told


def test_the_ankle_of_the_notebook_stops_what_it_says():
    """Oracle: by hand: sqrt(g / z) times the sole's front end."""
    robot = nb.load_robot("nadia").point_mass
    largest = math.sqrt(9.81 / robot.com_height) * robot.sole[:, 0].max()
    assert f"a push of {largest:.2f} m/s" in json.dumps(BOOKS["point_mass"])


def test_the_stored_notebooks_were_executed_and_are_small():
    """Oracle: the numbers of the cells that do not play; 250 kB."""
    assert [*BOOKS] == ["capture_regions", "point_mass", "robot"]
    for name, cells in BOOKS.items():
        numbers = [
            cell["execution_count"]
            for cell in cells
            if cell["cell_type"] == "code" and not cell["metadata"].get("tags")
        ]
        assert numbers == list(range(1, len(numbers) + 1)), name
        assert json.dumps(cells).count("RECOVERED in") == 1
        size = (ROOT / "docs" / "learn" / f"{name}.ipynb").stat().st_size
        assert size < 250_000, name


# Written by programs, from numbers; not to be read as a page of the guide.
TABLES = {
    *ROOT.glob("docs/results/*/*.md"),
    *ROOT.glob("docs/results/single/*/*.md"),
}


def test_no_sentence_is_longer_than_35_words():
    """Oracle: by hand, two sentences and a cell; the pages."""
    text = "One two, i.e. three. Four:\n\n| five six | `s` |\n|---|---|\n"
    counts = [prose.words(one) for one in prose.sentences(text)]
    assert [count for count in counts if count] == [4, 1, 2, 1]
    long = "word " * 36
    assert prose.too_long(f"{long}.\n\n* {long[5:]}.") == [f"{long}."]
    for page in {*PAGES} - TABLES:
        assert not prose.too_long(page.read_text("utf-8")), page
    for name, cells in BOOKS.items():
        words = [
            "".join(c["source"]) for c in cells if c["cell_type"][0] == "m"
        ]
        assert not prose.too_long("\n\n".join(words)), name


def test_each_page_says_first_whom_it_is_for():
    """Oracle: the first word below the title of each page of the guide."""
    guide = (ROOT / "docs" / "index.md").read_text("utf-8")
    links = re.findall(r"^- \[.*?\]\(([^)]*\.md)\)", guide, re.MULTILINE)
    pages = {(ROOT / "docs" / link).resolve() for link in links}
    papers = {*ROOT.glob("docs/publish/*.md"), ROOT / "docs" / "index.md"}
    assert pages | papers == {*PAGES} - TABLES - {
        ROOT / "docs/results/robots.md"
    }
    for page in pages - {ROOT / "README.md", ROOT / "CHANGELOG.md"}:
        _, first, *_ = page.read_text("utf-8").split("\n\n")
        assert first.startswith("For "), page
    for name, cells in BOOKS.items():
        _, first, *_ = "".join(cells[0]["source"]).split("\n\n")
        assert first.startswith("For "), name


def test_readme_and_results_are_short():
    """Oracles: 700 and 900 words, code and tables included."""
    results = (ROOT / "docs" / "results" / "README.md").read_text("utf-8")
    assert len(README.split()) <= 700
    assert len(results.split()) <= 900
