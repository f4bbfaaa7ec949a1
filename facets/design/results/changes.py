"""A design as a configuration that extends its original and has only the changed keys."""

from __future__ import annotations

import os
from copy import deepcopy
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...config.build import differences
from ...config.loading import load
from ...config.sensor_keys import write_sensor
from ...config.shipped_files import shipped
from ...core.errors import ConfigError
from ...core.names import DETECTORS, escape_undecodable
from ...core.sensor import Sensor
from ...files.tables import head_lines
from ...files.whole import Whole, hidden_name, readable_path

if TYPE_CHECKING:
    from ...core.settings import Config

#: Decimals of values that follow from the variables, such as a detector's height in mm.
DECIMALS = 3


def changed_keys(settings: Config, sensor: Sensor) -> dict[str, Any]:
    """The keys below `sensor` whose values differ from the configuration's, as nested dictionaries
    with a block per detector."""
    keys = write_sensor(settings.resolved["sensor"], sensor)
    keys["noise"]["position_um"] = 1000 * sensor.noise.position
    keys["noise"]["power_uw"] = 1000 * sensor.noise.power
    if sensor.electronics is not None:
        keys["electronics"]["transimpedance_kohm"] = sensor.electronics.transimpedance / 1000
    for letter in DETECTORS:  # follows from an inclination; to 1 um
        keys["psd"][letter]["height_mm"] = round(keys["psd"][letter]["height_mm"], DECIMALS)
    return differences(settings.resolved["sensor"], keys, tidy)


def tidy(value: Any) -> Any:
    """Round off the digits that a conversion of units adds."""
    if isinstance(value, float):
        return float(f"{round(value, 9):.12g}")
    if isinstance(value, list):
        return [tidy(item) for item in value]
    return value


def merge_common_keys(block: dict[str, Any]) -> dict[str, Any]:
    """Replace keys that a, b and c all change to the same value by one common key."""
    singles = [block.get(letter, {}) for letter in DETECTORS]
    shared = {
        key: value
        for key, value in singles[0].items()
        if all(key in each and each[key] == value for each in singles)
    }
    rest = {
        letter: {key: value for key, value in each.items() if key not in shared}
        for letter, each in zip(DETECTORS, singles, strict=True)
    }
    return shared | {letter: keys for letter, keys in rest.items() if keys}


def changes_of(settings: Config, sensor: Sensor) -> list[tuple[str, Any, Any]]:
    """List every changed key as (path, before, after), once if a, b and c change alike."""
    return list(
        changed_paths(
            merge_common_blocks(changed_keys(settings, sensor)), settings.resolved["sensor"]
        )
    )


def changed_paths(new: dict[str, Any], old: Any, prefix: str = "") -> Any:
    """Yield the path, the old and the new value of each changed key."""
    for key, value in new.items():
        # the old value of a common key is that of a
        before = old.get(key, old["a"].get(key) if "a" in old else None)
        if isinstance(value, dict):
            yield from changed_paths(value, before, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", plain_value(before), plain_value(value)


def plain_value(value: Any) -> Any:
    """Convert a value to the form that it has in a configuration."""
    value = tidy(value)
    same = isinstance(value, list) and len(value) == 2 and value[0] == value[1]
    return value[0] if same else value


def merge_common_blocks(keys: dict[str, Any]) -> dict[str, Any]:
    """Merge the keys that a, b and c all change to the same value, below `mirror` and below
    `psd`."""
    merged = deepcopy(keys)
    for block in ("mirror", "psd"):
        if block in merged:
            merged[block] = merge_common_keys(merged[block])
    return merged


def base_of(settings: Config, folder: Path) -> str:
    """Return the value of `extends` for a file in that folder."""
    if shipped().get(settings.name) == settings.path:
        return settings.name
    try:
        return Path(os.path.relpath(settings.path, folder.resolve())).as_posix()
    except ValueError:  # on another drive
        return settings.path.as_posix()


def common_keys_hold(settings: Config, sensor: Sensor, folder: Path) -> bool:
    """Whether the common keys apply to all three detectors or facets. They do not if the
    configuration has another value for one of them."""
    keys = changed_keys(settings, sensor)
    text = document(base_of(settings, folder), merge_common_blocks(keys), {})
    return loads_with_keys(text, folder, keys, settings)


def as_extension(
    settings: Config,
    sensor: Sensor,
    folder: Path,
    about: dict[str, str],
    remarks: dict[str, str] | None = None,
) -> str:
    """Return the YAML of a configuration in `folder` that loads to the design.

    remarks: by variable, such as radius_mm; they become comments at the keys of that name.
    """
    keys = changed_keys(settings, sensor)
    if common_keys_hold(settings, sensor, folder):
        keys = merge_common_blocks(keys)
    return "\n".join(
        [*head_lines(about), "", document(base_of(settings, folder), keys, remarks or {})]
    )


def write_design(
    settings: Config, sensor: Sensor, path: Path, about: dict[str, str],
    remarks: dict[str, str] | None = None,
) -> Config | str:  # fmt: skip
    """Write a design as a configuration that extends its original. Return the loaded
    configuration, or the reason if it does not load; the file then remains. Raises `OutputError`
    if writing fails.  remarks: see `as_extension`."""
    with Whole(path) as temporary:
        text = as_extension(settings, sensor, path.parent, about, remarks)
        temporary.write_text(escape_undecodable(text), "utf-8")
    file = readable_path(path)
    try:
        return replace(load(file), name=escape_undecodable(path.stem), path=path.resolve())
    except ConfigError as error:  # a sub-beam may miss a detector outside the volume
        return str(error).replace(file.name, path.name)


def document(base: str, keys: dict[str, Any], remarks: dict[str, str]) -> str:
    """The YAML text of changed keys, with remarks as comments."""
    from ruamel.yaml import YAML

    stream = StringIO()
    yaml = YAML()
    yaml.width = 4096
    yaml.dump({"extends": base, **({"sensor": plain_yaml(keys)} if keys else {})}, stream)
    lines = []
    for line in stream.getvalue().splitlines():
        key = line.strip().partition(":")[0]
        remark = remarks.get(key, "")
        lines.append(f"{line:<32}  # {remark}" if remark and not line.endswith(":") else line)
    return "\n".join(lines) + "\n"


def plain_yaml(value: Any) -> Any:
    """Write pairs of equal numbers as one number, and other lists in one line."""
    from ruamel.yaml.comments import CommentedSeq

    if isinstance(value, dict):
        return {key: plain_yaml(each) for key, each in value.items()}
    if not isinstance(value, list):
        return value
    if len(value) == 2 and value[0] == value[1]:
        return value[0]
    row = CommentedSeq(value)
    row.fa.set_flow_style()
    return row


def loads_with_keys(text: str, folder: Path, keys: dict[str, Any], settings: Config) -> bool:
    """Whether the text, as a file in the folder, loads to the configuration with these keys."""
    path = hidden_name(folder / "design.yaml")
    try:
        path.write_text(text, "utf-8")
        loaded = load(path).resolved["sensor"]
    except ConfigError:
        return True  # loading the file itself reports why
    finally:
        path.unlink(missing_ok=True)
    return bool(differences(settings.resolved["sensor"], loaded, tidy) == keys)
