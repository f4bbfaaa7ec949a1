from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import assembly as assembly
    from . import branching as branching
    from . import changes as changes
    from . import exploration as exploration
    from . import front as front
    from . import gallery as gallery
    from . import production as production
    from . import report as report
    from . import robust as robust
    from . import rounding as rounding
    from . import search as search
    from . import survey as survey
    from . import tables as tables
    from . import tolerancing as tolerancing
    from . import variables as variables
    from . import verification as verification
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "assembly": "assembly_of",
            "exploration": (
                "DesignDraw MEASURES Space collect designs measure_design "
                "measure_designs meets part_of part_table space_of"
            ),
            "front": "compare_with_designs pareto_front",
            "problem": "problem_of",
            "production": "count_passes interval simulate_heads",
            "robust": "robust_layout",
            "rounding": "round_design step_of",
            "search": "optimize",
            "survey": "SKIPPED",
            "tolerancing": "draw_heads expand_margins predict_yields sensitivities",
            "variables": "present_values sensor_of",
            "volume": "add_worst_states mirror_states states_of",
        },
    )
