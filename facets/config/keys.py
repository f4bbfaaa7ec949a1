"""The keys of a complete configuration file.

The defaults describe the rig of Park & Cho, Table 1; R_PSD, which the table lacks, follows from the
ranges of Table 2.
"""

from __future__ import annotations

from dataclasses import MISSING, replace

from ..core.keys import Key, KeyBlock, block_of, block_of_keys
from ..core.motions import KINDS
from ..core.settings import Config
from .sensor_keys import SENSOR


def _motion_block(block: KeyBlock, kind: str) -> KeyBlock:
    word = Key("kind", MISSING, "kind of the motion", words={kind: kind})
    return replace(block, common=(word,))


#: The kinds of motions, each with its own keys.
MOTIONS = {kind.kind: _motion_block(block_of(kind), kind.kind) for kind in KINDS}
#: The keys of a file.
DOCUMENT = block_of_keys(
    "Document",
    "A configuration of the three-facet-mirror 6-DOF sensor.",
    [
        Key(
            "extends",
            None,
            "shipped name, or path from this file, whose keys this file overrides; of "
            "several, the later override the earlier",
            hint=str | list[str],
        ),
        Key("sensor", {}, "the sensor", block=SENSOR),
        Key(
            "motions",
            {},
            "name: motion; `facets simulate` runs them one after the other",
            kinds=MOTIONS,
        ),
        *block_of(Config).keys,
    ],
    dict,
)
