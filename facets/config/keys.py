"""The check of a whole configuration file, made from the declarations of its keys.

Defaults are the rig of Park & Cho, Table 1; R_PSD, which is missing there, follows from the ranges
of Table 2.
"""

from __future__ import annotations

from typing import Annotated, Any, Union

from pydantic import BeforeValidator, Field, create_model

from ..core.keys import Key, block_of
from ..core.motions import KINDS
from ..core.settings import Config
from .models import NAME, StrictModel, field_of, model_of, none_to_block, type_of
from .sensor_keys import SENSOR

#: One of the kinds of motions, which has other keys than the others.
MOTION: Any = Annotated[
    Union[tuple(model_of(block_of(kind), kind=kind.kind) for kind in KINDS)],  # noqa: UP007
    Field(discriminator="kind"),
]
MOTIONS: Any = dict[NAME, MOTION]
EXTENDS = Key(
    "extends",
    None,
    "shipped name, or path from this file, whose keys this file overrides; of "
    "several, the later override the earlier",
    hint=str | list[str],
)
BLOCKS = (EXTENDS, Key("sensor", {}, "the sensor", block=SENSOR), *block_of(Config).keys)
KEYS: dict[str, Any] = {key.name: (type_of(key), field_of(key)) for key in BLOCKS}
KEYS["motions"] = (
    Annotated[MOTIONS, BeforeValidator(none_to_block)],
    Field({}, description="name: motion; `facets simulate` runs them one after the other"),
)
ORDER = ("extends", "sensor", "motions", *KEYS)
#: A whole file.
Document: Any = create_model(
    "Document",
    __base__=StrictModel,
    __doc__="A configuration of the three-facet-mirror 6-DOF sensor.",
    **{name: KEYS[name] for name in dict.fromkeys(ORDER)},
)
