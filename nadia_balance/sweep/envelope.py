"""A sweep in one call, as scripts/envelope.py makes it by its flags."""

from collections.abc import Mapping, Sequence
from numbers import Integral
from pathlib import Path
from typing import Any, cast

from dask.system import CPU_COUNT

from nadia_balance.core.walking.mechanisms import MOST
from nadia_balance.diagrams.closed_loop import ClosedLoop
from nadia_balance.diagrams.own_blocks import name_of
from nadia_balance.diagrams.scenario import AT, load_scenario
from nadia_balance.parameters.bounds import check_number, check_type, require
from nadia_balance.parameters.yaml_reader import check_types
from nadia_balance.policy.controller import PolicyController
from nadia_balance.results.folder import prepare_folder
from nadia_balance.results.pages import CONTRACT
from nadia_balance.sweep.limits import (
    LimitTable,
    check_beside,
    first_pushes,
    limit_table,
)
from nadia_balance.sweep.report import write_report
from nadia_balance.sweep.run_trial import check_workers, open_workers, run_sweep
from nadia_balance.sweep.search import SearchParams, Sweep

MOST_DIRECTIONS = 72  # largest count of directions


def envelope(
    out: str | Path,
    scenario: str = "push",
    *,
    directions: int | Sequence[float] = 12,
    at: str = AT,
    mechanisms: Sequence[str] = (MOST,),
    blocks: Mapping[str, type | str | None] | None = None,
    controller: type | str = "",
    contract: Sequence[str] = (),
    search: SearchParams | None = None,
    plant: str = "humanoid",
    beside: str | Path | None = None,
    workers: int = CPU_COUNT,
    scheduler: str | None = None,
    **changes: Any,
) -> LimitTable:
    """Finds the largest pushes that the robot recovers from, all around it.

    Trials that are in the folder are not made again: the same call goes on.
    Each worker imports the classes, and makes blocks of its own.

    Args:
        out: folder that gets the trials, the limits, tables and a picture.
        scenario: name of one with one push.
        directions: in [0, 360) [deg], or how many all around.
        at: when the push begins.
        mechanisms: names of sets of mechanisms.
        blocks: classes by role, in the place of our blocks; None leaves one
            out.
        controller: class of a controller, or path of a policy, in the place of
            ours.
        contract: of a policy, files and fields in braces (docs/policy.md).
        search: resolution, strides and replicas; by default SearchParams().
        plant: "humanoid", or "lipm".
        beside: folder of another sweep, to compare with.
        workers: processes on this machine.
        scheduler: of a Dask cluster to run on, tcp://host:port.
        **changes: fields of the scenario.

    Returns:
        The limits; their `records` have one for each direction.

    Raises:
        ValueError: an argument is invalid, or a block cannot be made.
        RuntimeError: a worker fails.
        OSError: a file cannot be written.
    """
    require(bool(str(out)), "out = '': must be the name of a folder")
    check_type("blocks", {} if blocks is None else blocks, Mapping)
    check_types(list[str], mechanisms, "mechanisms")
    check_type("at", at, str)
    check_type("search", search or SearchParams(), SearchParams)
    check_workers(workers)
    check_types(list[str], contract, "contract")
    name = controller if isinstance(controller, str) else name_of(controller)
    sweep = Sweep(
        scenarios={scenario: load_scenario(scenario, **changes)},
        plant=plant,
        controller=name,
        contract=tuple(contract),
        blocks={role: name_of(kind) for role, kind in (blocks or {}).items()},
        directions=_angles(directions),
        at=(at,),
        mechanisms=tuple(mechanisms),
        search=search or SearchParams(),
    )
    sweep.validate()
    diagram = sweep.try_out()
    other = None if beside is None else Path(beside)
    check_beside(other, sweep.identity(), sweep.cells())
    sweep.first = first_pushes(sweep)
    folder = prepare_folder(Path(out))
    with (
        open_workers(workers, scheduler) as executor,
        sweep.opened(folder) as rows,
    ):
        keep_contract(folder, diagram)
        run_sweep(sweep, rows, executor)
        table = limit_table(rows, sweep.scenarios, other)
        write_report(table, rows)
    return table


def all_around(count: int) -> tuple[float, ...]:
    """Directions at equal distances.

    Args:
        count: how many.

    Returns:
        Angles in [0, 360) [deg], from 0 on.
    """
    return tuple(round(i * 360.0 / count, 6) for i in range(count))


def _angles(directions: int | Sequence[float]) -> tuple[float, ...]:
    """The angles [deg] that are listed, or as many as are counted."""
    if isinstance(directions, Integral) and not isinstance(directions, bool):
        count = int(directions)
        check_number("directions", count, least=1, most=MOST_DIRECTIONS)
        return all_around(count)
    check_types(list[float], directions, "directions")
    angles = cast(Sequence[float], directions)
    return tuple(round(float(angle), 6) for angle in angles)


def keep_contract(folder: Path, diagram: ClosedLoop) -> list[str]:
    """Writes the contract of a policy beside the rows of its trials.

    Args:
        folder: of the sweep.
        diagram: of one of its trials.

    Returns:
        The contract for people, a line for each field; none without a policy.

    Raises:
        OSError: the file cannot be written.
    """
    controller = diagram.controller
    if not isinstance(controller, PolicyController):
        return []
    (folder / CONTRACT).write_text(
        controller.contract.as_yaml(), encoding="utf-8"
    )
    return controller.contract.lines()
