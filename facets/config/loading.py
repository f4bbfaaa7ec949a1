"""Load a configuration: from a file's name to a checked `Config`."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from math import inf, pi
from pathlib import Path
from typing import Any

from ..core.arguments import check_arguments
from ..core.channels import AuxiliaryChannel, is_taken
from ..core.errors import ConfigError, InputError
from ..core.keys import block_of
from ..core.names import DETECTORS, escape_undecodable
from ..core.sensor import Electronics
from ..core.settings import Config, resolved_text
from . import alignment_check
from .blame import culprits, message
from .checks import resolve
from .files import find, gather
from .keys import MOTIONS
from .problems import messages, quote_value
from .sensor_keys import SENSOR
from .yaml_positions import Marked, dotted_path, path_text


@check_arguments
def load(name_or_path: str | Path) -> Config:
    """Load a configuration, checked, with every default filled in.

    Parameters
    ----------
    name_or_path
        The bare name of a shipped configuration (`facets config list` names them), or the path of
        a YAML file.

    Returns
    -------
    Config
        The sensor, the motions and the settings of each command; lengths in mm, angles in rad.

    Raises
    ------
    ConfigError
        If a key or a value is wrong: one line for each problem, FILE:LINE: key.path: reason.

    Examples
    --------
    >>> import facets
    >>> facets.load("paper").sensor.beam.power
    0.3
    """
    file = find(name_or_path)
    tree = gather(file)
    resolved = _resolve(tree)
    settings = {name: source.value(resolved) for name, source in block_of(Config).sources.items()}
    if settings["acquire"].detectors == 2:  # Older files write it this way.
        settings["solve"] = replace(settings["solve"], accept_unchecked=True)
    settings["layout"] = replace(settings["layout"], object=settings["object"])
    return Config(
        name=escape_undecodable(file.stem),
        path=file,
        sensor=SENSOR.read(resolved["sensor"]),
        motions={
            name: MOTIONS[keys["kind"]].read(keys) for name, keys in resolved["motions"].items()
        },
        electronics=block_of(Electronics).read(resolved["sensor"]["electronics"]),
        resolved=resolved,
        sha256=fingerprint(resolved),
        **settings,
    )


def fingerprint(resolved: dict[str, Any]) -> str:
    """SHA-256 checksum, in hexadecimal digits, of the `resolved_text` of a configuration."""
    return hashlib.sha256(resolved_text(resolved).encode()).hexdigest()


def _resolve(tree: Marked) -> dict[str, Any]:
    resolved, wrong = resolve(tree.plain())
    if wrong:
        raise ConfigError("\n".join(messages(wrong, tree)))
    if lost := _locate_measured_files(tree, resolved["sensor"]):
        raise ConfigError("\n".join(lost))  # Without a sound tree there is no sensor to check.
    problems = [
        *(
            _wide_edges(tree, resolved["sensor"])
            or _gained_strips(tree, resolved["sensor"])
            or _sensor_problems(tree, resolved["sensor"])
        ),
        *_locate_tables(tree, resolved["motions"]),
        *_method_conflicts(tree, resolved["solve"]),
        *_channel_conflicts(tree, resolved["acquire"]["channels"]),
        *_stage_conflicts(tree, resolved["stage"]),
        *_empty_bounds(tree, resolved["optimize"]["variables"]),
        *_layout_conflicts(tree, resolved["optimize"]),
    ]
    if problems:
        raise ConfigError("\n".join(problems))
    return resolved


def _sensor_keys(tree: Marked) -> dict[str, Any]:
    """The resolved `sensor` block of a tree without problems, with absolute paths."""
    keys: dict[str, Any] = resolve(tree.plain())[0]["sensor"]
    _locate_measured_files(tree, keys)
    return keys


def _sensor_problems(tree: Marked, keys: dict[str, Any]) -> list[str]:
    """Describe a sensor that is not possible, or a sub-beam that misses its detector.

    The message names the key of the loaded file without which there is no problem; of several such
    keys, the one without which the spots are closest to the middles of their detectors.
    """
    if not (complaint := _complaint(keys)):
        return []
    paths = culprits(tree, _worst_miss)
    got = quote_value(tree.find(paths[0])[0].plain())
    return [message(tree, paths, f"{complaint} (got {got})")]


def _complaint(keys: dict[str, Any]) -> str:
    try:
        return alignment_check.complaint(SENSOR.read(keys))
    except InputError as error:
        return str(error)


def _worst_miss(tree: Marked) -> float:
    """The `alignment_check.worst_miss` of a tree; infinite if its sensor is not possible."""
    try:
        return alignment_check.worst_miss(SENSOR.read(_sensor_keys(tree)))
    except InputError:
        return inf


def _locate_tables(tree: Marked, motions: dict[str, Any]) -> list[str]:
    """Make the paths of motions' tables absolute, and describe missing files.

    A relative path starts at the folder of the file that names it.
    """
    problems = []
    for name, keys in motions.items():
        if keys["kind"] != "table":
            continue
        mark, _ = tree.find(("motions", name, "file"))
        file = mark.file.parent / Path(keys["file"]).expanduser()
        if not file.is_file():
            problems.append(
                f"{mark.place}: motions.{name}.file: no such file (got {keys['file']!r}; "
                f"looked for {path_text(file)})"
            )
        keys["file"] = str(file.resolve())
    return problems


#: Keys that name files of measurements, and the keys of their checksums.
MEASURED: dict[str, tuple[list[tuple[str, ...]], str]] = {
    "calibration": ([("calibration", "file")], "sha256"),
    **{
        f"psd.{letter}.correction": (
            [("psd", letter, "correction", "table"), ("psd", "correction", "table")],
            "table_sha256",
        )
        for letter in DETECTORS
    },
}


def measured_files(resolved: dict[str, Any]) -> list[tuple[dict[str, Any], str, str]]:
    """The files of measurements in a resolved configuration, each as its block, the name of its key
    there, and its checksum."""
    files = []
    for block, (places, total) in MEASURED.items():
        keys, name = _block(resolved["sensor"], block), places[0][-1]
        if keys[name] is not None:
            files.append((keys, name, keys[total]))
    return files


def source_files(config: Config) -> list[Path]:
    """All files of a configuration: its own, the files that it extends, and its tables."""
    files = dict[Path, Marked]()
    gather(config.path, files)
    motions = [keys for keys in config.resolved["motions"].values() if keys["kind"] == "table"]
    tables = [keys[name] for keys, name, _ in measured_files(config.resolved)]
    return [*files, *(Path(table) for table in (*tables, *(keys["file"] for keys in motions)))]


def _block(keys: dict[str, Any], dotted: str) -> dict[str, Any]:
    """The block at a dotted path."""
    for part in dotted.split("."):
        keys = keys[part]
    return keys


def _locate_measured_files(tree: Marked, sensor: dict[str, Any]) -> list[str]:
    """Make the paths of measured files absolute, fill in their checksums, and describe files that
    are missing or have another checksum than stated."""
    problems = []
    for block, (places, total) in MEASURED.items():
        keys, name = _block(sensor, block), places[0][-1]
        if keys[name] is None:
            continue
        marks = [tree.find(("sensor", *place)) for place in places]
        mark, path = next((mark, path) for mark, path in marks if path[-1] == name)
        where = f"{mark.place}: {dotted_path(path)}: "
        file = mark.file.parent / Path(keys[name]).expanduser()
        if not file.is_file():
            problems.append(
                f"{where}no such file (got {keys[name]!r}; looked for {path_text(file)})"
            )
            continue
        summed = hashlib.sha256(file.read_bytes()).hexdigest()
        if keys[total] not in (None, summed):
            problems.append(
                f"{where}{path_text(file)} has changed: its sha256 is {summed}; "
                "calibrate again, or correct the checksum"
            )
        keys[name], keys[total] = str(file.resolve()), summed
    return list(dict.fromkeys(problems))  # Three detectors may share a key.


def _wide_edges(tree: Marked, sensor: dict[str, Any]) -> list[str]:
    """Check that losses and roll-off at edges and tip are small compared with the beam, because
    they are modelled to first order."""
    diameter = sensor["beam"]["diameter_mm"]
    narrow = 1e3 * (min(diameter) if isinstance(diameter, list | tuple) else diameter)
    light = sensor["light"]
    problems = []
    for name, widest, most, unit in (
        ("strips_um", max(map(abs, light["strips_um"])), narrow / 4, "µm"),
        ("rolloff_width_um", light["rolloff_width_um"], narrow / 4, "µm"),
        ("tip_um2", abs(light["tip_um2"]), pi * (narrow / 8) ** 2, "µm²"),
    ):
        if widest > most:
            paths = [("sensor", "light", name), ("sensor", "beam", "diameter_mm")]
            reason = (
                f"sensor.light.{name} is not small compared with the beam, as the model needs (got "
                f"{widest:g}; allowed: up to {most:.3g} {unit} with a beam of {narrow / 1e3:g} mm)"
            )
            problems.append(message(tree, paths, reason))
    return problems


def _gained_strips(tree: Marked, sensor: dict[str, Any]) -> list[str]:
    """Check that the areas lost at edges and tip are not negative, unless they are estimates."""
    if sensor["calibration"]["file"] is not None:
        return []
    problems = []
    for name in ("strips_um", "tip_um2"):
        value = sensor["light"][name]
        if min(value if isinstance(value, list | tuple) else [value]) < 0:
            problems.append(
                message(
                    tree,
                    [("sensor", "light", name)],
                    f"what is lost cannot be below zero (got {quote_value(value)}; allowed: from "
                    "0; below 0 only as an estimate, with its uncertainty in sensor.calibration)",
                )
            )
    return problems


def _empty_bounds(tree: Marked, variables: dict[str, Any]) -> list[str]:
    """Check that the lowest value of each variable is below its highest."""
    return [
        f"{tree.find(('optimize', 'variables', name))[0].place}: optimize.variables.{name}: "
        f"the least must be below the most (got {quote_value(list(pair))})"
        for name, pair in variables.items()
        if pair is not None and not pair[0] < pair[1]
    ]


def _layout_conflicts(tree: Marked, keys: dict[str, Any]) -> list[str]:
    """Check that no variable is also chosen by a list of parts, and that a weighted aim has
    weights."""
    problems = [
        message(
            tree,
            [("optimize", "variables", name), ("optimize", "parts", kind)],
            f"{name} cannot both vary and come from optimize.parts.{kind}; leave one of them out",
        )
        for name, kind in (("size_mm", "psds"), ("power_mw", "lasers"))
        if keys["variables"][name] is not None and keys["parts"][kind]
    ]
    if keys["aim"] == "weighted" and not any(keys["weights"].values()):
        weights = [("optimize", "weights", name) for name in keys["weights"]]
        reason = "the aim is weighted, but every one of optimize.weights is 0"
        problems.append(message(tree, [("optimize", "aim"), *weights], reason))
    return problems


def _channel_conflicts(tree: Marked, channels: list[dict[str, Any]]) -> list[str]:
    """Check that each auxiliary channel has a column of its own, and a scale that can be undone."""
    problems, columns = [], dict[str, int]()
    for place, keys in enumerate(channels):
        path = ("acquire", "channels", place)
        column = block_of(AuxiliaryChannel).read(keys).column
        if is_taken(column):
            reason = f"its column {column} has another meaning in tables of poses; give another"
            problems.append(message(tree, [(*path, "name")], f"{reason} name or unit"))
        elif column in columns:
            paths = [(*path, "name"), ("acquire", "channels", columns[column], "name")]
            problems.append(message(tree, paths, f"two channels have the column {column}"))
        if keys["scale"] == 0:
            problems.append(message(tree, [(*path, "scale")], "must not be 0"))
        columns.setdefault(column, place)
    return problems


#: Largest force of a stage without a permit and a heartbeat, N: the limit of ISO 14120 for powered
#: guards without a protective device.
MAX_FORCE_N = 75.0
GRAVITY_M_S2 = 9.81


def _stage_conflicts(tree: Marked, keys: dict[str, Any]) -> list[str]:
    """Check that a stage with a dangerous force has a permit and a heartbeat."""
    inertia = keys["mass_kg"] * max(GRAVITY_M_S2, keys["acceleration_mm_s2"] / 1e3)
    force = max(keys["force_n"], inertia)
    lacking = [f"stage.{name}" for name in ("permit", "heartbeat") if keys[name] is None]
    if not lacking or force <= MAX_FORCE_N:
        return []
    reason = (
        f"a stage whose force, or the weight or the inertia of whose mass, is {force:.3g} N needs "
        f"{' and '.join(lacking)}; allowed without: up to {MAX_FORCE_N:g} N"
    )
    return [message(tree, [("stage", "force_n"), ("stage", "mass_kg")], reason)]


def _method_conflicts(tree: Marked, keys: dict[str, Any]) -> list[str]:
    """Check that a file with `method: paper` sets no other beam or power than this method allows.

    Omitted keys are not checked: the method ignores their defaults.
    """
    if keys["method"] != "paper":
        return []
    problems = []
    for key, needed in (("beam", "free"), ("power", "known")):
        place = ("solve", key)
        if keys[key] != needed and tree.find(place)[1] == place:
            problems.append(
                message(
                    tree,
                    [place, ("solve", "method")],
                    f"solve.{key}: {keys[key]} does not fit `method: paper` (allowed: {needed})",
                )
            )
    return problems
