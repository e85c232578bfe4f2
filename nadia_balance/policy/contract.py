"""Where the contract of a policy comes from, field by field.

default of the code < metadata of the ONNX file < deploy.yaml beside it < what
the user gives: files, and single fields in YAML
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from nadia_balance.parameters.bounds import require
from nadia_balance.parameters.layers import Layer, merged
from nadia_balance.parameters.scaling import NADIA
from nadia_balance.parameters.yaml_reader import (
    field_types,
    load_tree,
    naming,
    shortened,
)
from nadia_balance.parameters.yaml_writer import as_tree, dump
from nadia_balance.policy import deploy_yaml, holosoma
from nadia_balance.policy.network import Network
from nadia_balance.policy.params import PolicyParams

# Seen from the folder of the ONNX file.
_BESIDE = "deploy.yaml", "../params/deploy.yaml"
_FLAG = "flag"  # the source of single fields


class Contract(NamedTuple):
    """What a policy was trained with, and who says so.

    Attributes:
        params: all fields.
        sources: by the path of a value, such as "stiffness"; a default of the
            code has none.
    """

    params: PolicyParams
    sources: Mapping[str, str]

    def source(self, field: str) -> str:
        """Where a field comes from.

        Args:
            field: of PolicyParams.

        Returns:
            Its sources, or "default".
        """
        sources = [
            source
            for path, source in self.sources.items()
            if path.partition(".")[0] == field
        ]
        return ", ".join(dict.fromkeys(sources)) or "default"

    def lines(self) -> list[str]:
        """Returns the contract for people.

        Returns:
            A line for each field: its value, shortened, and its source.
        """
        return [
            f"{name} = {shortened(str(value))}  ({self.source(name)})"
            for name, value in as_tree(self.params).items()
        ]

    def as_yaml(self) -> str:
        """Returns the contract as a file that `read_contract` takes.

        Returns:
            YAML, with the source of each field beside it.
        """
        names = field_types(PolicyParams)
        return dump(
            self.params, comments={name: self.source(name) for name in names}
        )


def read_contract(
    network: Network, motors: Sequence[str], given: Sequence[str] = ()
) -> Contract:
    """Reads the contract of a policy.

    Args:
        network: of the policy.
        motors: names of the robot's joints, in the order of its actuators.
        given: files, a deploy.yaml or one with fields of PolicyParams, and
            YAML of such fields in braces; a later one counts more.

    Returns:
        The contract, checked.

    Raises:
        ValueError: a source is malformed, or the contract is not one of this
            robot: one line that names source, field, value and what is allowed.
    """
    layers = list(_layers(network, motors, given))
    require(
        any("joints" in layer.tree for layer in layers),
        f"{network.name}: must have metadata dof_names, kp, kd, or a contract: "
        "deploy.yaml beside it or in ../params, or --contract",
    )
    try:
        params, sources = merged(PolicyParams, NADIA, layers)
    except ValueError as error:
        raise ValueError(
            f"{_source_of(error, layers) or network.name}: {error}"
        ) from None
    missing = [name for name in motors if name not in params.joints]
    others = [name for name in params.joints if name not in motors]
    faults = [
        f"{verb} {', '.join(names)}"
        for verb, names in (("lacks", missing), ("has besides", others))
        if names
    ]
    require(
        not faults,
        f"{sources['joints']}: joints must be those of the robot: "
        f"{'; '.join(faults)}",
    )
    return Contract(params, sources)


def contract_files(onnx: str | Path, given: Sequence[str] = ()) -> list[str]:
    """What a contract is read from, besides the ONNX file.

    Args:
        onnx: file of the policy.
        given: as of read_contract.

    Returns:
        Paths, and fields in braces, in their order.
    """
    beside = [str(Path(onnx).parent / name) for name in _BESIDE]
    return [*(path for path in beside if Path(path).is_file()), *given]


def is_text(given: str) -> bool:
    """Whether a contract is YAML in braces, and no file.

    Args:
        given: by the user.

    Returns:
        True if it is.
    """
    return given.lstrip().startswith("{")


def _layers(
    network: Network, motors: Sequence[str], given: Sequence[str]
) -> Iterator[Layer]:
    """The layers of a contract, the first one below all."""
    if holosoma.is_holosoma(network.metadata):
        with naming(network.name):
            tree = holosoma.metadata_tree(network.metadata)
        robot, defaults = holosoma.default_tree(tree["joints"])
        yield Layer(f"default, holosoma's {robot}", defaults)
        yield Layer(f"metadata of {network.path.name}", tree)
    for source in contract_files(network.path, given):
        if is_text(source):
            with naming(_FLAG):
                yield Layer(_FLAG, load_tree(source))
        else:
            yield _layer_of_file(Path(source), motors)


def _layer_of_file(path: Path, motors: Sequence[str]) -> Layer:
    require(path.is_file(), f"contract = {str(path)!r}: must be a file")
    with naming(f"contract = {str(path)!r}"):
        tree = deploy_yaml.read_tree(path.read_text(encoding="utf-8"))
        if deploy_yaml.is_deploy(tree):
            tree = deploy_yaml.params_tree(tree, motors)
    return Layer(path.name, tree)


def _source_of(error: ValueError, layers: Sequence[Layer]) -> str:
    """The last layer that gives the field with which a message begins."""
    field = re.split(r"\W", str(error), maxsplit=1)[0]
    sources = [layer.source for layer in layers if field in layer.tree]
    return sources[-1] if sources else ""
