from ..core.faces import load_on_use

__getattr__ = load_on_use(
    __name__,
    {
        "half_normal": "tail_integrals",
        "tail": "far_side sum_of_products tail_wedge",
        "effects": "LightEffects",
        "forward": "BEAM FACET OPEN PARAMETERS PSD build_geometry dark_scene",
        "vectors": "rotation",
        "wedge": "sides",
    },
)
