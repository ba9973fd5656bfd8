"""Constraints as JSON documents."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from mograft.motion.motion import Motion
from mograft.search import donor_constraints, obstacles, pose_constraints
from mograft.search.constraints import Constraint

Record = dict[str, Any]

_KINDS: Mapping[str, type] = {
    name: getattr(module, name)
    for module, names in (
        (donor_constraints, "Ban KeepOriginal MaxAngle MaxStretch NotFrom OnlyFrom Use"),
        (obstacles, "Box Capsule Character HalfSpace Sphere"),
        (pose_constraints, "Avoid AvoidSelf Face FigurePosition KeepOut Reach"),
    )
    for name in names.split()
}


@dataclass(frozen=True)
class UnrestoredConstraint(Constraint):
    """A constraint that a document cannot restore, such as a `Custom` constraint.

    The document holds only its class and its name, not its Python code. It accepts every motion.
    """

    kind: str = ""
    name: str = ""


def constraint_kind(constraint: Constraint) -> str:
    """Return the name of a constraint's class."""
    if isinstance(constraint, UnrestoredConstraint):
        return constraint.kind
    return type(constraint).__name__


def encode_constraint(constraint: Constraint, encode_motion: Callable[[Motion], Record]) -> Record:
    """Return a constraint as a JSON document with its class as ``kind``.

    `encode_motion` returns the document of the motion of a `Character`. If the constraint is a
    `Custom`, or its class is not one of mograft's, the document holds only the class and the name.
    """
    obstacle = getattr(constraint, "obstacle", getattr(constraint, "region", None))
    parts = [constraint] if obstacle is None else [constraint, obstacle]
    if any(_KINDS.get(type(part).__name__) is not type(part) for part in parts):
        kind = constraint_kind(constraint)
        return {"kind": kind, "name": str(getattr(constraint, "name", kind)), "is_restored": False}
    record: Record = _encode(constraint, encode_motion)
    return record


def _encode(value: Any, encode_motion: Callable[[Motion], Record]) -> Any:  # noqa: ANN401 - of JSON
    if isinstance(value, Motion):
        return encode_motion(value)
    if is_dataclass(value):
        names = [field.name for field in fields(value) if field.init]
        own = {name: _encode(getattr(value, name), encode_motion) for name in names}
        return {"kind": type(value).__name__, **own}
    if isinstance(value, set | frozenset):
        value = sorted(value)
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_encode(item, encode_motion) for item in value]
    return value


def decode_constraint(record: Record, decode_motion: Callable[[Record], Motion]) -> Constraint:
    """Return the constraint, given a document that `encode_constraint` returned.

    Raise ValueError, TypeError or KeyError if the document is damaged.
    """
    if record.get("is_restored") is False:
        return UnrestoredConstraint(str(record["kind"]), str(record["name"]))
    constraint = _decode(record, decode_motion)
    if not isinstance(constraint, Constraint):
        raise ValueError(f"`kind` must name a constraint, got {record.get('kind')!r}")
    return constraint


def _decode(value: Any, decode_motion: Callable[[Record], Motion]) -> Any:  # noqa: ANN401 - of JSON
    if isinstance(value, list):
        return tuple(_decode(item, decode_motion) for item in value)
    if not isinstance(value, dict):
        return value
    if "kind" not in value:
        return decode_motion(value)
    kind = _KINDS.get(value["kind"])
    if kind is None:
        raise ValueError(f"unknown constraint or obstacle {value['kind']!r}")
    items = ((name, own) for name, own in value.items() if name != "kind")
    return kind(**{name: _decode(own, decode_motion) for name, own in items})
