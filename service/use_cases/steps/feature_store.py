"""Keep the features of a scan as one blob, so that no later job extracts them again."""

import types
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from algorithms.features.scan_features import ScanFeatures

T = TypeVar("T")


def save_features(path: Path, features: ScanFeatures) -> None:
    """Write features to a numpy archive; nested dataclasses become dotted names, None is left out."""
    np.savez(path, **_flatten(features, ""))


def load_features(path: Path) -> ScanFeatures:
    """Read what `save_features` wrote, bit for bit."""
    with np.load(path, allow_pickle=False) as archive:
        return _build(ScanFeatures, {name: archive[name] for name in archive.files}, "")


def load_members(path: Path, *names: str) -> list[Any]:
    """Read some members, by dotted names: of many scans one after the other, where all would be read in vain."""
    with np.load(path, allow_pickle=False) as archive:
        members = []
        for name in names:
            kind: Any = ScanFeatures
            for part in name.split("."):
                kind = get_type_hints(kind)[part]
            own = [each for each in archive.files if each == name or each.startswith(f"{name}.")]
            members.append(_member(kind, {each: archive[each] for each in own}, name))
        return members


def _flatten(value: Any, prefix: str) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for field in fields(value):
        member = getattr(value, field.name)
        if is_dataclass(member):
            flat.update(_flatten(member, f"{prefix}{field.name}."))
        elif member is not None:
            flat[prefix + field.name] = np.asarray(member)
    return flat


def _build(kind: type[T], flat: dict[str, Any], prefix: str) -> T:
    hints = get_type_hints(kind)
    names = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    return kind(**{name: _member(hints[name], flat, prefix + name) for name in names})


def _member(hint: Any, flat: dict[str, Any], name: str) -> Any:
    if get_origin(hint) in {Union, types.UnionType}:
        hint = next(option for option in get_args(hint) if option is not type(None))
    if is_dataclass(hint) and any(key.startswith(name + ".") for key in flat):
        return _build(hint, flat, name + ".")  # type: ignore[arg-type]
    if name not in flat:
        return None
    if get_origin(hint) is tuple:
        return tuple(flat[name].tolist())
    return hint(flat[name]) if hint in {int, float, bool, str} else flat[name]
