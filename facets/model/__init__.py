from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import arrays as arrays, threads as threads
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "arrays": (
                "EFFECTS derivatives effect_jacobian effects geometry_of group_by_field half_sizes "
                "is_near_edge options packed_vectors parameters "
                "replace_effects sensor_with spot_size"
            ),
            "beam_shape": "axes_of shape_derivatives shape_of",
            "many": "VariedSensors evaluate vectors_of",
            "object_code": "compile_objects load_objects",
            "threads": "once share",
        },
    )
