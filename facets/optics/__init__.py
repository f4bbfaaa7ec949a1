from ..core.faces import load_on_use

__getattr__ = load_on_use(
    __name__,
    {
        "effects": "LightEffects",
        "forward": "OPEN build_geometry dark_scene",
        "parameters": "BEAM FACET PARAMETERS PSD",
        "tail_quadrature": "AWAY_SIGMAS tail_integrals",
        "vectors": "rotation",
        "wedge": "moments_along_float side",
    },
)
