from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import (
        exploration as exploration,
        optimisation as optimisation,
        results as results,
        tolerances as tolerances,
        variables as variables,
    )
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "exploration.front": "pareto_front",
            "exploration.runs": "collect",
            "exploration.space": (
                "MEASURES Space designs measure_design measure_designs meets part_of space_of"
            ),
            "exploration.survey": "SKIPPED",
            "optimisation.expansion": "expand_objective expand_rows",
            "optimisation.formulation": "problem_of",
            "optimisation.rounding": "round_design step_of",
            "optimisation.search": "optimize",
            "tolerances.heads": "HeadSettings count_passes interval simulate_heads",
            "tolerances.prediction": "draw_heads expand_margins predict_yields sensitivities",
            "tolerances.robust": "robust_layout",
            "variables": "present_values sensor_of",
            "volume": "add_worst_states mirror_states span_of states_of",
        },
    )
