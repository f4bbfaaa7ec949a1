from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import assembly as assembly
    from . import branching as branching
    from . import changes as changes
    from . import exploration as exploration
    from . import production as production
    from . import report as report
    from . import robust as robust
    from . import rounding as rounding
    from . import search as search
    from . import tables as tables
    from . import tolerancing as tolerancing
    from . import variables as variables
    from . import verification as verification
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "assembly": "assembly_of",
            "exploration.front": "pareto_front",
            "exploration.runs": "collect",
            "exploration.space": (
                "MEASURES Space designs measure_design measure_designs meets part_of space_of"
            ),
            "exploration.survey": "SKIPPED",
            "problem": "problem_of",
            "production": "count_passes interval simulate_heads",
            "robust": "robust_layout",
            "rounding": "round_design step_of",
            "search": "optimize",
            "tolerancing": "draw_heads expand_margins predict_yields sensitivities",
            "variables": "present_values sensor_of",
            "volume": "add_worst_states mirror_states states_of",
        },
    )
